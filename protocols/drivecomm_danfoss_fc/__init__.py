"""The FC protocol, the serial protocol of Danfoss frequency converters, for drivecomm."""

from drivecomm_danfoss_fc.plugin import protocol as protocol
