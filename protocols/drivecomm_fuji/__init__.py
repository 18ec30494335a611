"""The Fuji Electric general-purpose inverter protocol (FGI-BUS), for drivecomm."""

from drivecomm_fuji.plugin import protocol as protocol
