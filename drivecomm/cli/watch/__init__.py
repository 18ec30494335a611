"""The watch command: the drives of a plant, live in a terminal."""

from drivecomm.cli.watch.command import watch

__all__ = ["watch"]
