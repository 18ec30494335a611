"""Virtual lines and virtual drives, for tests without hardware and without waiting."""

from drivecomm.virtual.drives import virtual_drive as virtual_drive
from drivecomm.virtual.faults import FaultPlan as FaultPlan
from drivecomm.virtual.line import VirtualLine as VirtualLine
