"""Older Huanyang drives for drivecomm."""

from drivecomm_huanyang.plugin import protocol as protocol
