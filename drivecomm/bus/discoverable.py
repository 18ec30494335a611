"""What dir() and completion show of a drive or a bus: what its user may use, without what other rooms call."""

from __future__ import annotations

from typing import ClassVar


class Discoverable:
    """Base of classes of which dir() leaves out the inner names of each class among their bases."""

    _inner: ClassVar[frozenset[str]] = frozenset()
    """Names of this class that only drivecomm itself calls."""

    def __dir__(self) -> list[str]:
        inner = frozenset().union(*(vars(kind).get("_inner", ()) for kind in type(self).__mro__))
        return [name for name in super().__dir__() if name not in inner]
