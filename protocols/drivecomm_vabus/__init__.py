"""VABus, the serial protocol of Bonfiglioli Vectron inverters, for drivecomm."""

from drivecomm_vabus.plugin import protocol as protocol
