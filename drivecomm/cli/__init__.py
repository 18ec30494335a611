"""The command line: `drivecomm`, and `python -m drivecomm`."""

from drivecomm.cli.entry import main

__all__ = ["main"]
