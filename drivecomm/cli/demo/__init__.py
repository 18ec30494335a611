"""The demo command: a tour of everything, on virtual lines or on a real one."""

from drivecomm.cli.demo.command import demo

__all__ = ["demo"]
