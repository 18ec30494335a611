"""Names that dir() and completion show of a drive or a bus: those for its users, without internal ones."""

from __future__ import annotations

from typing import ClassVar


class Discoverable:
    """Base of classes whose dir() leaves out the internal names of each of their bases."""

    _inner: ClassVar[frozenset[str]] = frozenset()
    """Names of this class that only drivecomm itself uses."""

    def __dir__(self) -> list[str]:
        inner = frozenset().union(*(vars(kind).get("_inner", ()) for kind in type(self).__mro__))
        return [name for name in super().__dir__() if name not in inner]
