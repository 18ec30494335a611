"""Parameter addresses that a drive may hold, for callers that read them one by one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from typing import Any


@dataclass(frozen=True, slots=True, kw_only=True)
class Elements:
    """Elements that a parameter may have: data sets or array elements.

    runs: element addresses in order; each run ends with the first element that the drive does not have. beyond: an
    element that no parameter has, empty if it is not needed. A drive that answers a read of this element ignores the
    element address, and its parameter then counts as having no elements.
    """

    runs: tuple[tuple[str, ...], ...] = ()
    beyond: str = ""


NO_ELEMENTS = Elements()
"""Elements of a parameter with a single value."""


def _one_value(_address: str, _code: int | None) -> Elements:
    return NO_ELEMENTS


@dataclass(frozen=True, slots=True, kw_only=True)
class AddressSpace:
    """Parameter addresses that a drive can hold.

    addresses: all addresses in order, without data set or index, written as in the drive's model. absent: the codes of
    RefusedError by which a drive reports that it has no such parameter or element; after any other code the parameter
    exists. elements: returns the elements to read, given an address and the code with which its plain read was refused
    (None if it was answered). together: the keys of a model's parameter by which one parameter stands for all these
    elements; None if each element is a parameter of its own. source: the pages that list the possible addresses.
    """

    addresses: Callable[[], Iterator[str]]
    absent: frozenset[int]
    source: str
    elements: Callable[[str, int | None], Elements] = _one_value
    together: Mapping[str, Any] | None = None
