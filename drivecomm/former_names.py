"""Names that drivecomm 0.1 used for public things; they work until 0.3, with a warning."""

from __future__ import annotations

from typing import TYPE_CHECKING
from warnings import warn

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping


def with_former_names(
    package: str, find: Callable[[str], object], former: Mapping[str, str]
) -> Callable[[str], object]:
    """Return a `__getattr__` for a package that also finds former names, each with a DeprecationWarning.

    find: the `__getattr__` for present names. former: the present name for each former one.
    """

    def attribute(name: str) -> object:
        now = former.get(name)
        if now is None:
            return find(name)
        text = f"{package}.{name} is now {package}.{now}; drivecomm 0.3 no longer has the former name"
        warn(text, DeprecationWarning, stacklevel=2)
        return find(now)

    return attribute
