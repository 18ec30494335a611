"""USS, the serial protocol of Siemens and NORD drives, for drivecomm."""

from drivecomm_uss.plugin import protocol as protocol
