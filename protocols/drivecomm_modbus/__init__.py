"""Modbus RTU drives for drivecomm."""

from drivecomm_modbus.plugin import protocol as protocol
