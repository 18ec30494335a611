"""Telegrams of USS (USS specification E20125-D0001-S302-A1-7600, 09.94, A-3 to A-11).

    STX LGE ADR PKE IND PWE...  PZD1 PZD2 ...  BCC     PKW area of 3, 4 or a variable number of words, 0 to 16 PZD words
    STX LGE ADR                 PZD1 PZD2 ...  BCC     without PKW area
    STX LGE ADR enable array    PZD1 PZD2 ...  BCC     to all drives
    STX LGE ADR data ...                       BCC     mirror (sent back unchanged) and special telegrams

STX is 02H. LGE counts the bytes behind itself. Words have the high byte first. BCC is the exclusive-or of everything
before it, STX included. Nothing is escaped: 02H may occur anywhere, so reception relies on LGE and on silence. The
number of words in the two areas is a setting of the drive, which no telegram shows.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

from construct import this

from drivecomm.errors import TelegramError
from drivecomm.protocol import begins_again
from drivecomm.protocol.schema import (
    CheckCharacters,
    Form,
    Leaf,
    bytes_as,
    bytes_in,
    characters,
    constant,
    message_of,
    numbers,
    signed,
    unsigned,
    words_as,
    words_in,
    wrong_field,
    xor_byte,
)
from drivecomm_uss.messages import Reply, Request
from drivecomm_uss.options import VARIABLE, Ind, UssOptions
from drivecomm_uss.parameter_area import ParameterArea

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.protocol import Direction, Message

_STX = b"\x02"
_SPECIAL, _MIRROR, _BROADCAST = 0x80, 0x40, 0x20
_LONGEST = 252
"""Largest number of net bytes, an even number (A-3)."""
_LENGTHS = range(0, _LONGEST + 1, 2)
_HEAD = 3
_FORMS: dict[Direction, dict[int, str]] = {
    "request": {0b000: "", 0b001: "broadcast", 0b010: "data", 0b100: "data", 0b101: "data"},
    "reply": {0b000: "", 0b010: "data", 0b100: "data"},
}
"""Forms by bits 7 to 5 of ADR; empty for a plain telegram, whose form depends on the settings of the drive.

Other combinations of these bits are not defined.
"""
_UNDEFINED = "ADR {:02X} means no telegram of this form: mirror, special and broadcast do not go together so"


def _net_bytes(lge: bytes) -> int:
    if lge[0] - 2 not in _LENGTHS:
        raise ValueError(f"LGE {lge[0]} is not an even number from 2 to {_LONGEST + 2}")
    return lge[0] - 2


def _adr_of(message: Any) -> int:
    flags, address = (message.special, message.mirror, message.broadcast), message.address
    if any(type(flag) is not bool for flag in flags):
        raise wrong_field("special", "special, mirror and broadcast are true or false")
    if message.broadcast is (address is not None):
        raise wrong_field("address", "a broadcast has none" if message.broadcast else "it is missing")
    if not message.broadcast and (type(address) is not int or address not in range(32)):
        raise wrong_field("address", f"{address!r} is not 0 to 31")
    adr = sum(bit for bit, flag in zip((_SPECIAL, _MIRROR, _BROADCAST), flags, strict=True) if flag) | (address or 0)
    if adr >> 5 not in _FORMS["request" if isinstance(message, Request) else "reply"]:
        raise wrong_field("address", _UNDEFINED.format(adr))
    return adr


@cache
def _form(direction: Direction, name: str, pkw: int, pzd: int, ind: Ind) -> Form[Any]:
    """Return the form of one kind of telegram for these settings of a drive."""

    def adr_parts(adr: int) -> tuple[bool, bool, bool, int | None]:
        if (_FORMS[direction].get(adr >> 5, "other") or _plain_form(pkw)) != name:
            raise ValueError(_UNDEFINED.format(adr))
        special, mirror, broadcast = (bool(adr & bit) for bit in (_SPECIAL, _MIRROR, _BROADCAST))
        return special, mirror, broadcast, None if broadcast else adr & 0x1F

    def write_data(message: Request | Reply) -> tuple[str, int]:
        content = bytes_as(message.data, "data", _LONGEST)
        if not _takes(direction, _adr_of(message), len(content), pkw, pzd):
            raise wrong_field("data", f"{len(content)} bytes of net data are not what this drive is set to")
        return content, len(content)

    def write_area(message: Request | Reply) -> tuple[int, int, str, int]:
        pke, index_word, words = area.write(message)
        return pke, index_word, words_as(words), 4 + 2 * (len(words) + pzd)

    def pzd_words(more: str) -> tuple[int, ...]:
        return words_in(more)

    area = ParameterArea(direction, pkw, ind)
    reads: dict[str, Callable[..., Any]] = {"special mirror broadcast address": adr_parts}
    writes: dict[str, Callable[[Any], Any]] = {"adr": _adr_of}
    middle: tuple[Any, ...] = ()
    if name == "data":
        middle = ("content" / characters(this.net, lowest=0, highest=255, meaning="net data, as they are"),)
        reads["data"], writes["content net"] = bytes_in, write_data
    elif name == "parameter":
        middle = (
            "pke" / unsigned(2, "PKE: AK in bits 12..15, SPM in 11, PNU in 0..10"),
            "ind" / unsigned(2, "IND: index, page of the parameter"),
            "words" / characters(this.net - 4 - 2 * pzd, lowest=0, highest=255, meaning="PWE: value, high word first"),
        )
        reads[" ".join(area.names)], writes["pke ind words net"] = area.read, write_area
    elif name == "broadcast" and pkw:
        middle = ("content" / characters(8, lowest=0, highest=255, meaning="broadcast enable array"),)
        reads["enable"] = words_in
        writes["content"] = lambda message: words_as(tuple(numbers(message.enable, 0xFFFF, "enable")))
    if name not in ("data", "parameter"):
        size = 2 * pzd + (8 if middle else 0)
        writes["net"] = lambda _: size
    if name != "data":
        middle += _process_words(direction, pzd)
        if pzd > 2:
            reads["pzd"] = pzd_words
            writes["more"] = lambda message: words_as(tuple(numbers(message.pzd, 0xFFFF, "pzd")))
    return Form(
        Request if direction == "request" else Reply,
        constant(_STX, "STX"),
        "net"
        / Leaf(1, _net_bytes, lambda net: bytes([net + 2]), category="length", meaning="LGE: 2 + bytes of net data"),
        "adr" / unsigned(1, "ADR: bit 7 special, 6 mirror, 5 broadcast, 0..4 address"),
        *middle,
        CheckCharacters(1, 0, xor_byte, meaning="BCC: exclusive-or of all bytes before it"),
        reads=reads,
        writes=writes,
    )


def _plain_form(pkw: int) -> str:
    return "parameter" if pkw else "process"


def _process_words(direction: Direction, count: int) -> tuple[Any, ...]:
    if direction == "request":
        words = "control_word" / unsigned(2, "PZD1: control word"), "reference" / signed(2, "PZD2: 4000H = 100 %")
    else:
        words = "status_word" / unsigned(2, "PZD1: status word"), "actual" / signed(2, "PZD2: 4000H = 100 %")
    more = ("more" / characters(2 * count - 4, lowest=0, highest=255, meaning="PZD3 and on"),) if count > 2 else ()
    return *words[:count], *more


def _takes(direction: Direction, adr: int, net: int, pkw: int, pzd: int) -> bool:
    """Whether a telegram may have this many bytes of net data with these settings of a drive (A-8, C-36).

    Special telegrams may have any net data. A drive accepts only mirror telegrams of its own lengths, so its replies
    have these; a mirror reply of another length is still decoded, to find its sender.
    """
    if adr & _SPECIAL or (adr & _MIRROR and direction == "reply"):
        return net in _LENGTHS
    if pkw and _FORMS[direction].get(adr >> 5) == "broadcast":
        return net == 8 + 2 * pzd
    if pkw == VARIABLE:
        return net in _LENGTHS and net >= 2 * (3 + pzd)
    return net == 2 * (pkw + pzd)


class UssCodec:
    """Codec of the telegrams, for one drive's settings."""

    def __init__(self, options: UssOptions) -> None:
        pkw, pzd, ind = self._pkw, self._pzd, _ = options.pkw_words, options.pzd_words, options.ind
        self.alike = ("uss", pkw, pzd, ind)
        self._plain = _plain_form(pkw)
        self._forms = {
            direction: {name: _form(direction, name, pkw, pzd, ind) for name in {*named.values(), self._plain} - {""}}
            for direction, named in _FORMS.items()
        }

    def measure(self, head: bytes, direction: Direction) -> int:
        """Return the length of the telegram that begins with these bytes, see `Codec.measure`."""
        if not head:
            return _HEAD + 1
        if head[:1] != _STX or (len(head) > 1 and head[1] - 2 not in _LENGTHS):
            return 0
        if len(head) < _HEAD:
            return _HEAD
        return head[1] + 2 if _takes(direction, head[2], head[1] - 2, self._pkw, self._pzd) else 0

    def decode(self, data: bytes, direction: Direction) -> Message:
        """Return the content of one telegram. Raises TelegramError."""
        if len(data) < _HEAD or len(data) != data[1] + 2:
            raise TelegramError("length", f"{len(data)} bytes are not as many as LGE says")
        if not _takes(direction, data[2], data[1] - 2, self._pkw, self._pzd):
            raise TelegramError("length", f"LGE {data[1]} is not what this drive is set to")
        name = _FORMS[direction].get(data[2] >> 5, "data") or self._plain
        message: Message = self._forms[direction][name].parse(data)
        if begins_again(data):
            raise TelegramError("framing", "a telegram that broke off and its repetition, run together")
        return message

    def encode(self, message: Message) -> bytes:
        """Return the bytes of one telegram."""
        direction: Direction = "request" if isinstance(message, Request) else "reply"
        form = self._forms[direction].get(_FORMS[direction][_adr_of(message) >> 5] or message.kind)
        if form is None:
            which = f"it is missing or too much: this drive has {self._plain} telegrams"
            raise wrong_field("ak", f"{which}; say special, mirror or broadcast if it is one")
        return form.build(message)


def message_from(given: Mapping[str, Any], direction: Direction) -> Message:
    """Return a message from fields with the names that test vectors use."""
    message: Request | Reply = message_of(Request if direction == "request" else Reply, given, f"a {direction}")
    if given.get("kind", message.kind) != message.kind:
        raise wrong_field("kind", f"these are the fields of a {message.kind} telegram, not of {given['kind']!r}")
    return message


def titled_forms() -> dict[str, Form[Any]]:
    """Return the forms of all telegrams by their usual titles, for the settings of most drives."""
    titles = {
        "With parameter area, master": ("request", "parameter", VARIABLE),
        "With parameter area, drive": ("reply", "parameter", VARIABLE),
        "Process data only, master": ("request", "process", 0),
        "Process data only, drive": ("reply", "process", 0),
        "To all drives": ("request", "broadcast", VARIABLE),
        "Mirror or special, master": ("request", "data", VARIABLE),
        "Mirror or special, drive": ("reply", "data", VARIABLE),
    }
    return {title: _form(direction, name, pkw, 2, "page") for title, (direction, name, pkw) in titles.items()}
