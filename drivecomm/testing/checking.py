"""Registry of checks: functions that raise CheckFailure if a protocol misbehaves.

    @check("contract")
    def has_addresses(plugin: Protocol) -> None:
        \"\"\"There are addresses.\"\"\"
        expect(plugin.addresses, "no drive has an address")

The first line of the docstring says what must hold. A check is named after its function, unless a name is given. The
theme decides which arguments a check gets, and how often it runs:

    contract, documents             the protocol
    vectors                         each vector that it applies to, as a `VectorCase`
    exchanges, live                 the protocol, and each exchange vector
    refusals, streams               the protocol, and each of the vector file
    schemas                         each schema of the protocol
    parameters, commands, confusion the protocol, and each of its models
    monitoring                      the protocol, and each model without commands; replaces commands
    foreign traffic                 the protocol, and each of the others
    properties                      the source of the examples, and hypothesis' data object
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, fields as dataclass_fields
from inspect import getdoc
from typing import TYPE_CHECKING, Any, TypeVar

from drivecomm.errors import TelegramError
from drivecomm.models import load_model

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from drivecomm.protocol import Codec, Direction, Message, Model, Protocol
    from drivecomm.testing.vectors import Vector

F = TypeVar("F", bound=Callable[..., None])


class CheckFailure(AssertionError):  # noqa: N818 - a result of a check, not an error of this program
    """A protocol does not do what it should; the text says what it does instead."""


@dataclass(frozen=True, slots=True)
class Check:
    """A single check, ready to run.

    name: path of the check; the part before the first slash is the protocol. run: raises CheckFailure if the check
    fails. meaning: what must hold, in one sentence.
    """

    name: str
    run: Callable[[], None]
    meaning: str = ""

    @property
    def kind(self) -> str:
        """Last part of the name: the kind of check, without its vector or model."""
        return self.name.rpartition("/")[2]


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckFunction:
    """A check function registered by `check`.

    name: the last part of the names of its checks. applies_to: whether it applies to a vector. costly: slow; a quick
    run leaves it out, or runs it on some of the vectors only.
    """

    function: Callable[..., None]
    name: str
    applies_to: Callable[[Vector], bool]
    costly: bool

    def on(self, prefix: str, *values: Any) -> Check:
        """Return the check bound to these values, with a name that starts with the prefix."""
        return Check(f"{prefix}/{self.name}", lambda: self.function(*values), self.meaning)

    @property
    def meaning(self) -> str:
        """What must hold, in one sentence."""
        return (getdoc(self.function) or "").partition("\n")[0]


_registered: defaultdict[str, list[CheckFunction]] = defaultdict(list)


def check(
    theme: str, name: str = "", *, applies_to: Callable[[Vector], bool] = lambda _: True, costly: bool = False
) -> Callable[[F], F]:
    """Register a function as a check of this theme; see `CheckFunction`. name: the function's name if empty."""

    def register(function: F) -> F:
        title = name or function.__name__.replace("_", " ")
        _registered[theme].append(CheckFunction(function=function, name=title, applies_to=applies_to, costly=costly))
        return function

    return register


def registered(theme: str) -> Sequence[CheckFunction]:
    """Return the checks of a theme, in the order in which they were registered."""
    return _registered[theme]


def is_valid(vector: Vector) -> bool:
    """Whether a vector is a valid telegram, for `applies_to`."""
    return vector.valid


def expect(condition: object, failure: str) -> None:
    """Raise CheckFailure with this reason unless the condition holds."""
    if not condition:
        raise CheckFailure(failure)


def raise_all(wrong: Sequence[str]) -> None:
    """Raise CheckFailure with the first few of these failures, if there are any."""
    if wrong:
        more = f" (and {len(wrong) - 3} more)" if len(wrong) > 3 else ""
        raise CheckFailure("; ".join(wrong[:3]) + more)


def message_hex(data: bytes) -> str:
    """Return bytes in the form used in messages."""
    return data.hex(" ").upper() or "nothing"


@dataclass(frozen=True, slots=True, kw_only=True)
class VectorCase:
    """A vector of a protocol under test.

    listed: all valid telegrams of the file and of the package, by direction.
    """

    plugin: Protocol
    vector: Vector
    listed: frozenset[tuple[Direction, bytes]]

    @property
    def codec(self) -> Codec:
        """A codec with the vector's options."""
        return codec_for(self.plugin, self.vector.options)

    def lists(self, data: bytes) -> bool:
        """Whether the vectors list these bytes as a valid telegram."""
        return (self.vector.direction, data) in self.listed


def decoded(codec: Codec, data: bytes, direction: Direction) -> Message | None:
    """Return the message that a codec decodes from these bytes, or None if it refuses them."""
    try:
        return codec.decode(data, direction)
    except TelegramError:
        return None


def with_flips(data: bytes, place: int) -> Iterator[bytes]:
    """Yield the bytes with one bit flipped in the byte at this index, from the lowest bit to the highest."""
    return (data[:place] + bytes([data[place] ^ 1 << bit]) + data[place + 1 :] for bit in range(8))


def codec_for(plugin: Protocol, options: Mapping[str, Any]) -> Codec:
    """Return a protocol's codec with these options. Raises CheckFailure for options that the protocol does not have."""
    known = sorted(field.name for field in dataclass_fields(plugin.options))
    unknown = sorted(set(options) - set(known))
    if unknown:
        raise CheckFailure(f"{plugin.name} has no option {unknown[0]!r}; it has {', '.join(known)}")
    return plugin.codec(plugin.options(**options))


def known_model(plugin: Protocol, name: str) -> Model:
    """Return a model of the protocol by name. Raises as `load_model` does."""
    return load_model(plugin.package, plugin.name, name)
