"""Which parameter addresses a drive may hold, for whoever asks it address by address."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from typing import Any


@dataclass(frozen=True, slots=True, kw_only=True)
class Elements:
    """The elements that a parameter may have: data sets, array elements.

    runs: their addresses in order; each run ends with the first one that the drive does not have. beyond: an element
    that no parameter has, empty where that is not needed. A drive that answers it does not look at the element at all,
    and then it has none.
    """

    runs: tuple[tuple[str, ...], ...] = ()
    beyond: str = ""


NO_ELEMENTS = Elements()
"""Of a parameter with one value."""


def _one_value(_address: str, _code: int | None) -> Elements:
    return NO_ELEMENTS


@dataclass(frozen=True, slots=True, kw_only=True)
class AddressSpace:
    """What addresses a drive can hold.

    addresses: all of them in order, without data set or index, written as the drive's model writes them. absent: the
    codes of RefusedError with which a drive says that it has no such parameter or element; any other refusal is of a
    parameter that is there. elements: those to ask for after the plain address was refused with a code, or answered
    (None). together: the keys of a model's parameter with which one parameter stands for all such elements; None where
    each element is a parameter of its own. source: the pages that say which addresses there can be.
    """

    addresses: Callable[[], Iterator[str]]
    absent: frozenset[int]
    source: str
    elements: Callable[[str, int | None], Elements] = _one_value
    together: Mapping[str, Any] | None = None
