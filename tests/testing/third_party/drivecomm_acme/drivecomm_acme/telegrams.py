"""The telegrams of an Acme drive, A10 line manual, section 2.

Master to drive; address 00 is all drives, for W and C only:

    query     :  a a  R  p p p           L L  CR LF    read a parameter
    preset    :  a a  W  p p p  v v v v  L L  CR LF    write it until the power goes; M: store it
    poll      :  a a  P                  L L  CR LF    read the status
    order     :  a a  C  c c             L L  CR LF    control word

Drive to master:

    value     :  a a  V  p p p  v v v v  L L  CR LF    what it holds; D: has written, K: has stored
    state     :  a a  S  s s s s  f f    L L  CR LF    status word and fault code
    accepted  :  a a  A  c c             L L  CR LF    acts on this control word
    refusal   :  a a  E  k  p p p  n n   L L  CR LF    will not: letter and parameter of the request, code

aa and ppp are decimal, vvvv, cc, ssss, ff and nn hexadecimal. LL is the two's complement of the sum of all characters
behind the colon, two hexadecimal digits. A colon, CR or LF never stands inside.

Faults to expect: a lost character, a wrong check, a reply of another drive. The letter, the address and the parameter
come back in every reply that carries data, so a late one is told apart.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias

from drivecomm.errors import TelegramError
from drivecomm.protocol.schema import CheckCharacters, Form, choice, constant, decimal_number, hex_number, message_of

if TYPE_CHECKING:
    from collections.abc import Container, Mapping

    from drivecomm.protocol import Direction, Message

ALL_DRIVES = 0
ADDRESSES = range(1, 64)
_ANYBODY = range(64)


@dataclass(frozen=True, slots=True, kw_only=True)
class Query:
    """Request to read a parameter."""

    kind: ClassVar[str] = "read"
    address: int
    parameter: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Preset:
    """Request to write a parameter. kind: write (lost at power-off) or store."""

    kind: str
    address: int
    parameter: int
    data: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Poll:
    """Request for the status."""

    kind: ClassVar[str] = "poll"
    address: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Order:
    """Request with a control word."""

    kind: ClassVar[str] = "order"
    address: int
    control_word: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Value:
    """Reply with the value of a parameter. kind: that of the request: read, write or store."""

    kind: str
    address: int
    parameter: int
    data: int


@dataclass(frozen=True, slots=True, kw_only=True)
class State:
    """Reply with the status."""

    kind: ClassVar[str] = "state"
    address: int
    status_word: int
    fault_code: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Accepted:
    """Reply that accepts a control word."""

    kind: ClassVar[str] = "accepted"
    address: int
    control_word: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Refusal:
    """Reply that refuses a request. of: the kind of the request. parameter: 0 for an order."""

    kind: ClassVar[str] = "refused"
    address: int
    of: str
    parameter: int
    code: int


Request: TypeAlias = Query | Preset | Poll | Order
Reply: TypeAlias = Value | State | Accepted | Refusal

_REQUEST_LETTERS = {b"R": "read", b"W": "write", b"M": "store", b"C": "order"}
_PRESETS = {b"W": "write", b"M": "store"}
_VALUES = {b"V": "read", b"D": "write", b"K": "store"}


def complement(covered: bytes) -> bytes:
    """Return the two's complement of the low eight bits of the sum, as two hexadecimal digits (section 2.3)."""
    return b"%02X" % (-sum(covered) & 0xFF)


def _line(message: type[Any], addresses: Container[int], *fields: Any) -> Form[Any]:
    return Form(
        message,
        constant(b":", "colon"),
        "address" / decimal_number(2, addresses, "address, 00 for all drives"),
        *fields,
        CheckCharacters(2, 1, complement, meaning="two's complement of the sum of all characters behind the colon"),
        constant(b"\r", "CR"),
        constant(b"\n", "LF"),
    )


def _parameter() -> Any:
    return "parameter" / decimal_number(3, meaning="parameter 000..999")


def _letters(values: Mapping[bytes, str]) -> Any:
    return choice(dict(values), ", ".join(f"{letter.decode()} {kind}" for letter, kind in values.items()))


QUERY = _line(Query, ADDRESSES, constant(b"R", "R: read"), _parameter())
PRESET = _line(Preset, _ANYBODY, "kind" / _letters(_PRESETS), _parameter(), "data" / hex_number(4, "value"))
POLL = _line(Poll, ADDRESSES, constant(b"P", "P: status"))
ORDER = _line(Order, _ANYBODY, constant(b"C", "C: order"), "control_word" / hex_number(2, "control word"))
VALUE = _line(Value, ADDRESSES, "kind" / _letters(_VALUES), _parameter(), "data" / hex_number(4, "value"))
STATE = _line(
    State,
    ADDRESSES,
    constant(b"S", "S: state"),
    "status_word" / hex_number(4, "status word"),
    "fault_code" / hex_number(2, "fault, 00: none"),
)
ACCEPTED = _line(Accepted, ADDRESSES, constant(b"A", "A: accepted"), "control_word" / hex_number(2, "control word"))
REFUSAL = _line(
    Refusal,
    ADDRESSES,
    constant(b"E", "E: refused"),
    "of" / _letters(_REQUEST_LETTERS),
    _parameter(),
    "code" / hex_number(2, "reason"),
)

_FORMS: dict[type[Any], Form[Any]] = {
    form.message: form for form in (QUERY, PRESET, POLL, ORDER, VALUE, STATE, ACCEPTED, REFUSAL)
}
_BY_LETTER: dict[Direction, dict[int, tuple[Form[Any], int]]] = {
    "request": {ord("R"): (QUERY, 11), ord("W"): (PRESET, 15), ord("M"): (PRESET, 15), ord("P"): (POLL, 8)}
    | {ord("C"): (ORDER, 10)},
    "reply": {ord("V"): (VALUE, 15), ord("D"): (VALUE, 15), ord("K"): (VALUE, 15), ord("S"): (STATE, 14)}
    | {ord("A"): (ACCEPTED, 10), ord("E"): (REFUSAL, 14)},
}
_SHORTEST: dict[Direction, int] = {"request": 8, "reply": 10}
_LETTER_AT = 3


class AcmeCodec:
    """Codec of Acme telegrams; the letter determines the length of a telegram."""

    def measure(self, head: bytes, direction: Direction) -> int:
        """Return the length of the telegram that begins with these bytes, see `Codec.measure`."""
        if not head:
            return _SHORTEST[direction]
        if head[:1] != b":" or not (head[1:_LETTER_AT] or b"0").isdigit():
            return 0
        if len(head) <= _LETTER_AT:
            return _LETTER_AT + 1
        _, length = _BY_LETTER[direction].get(head[_LETTER_AT], (None, 0))
        return length

    def decode(self, data: bytes, direction: Direction) -> Message:
        """Return the content of one telegram. Raises TelegramError."""
        if len(data) < _SHORTEST[direction]:
            raise TelegramError("length", f"a {direction} has at least {_SHORTEST[direction]} characters: {data!r}")
        form, _ = _BY_LETTER[direction].get(data[_LETTER_AT], (None, 0))
        if form is None:
            letters = ", ".join(map(chr, _BY_LETTER[direction]))
            raise TelegramError("framing", f"{chr(data[_LETTER_AT])!r} stands where a {direction} has one of {letters}")
        message: Message = form.parse(data)
        return message

    def encode(self, message: Message) -> bytes:
        """Return the bytes of one telegram. Raises TelegramError."""
        if isinstance(message, Preset) and message.kind == "store" and message.address == ALL_DRIVES:
            raise TelegramError("field", "all drives at once cannot be made to store (section 3.2)", field="address")
        return _FORMS[type(message)].build(message)


_KINDS: dict[Direction, dict[str, type[Any]]] = {
    "request": {"read": Query, "write": Preset, "store": Preset, "poll": Poll, "order": Order},
    "reply": {"read": Value, "write": Value, "store": Value, "state": State, "accepted": Accepted, "refused": Refusal},
}


def message_from(given: Mapping[str, Any], direction: Direction) -> Message:
    """Build a message from fields as vectors and `drivecomm encode` give them. Raises TelegramError."""
    kind = given.get("kind")
    chosen = _KINDS[direction].get(kind) if isinstance(kind, str) else None
    if chosen is None:
        known = ", ".join(_KINDS[direction])
        raise TelegramError("field", f"the kind of a {direction} is one of {known}", field="kind")
    message: Message = message_of(chosen, given, f"a {kind} {direction}")
    return message


def mismatch(request: Message, reply: Message) -> str:
    """Return the first field in which a valid reply does not match a request, or "" if it matches."""
    if getattr(reply, "address", None) != getattr(request, "address", None):
        return "address"
    if isinstance(reply, Refusal):
        parameter = getattr(request, "parameter", 0)
        return "kind" if reply.of != request.kind else "" if reply.parameter == parameter else "parameter"
    if isinstance(request, Query | Preset) and isinstance(reply, Value):
        if reply.kind != request.kind:
            return "kind"
        if reply.parameter != request.parameter:
            return "parameter"
        return "data" if isinstance(request, Preset) and reply.data != request.data else ""
    if isinstance(request, Order) and isinstance(reply, Accepted):
        return "" if reply.control_word == request.control_word else "control_word"
    return "" if isinstance(request, Poll) and isinstance(reply, State) else "kind"


def titled_forms() -> dict[str, Form[Any]]:
    """Return all forms by their title in the documentation."""
    return {form.message.__name__: form for form in _FORMS.values()}
