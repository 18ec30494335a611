"""Hypothesis strategies for any installed protocol. Needs the `test` extra; import it from tests only.

    telegrams, messages, telegram_fields     valid telegrams, as bytes, as messages and as fields
    field_values                             the values of one of their fields
    near_telegrams, junk_fields, line_noise  invalid input
    verb_calls, conversations                calls of a program to a drive
    fault_plans                              faults on a virtual line
    pieces                                   the same bytes in any pieces

A protocol is named, or given as its plug-in.

A protocol's dataclasses do not say which values its telegrams can carry; only its encoder knows them. So the limits of
each field are found by trying the encoder, starting from a valid vector. A drawn value stays only if the encoder
accepts it together with the others.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeAlias

from hypothesis import strategies as st

from drivecomm.errors import DriveCommError, UsageError
from drivecomm.plant import TRANSMISSION_FAULTS, FaultPlan
from drivecomm.protocol import installed
from drivecomm.testing.conversation_strategies import VerbCall, conversations, limits, verb_calls
from drivecomm.testing.vectors import packaged_vectors

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from hypothesis.strategies import DrawFn, SearchStrategy

    from drivecomm.plant import LineFault
    from drivecomm.protocol import Codec, Direction, Message, Protocol

    _Accepts: TypeAlias = Callable[[Mapping[str, Any]], bool]

__all__ = [
    "VerbCall",
    "conversations",
    "fault_plans",
    "field_values",
    "junk_fields",
    "line_noise",
    "messages",
    "near_telegrams",
    "pieces",
    "telegram_fields",
    "telegrams",
    "verb_calls",
]


def telegram_fields(protocol: Protocol | str, direction: Direction) -> SearchStrategy[dict[str, Any]]:
    """Return a strategy for fields that the protocol's encoder accepts, over the whole range of each field."""
    plugin = _plugin(protocol)
    if plugin is installed.get(plugin.name):
        return st.deferred(lambda: _fields_of_installed(plugin.name, direction))
    return st.deferred(lambda: _fields(plugin, direction))


def messages(protocol: Protocol | str, direction: Direction) -> SearchStrategy[Message]:
    """Return a strategy for messages that the protocol's encoder accepts."""
    plugin = _plugin(protocol)
    return telegram_fields(plugin, direction).map(lambda fields: plugin.message(fields, direction))


def telegrams(protocol: Protocol | str, direction: Direction) -> SearchStrategy[bytes]:
    """Return a strategy for valid telegrams as bytes."""
    plugin = _plugin(protocol)
    return messages(plugin, direction).map(plugin.codec(plugin.options()).encode)


def field_values(protocol: Protocol | str, direction: Direction, name: str) -> SearchStrategy[Any]:
    """Return a strategy for the values of one field, such as "parameter", in valid telegrams of every kind that has it.

    Raises UsageError if no telegram of this direction has the field.
    """
    plugin = _plugin(protocol)
    known = {
        each
        for vector in packaged_vectors(plugin).vectors
        if vector.valid and vector.direction == direction
        for each in vector.fields
    }
    if name not in known:
        raise UsageError(f"no {plugin.name} {direction} has a field {name!r}; they have {', '.join(sorted(known))}")
    return telegram_fields(plugin, direction).filter(lambda fields: name in fields).map(lambda fields: fields[name])


def fault_plans(
    *, highest_rate: float = 0.3, kinds: Sequence[LineFault] = TRANSMISSION_FAULTS, delay_s: float = 1.0
) -> SearchStrategy[FaultPlan]:
    """Return a strategy for fault plans of virtual lines: a rate, some of these kinds of fault, and a random seed."""
    return st.builds(
        FaultPlan,
        rate=st.floats(0, highest_rate),
        seed=st.integers(0, 2**32 - 1),
        kinds=st.lists(st.sampled_from(kinds), min_size=1, unique=True),
        delay_s=st.floats(0, delay_s),
    )


def near_telegrams(protocol: Protocol | str, direction: Direction) -> SearchStrategy[bytes]:
    """Return a strategy for bytes that are rarely valid: arbitrary ones, and telegrams cut, lengthened or damaged."""
    sound = telegrams(protocol, direction)
    return st.one_of(st.binary(max_size=64), sound, sound.flatmap(_damaged))


def junk_fields(protocol: Protocol | str, direction: Direction) -> Any:
    """Return a strategy for mappings with the protocol's field names and invalid content.

    The values have wrong types or ranges, and fields are missing or superfluous.
    """
    plugin = _plugin(protocol)
    entries = [
        vector.fields for vector in packaged_vectors(plugin).vectors if vector.fields and vector.direction == direction
    ]
    names = sorted({name for fields in entries for name in fields})
    numbers = st.integers(-3, 300), st.integers(-(1 << 40), 1 << 40), st.floats()
    anything = st.one_of(
        *(st.none(), st.booleans(), *numbers, st.text(max_size=8), st.text(min_size=90, max_size=300)),
        *(st.binary(max_size=4), st.decimals()),
        st.lists(st.integers(-2, 300) | st.text(max_size=2), max_size=4),
        st.dictionaries(st.text(max_size=2), st.integers(), max_size=2),
        st.sampled_from(sorted({str(value) for fields in entries for value in fields.values()})),
    )
    wild = st.dictionaries(st.sampled_from(names) | st.text(max_size=6), anything, max_size=len(names) + 1)
    spoilt = st.tuples(st.sampled_from(entries), wild).map(lambda pair: {**pair[0], **pair[1]})
    poorer = st.tuples(st.sampled_from(entries), st.sets(st.sampled_from(names))).map(
        lambda pair: {name: value for name, value in pair[0].items() if name not in pair[1]}
    )
    return st.one_of(wild, spoilt, spoilt, poorer)


def pieces(data: bytes) -> SearchStrategy[list[bytes]]:
    """Return a strategy that cuts the bytes anywhere, any number of times."""
    cuts = st.lists(st.integers(0, len(data)), max_size=12).map(sorted)
    return cuts.map(lambda places: [data[a:b] for a, b in zip([0, *places], [*places, len(data)], strict=True)])


def line_noise(codec: Codec, direction: Direction) -> SearchStrategy[bytes]:
    """Return a strategy for bytes none of which begins a telegram."""
    silent = [byte for byte in range(256) if codec.measure(bytes([byte]), direction) == 0]
    return st.lists(st.sampled_from(silent), max_size=20).map(bytes) if silent else st.just(b"")


def _plugin(protocol: Protocol | str) -> Protocol:
    return installed[protocol] if isinstance(protocol, str) else protocol


# Finding the limits of every field with the encoder takes longer than drawing examples, so the result is cached.
@lru_cache
def _fields_of_installed(name: str, direction: Direction) -> SearchStrategy[dict[str, Any]]:
    return _fields(installed[name], direction)


def _fields(plugin: Protocol, direction: Direction) -> SearchStrategy[dict[str, Any]]:
    codec = plugin.codec(plugin.options())

    def accepts(fields: Mapping[str, Any]) -> bool:
        try:
            codec.encode(plugin.message(fields, direction))
        except DriveCommError:
            return False
        return True

    shapes = [
        dict(vector.fields)
        for vector in packaged_vectors(plugin).vectors
        if vector.valid and vector.direction == direction and accepts(vector.fields)
    ]
    return st.one_of(
        [
            _mutations(base, {name: _values(name, base, shapes, accepts) for name in base if name != "kind"}, accepts)
            for base in shapes
        ]
    )


def _damaged(data: bytes) -> SearchStrategy[bytes]:
    places = st.integers(0, len(data) - 1)
    return st.one_of(
        places.map(lambda place: data[:place]),
        places.map(lambda place: data[place:]),
        st.tuples(places, st.integers(0, 255)).map(lambda at: data[: at[0]] + bytes([at[1]]) + data[at[0] + 1 :]),
        st.tuples(places, st.binary(min_size=1, max_size=4)).map(lambda at: data[: at[0]] + at[1] + data[at[0] :]),
        st.binary(min_size=1, max_size=30).map(lambda tail: data + tail),
    )


@st.composite
def _mutations(
    draw: DrawFn, base: dict[str, Any], values: Mapping[str, SearchStrategy[Any]], accepts: _Accepts
) -> dict[str, Any]:
    """Draw new values for some fields in turn; each stays if the encoder accepts it."""
    fields = dict(base)
    for name in draw(st.permutations(sorted(values))):
        if draw(st.integers(0, 3)):
            changed = {**fields, name: draw(values[name])}
            if accepts(changed):
                fields = changed
    return fields


def _values(
    name: str, fields: dict[str, Any], shapes: Sequence[Mapping[str, Any]], accepts: _Accepts
) -> SearchStrategy[Any]:
    value = fields[name]
    seen = st.sampled_from([shape[name] for shape in shapes if name in shape])
    if isinstance(value, bool):
        return st.booleans()
    if isinstance(value, int):
        lowest, highest = limits(value, lambda other: accepts({**fields, name: other}))
        return st.one_of(seen, st.integers(lowest, highest), st.sampled_from([lowest, highest]))
    if isinstance(value, list):
        return st.one_of(seen, st.lists(st.integers(0, 999), min_size=1, max_size=3))
    if isinstance(value, str):
        return st.one_of(seen, _texts(value))
    return seen


def _texts(like: str) -> SearchStrategy[str]:
    """Return a strategy for similar texts: decimal numbers, hexadecimal digits, letters with a number, words."""
    digits = len(like)
    hexadecimal = st.text("0123456789ABCDEF", min_size=digits, max_size=digits)
    decimal = st.tuples(st.integers(-99999, 99999), st.integers(0, 5)).map(lambda number: _decimal(*number))
    function = st.tuples(st.sampled_from("SMFECPHALUobrJdyWXZKTq"), st.integers(0, 99)).map("{0[0]}{0[1]:02d}".format)
    printable = st.characters(min_codepoint=0x20, max_codepoint=0x7E)
    words = st.integers(0, 99).flatmap(lambda length: st.text(printable, min_size=length, max_size=length))
    latin = st.text(st.characters(min_codepoint=0x20, max_codepoint=0xFF), min_size=0, max_size=40)
    return st.one_of(hexadecimal, decimal, function, words, latin)


def _decimal(digits: int, decimals: int) -> str:
    whole = f"{abs(digits):0{decimals + 1}d}"
    sign = "-" if digits < 0 else ""
    return sign + (f"{whole[:-decimals]}.{whole[-decimals:]}" if decimals else whole)
