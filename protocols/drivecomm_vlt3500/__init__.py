"""The telegram of Danfoss VLT Series 3500, 3000 and 2000, for drivecomm."""

from drivecomm_vlt3500.plugin import protocol as protocol
