"""Drive addresses for tests: most protocols start at 1, and some addresses belong to groups."""

from drivecomm.protocol import installed


def address_of(protocol: str, number: int = 1) -> int:
    """Return the Nth valid address of a protocol, without 0; the first one by default."""
    return [each for each in installed[protocol].addresses if each][number - 1]
