"""Checks: functions that raise CheckFailure where a protocol does not do what it should.

    @check("contract")
    def has_addresses(plugin: Protocol) -> None:
        \"\"\"There are addresses.\"\"\"
        expect(plugin.addresses, "no drive has an address")

The first line of the docstring says what must hold; the name of the check is that of the function, unless it is given.
The theme says what a check is given, and how often it is run:

    contract, documents             the protocol
    vectors                         each vector that it applies to, as a `Case`
    exchanges, live                 the protocol, and each exchange vector
    refusals, streams               the protocol, and each of the vector file
    schemas                         each schema of the protocol
    parameters, commands, confusion the protocol, and each of its models
    foreign traffic                 the protocol, and each of the others
    properties                      what examples are drawn from, and hypothesis' data object
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from inspect import getdoc
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.testing.vectors import Vector

F = TypeVar("F", bound=Callable[..., None])


class CheckFailure(AssertionError):  # noqa: N818 - a result of a check, not an error of this program
    """The protocol does not do what it should; the text says what it does instead."""


@dataclass(frozen=True, slots=True)
class Check:
    """One thing that must hold.

    name: where it belongs, the part before the first slash is the protocol. run: raises CheckFailure when it does not
    hold. meaning: what must hold, in one sentence.
    """

    name: str
    run: Callable[[], None]
    meaning: str = ""

    @property
    def kind(self) -> str:
        """What is checked, without what it is checked on: the last part of the name."""
        return self.name.rpartition("/")[2]


@dataclass(frozen=True, slots=True, kw_only=True)
class Registered:
    """A function that `check` was put on.

    name: the last part of the names of its checks. applies_to: whether it is for a vector. costly: it takes long, and a
    quick run leaves it out, or runs it on some of the vectors only.
    """

    function: Callable[..., None]
    name: str
    applies_to: Callable[[Vector], bool]
    costly: bool

    def on(self, prefix: str, *values: Any) -> Check:
        """Return the check of these values, named after a prefix."""
        return Check(f"{prefix}/{self.name}", lambda: self.function(*values), self.meaning)

    @property
    def meaning(self) -> str:
        """What must hold, in one sentence."""
        return (getdoc(self.function) or "").partition("\n")[0]


_registered: dict[str, list[Registered]] = {}


def check(
    theme: str, name: str = "", *, applies_to: Callable[[Vector], bool] = lambda _: True, costly: bool = False
) -> Callable[[F], F]:
    """Register a function as a check of this theme; see `Registered`. name: that of the function if empty."""

    def register(function: F) -> F:
        title = name or function.__name__.replace("_", " ")
        found = Registered(function=function, name=title, applies_to=applies_to, costly=costly)
        _registered.setdefault(theme, []).append(found)
        return function

    return register


def registered(theme: str) -> Sequence[Registered]:
    """Return the checks of a theme, in the order in which they were registered."""
    return _registered.get(theme, ())


def is_valid(vector: Vector) -> bool:
    """Whether a vector is a sound telegram, for `applies_to`."""
    return vector.valid


def expect(condition: object, failure: str) -> None:
    """Raise CheckFailure with this reason unless the condition holds."""
    if not condition:
        raise CheckFailure(failure)


def raise_all(wrong: Sequence[str]) -> None:
    """Raise CheckFailure with the first few of what is wrong, if anything is."""
    if wrong:
        more = f" (and {len(wrong) - 3} more)" if len(wrong) > 3 else ""
        raise CheckFailure("; ".join(wrong[:3]) + more)


def shown(data: bytes) -> str:
    """Return bytes as messages show them."""
    return data.hex(" ").upper() or "nothing"
