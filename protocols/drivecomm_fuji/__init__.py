"""Protocol package for the Fuji Electric general-purpose inverter protocol (FGI-BUS)."""

from drivecomm_fuji.plugin import protocol as protocol
