"""Protocol package for the FC protocol, the serial protocol of Danfoss frequency converters."""

from drivecomm_danfoss_fc.plugin import protocol as protocol
