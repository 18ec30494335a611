"""Addresses that drives of a protocol can have: most begin with 1, and some are those of groups."""

from drivecomm.protocol import installed


def address_of(protocol: str, number: int = 1) -> int:
    """Return the first valid address of a protocol, or another one by its number; 0 is not counted."""
    return [each for each in installed[protocol].addresses if each][number - 1]
