"""The telegrams of USS (USS specification E20125-D0001-S302-A1-7600, 09.94, A-3 to A-11).

    STX LGE ADR PKE IND PWE...  PZD1 PZD2 ...  BCC     PKW area of 3, 4 or a variable number of words, 0 to 16 PZD words
    STX LGE ADR                 PZD1 PZD2 ...  BCC     without PKW area
    STX LGE ADR enable array    PZD1 PZD2 ...  BCC     to all drives
    STX LGE ADR data ...                       BCC     mirror (sent back unchanged) and special telegrams

STX is 02H. LGE counts the bytes behind itself. Words go high byte first. BCC is the exclusive-or of everything before
it, STX included. Nothing is escaped: 02H may stand anywhere, so reception goes by LGE and by silence. How many words
the two areas have is a setting of the drive, which no telegram shows.
"""

from __future__ import annotations

from functools import cache, partial
from typing import TYPE_CHECKING, Any

from construct import this

from drivecomm.errors import TelegramError
from drivecomm.protocol import begins_again
from drivecomm.protocol.schema import Check, Form, Leaf, characters, constant, message_of, signed, unsigned, xor_byte
from drivecomm_uss import index_words, parameter_words
from drivecomm_uss.messages import Reply, Request
from drivecomm_uss.options import VARIABLE, UssOptions

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivecomm.protocol import Direction, Message
    from drivecomm_uss.messages import Words

_STX = 0x02
_SPECIAL, _MIRROR, _BROADCAST = 0x80, 0x40, 0x20
_LONGEST = 252
"""Net bytes, an even number (A-3)."""
_HEAD = 3


def _lge() -> Leaf:
    def parse(found: bytes) -> int:
        if found[0] not in range(2, _LONGEST + 3, 2):
            raise ValueError(f"LGE {found[0]} is no even number from 2 to {_LONGEST + 2}")
        return found[0] - 2

    return Leaf(1, parse, lambda net: bytes([net + 2]), category="length", meaning="LGE: 2 + bytes of net data")


def _adr(direction: Direction) -> Leaf:
    def parse(found: bytes) -> tuple[bool, bool, bool, int | None]:
        special, mirror, broadcast = (bool(found[0] & bit) for bit in (_SPECIAL, _MIRROR, _BROADCAST))
        _must_be_defined(direction, special=special, mirror=mirror, broadcast=broadcast)
        return special, mirror, broadcast, None if broadcast else found[0] & 0x1F

    def write(parts: tuple[bool, bool, bool, int | None]) -> bytes:
        *flags, address = parts
        if any(type(flag) is not bool for flag in flags):
            raise ValueError("special, mirror and broadcast are true or false")
        special, mirror, broadcast = flags
        _must_be_defined(direction, special=special, mirror=mirror, broadcast=broadcast)
        if broadcast is (address is not None):
            raise ValueError("a broadcast has no address" if broadcast else "the address is missing")
        if not broadcast and (type(address) is not int or address not in range(32)):
            raise ValueError(f"address {address!r} is not 0 to 31")
        return bytes([special * _SPECIAL | mirror * _MIRROR | broadcast * _BROADCAST | (address or 0)])

    return Leaf(1, parse, write, meaning="ADR: bit 7 special, 6 mirror, 5 broadcast, 0..4 address")


def _must_be_defined(direction: Direction, *, special: bool, mirror: bool, broadcast: bool) -> None:
    if mirror and (special or broadcast):
        raise ValueError("a mirror telegram is neither a special one nor for all drives")
    if broadcast and direction == "reply":
        raise ValueError("nobody answers a broadcast")


def _pzd(direction: Direction, count: int) -> tuple[Any, ...]:
    if direction == "request":
        words = "control_word" / unsigned(2, "PZD1: control word"), "reference" / signed(2, "PZD2: 4000H = 100 %")
    else:
        words = "status_word" / unsigned(2, "PZD1: status word"), "actual" / signed(2, "PZD2: 4000H = 100 %")
    more = ("more" / characters(2 * count - 4, lowest=0, highest=255, meaning="PZD3 and on"),) if count > 2 else ()
    return *words[:count], *more


def _form(direction: Direction, kind: str, options: UssOptions) -> Form[Any]:
    """Return the form of one kind of telegram for these settings of a drive."""
    return _form_of(
        direction, kind, UssOptions(pkw_words=options.pkw_words, pzd_words=options.pzd_words, ind=options.ind)
    )


@cache
def _form_of(direction: Direction, kind: str, options: UssOptions) -> Form[Any]:
    pkw, pzd = options.pkw_words, options.pzd_words
    reads: dict[str, Any] = {"special mirror broadcast address": lambda adr: adr}
    writes: dict[str, Any] = {"adr": lambda message: (*_flags(message), message.address)}
    middle: tuple[Any, ...]
    if kind == "data":
        middle = ("net_data" / characters(this.net, lowest=0, highest=255, meaning="net data, as they are"),)
        reads["data"] = lambda net_data: net_data.encode("latin-1").hex(" ").upper()
        writes |= {"net_data": lambda message: _bytes_of(message.data).decode("latin-1")}
        writes |= {"net": lambda message: _measured(message, len(_bytes_of(message.data)), options)}
    elif kind == "broadcast" and pkw:
        middle = ("array" / characters(8, lowest=0, highest=255, meaning="broadcast enable array"),)
        reads["enable"] = _array_words
        writes |= {"array": lambda message: _text(message.enable, "enable", 4)}
        writes["net"] = lambda _: 8 + 2 * pzd
    elif kind == "parameter":
        layout, own = options.ind, this.net - 4 - 2 * pzd
        middle = (
            "pke" / unsigned(2, "PKE: AK in bits 12..15, SPM in 11, PNU in 0..10"),
            "ind" / unsigned(2, "IND: index, page of the parameter"),
            "words" / characters(own, lowest=0, highest=255, meaning="PWE: value, high word first"),
        )
        highest = 2000 if layout in ("page", "masterdrives") else 2048
        reads |= {
            "ak spm pnu": lambda pke: _pke_parts(pke, highest),
            "index page parameter_set text_field text_write": lambda pke, ind: index_words.parts_of(
                ind, pke >> 12, layout
            ),
        }

        def content(pke: int, ind: int, words: str) -> Any:
            return _content(pke, ind, words, direction, options)

        if direction == "request":
            reads["value values text pwe"] = lambda pke, ind, words: content(pke, ind, words)[:4]
        else:
            reads["value values text pwe error"] = content
        pwe = partial(parameter_words.words_of, direction=direction, pkw=pkw)
        writes |= {
            "pke": lambda message: _pke_of(message, direction, highest),
            "ind": lambda message: index_words.word_of(message, layout),
            "words": lambda message: _text(pwe(message), "pwe", len(pwe(message))),
            "net": lambda message: 4 + 2 * (len(pwe(message)) + pzd),
        }
    else:
        middle = ()
        writes["net"] = lambda _: 2 * pzd
    if kind != "data":
        middle += _pzd(direction, pzd)
        if pzd > 2:
            reads["pzd"] = _more_words
            writes["more"] = lambda message: _text(message.pzd, "pzd", pzd - 2)
    return Form(
        Request if direction == "request" else Reply,
        constant(bytes([_STX]), "STX"), "net" / _lge(), "adr" / _adr(direction), *middle,
        Check(1, 0, xor_byte, meaning="BCC: exclusive-or of all bytes before it"),
        reads=reads, writes={name: _named(name, write) for name, write in writes.items()},
        check=partial(_check, direction=direction, form=kind, options=options),
    )  # fmt: skip


def _named(leaf: str, write: Callable[[Any], Any]) -> Callable[[Any], Any]:
    def named(message: Any) -> Any:
        try:
            return write(message)
        except ValueError as error:
            raise TelegramError("field", f"{message.kind} telegram: {error}", field=leaf) from None

    return named


_NET_DATA = frozenset(
    {"ak", "spm", "pnu", "index", "page", "parameter_set", "text_field", "text_write", "value", "values"}
)
_NET_DATA |= {"error", "text", "pwe"}
_PZD = ("control_word", "status_word", "reference", "actual", "pzd")


def _check(message: Any, *, direction: Direction, form: str, options: UssOptions) -> None:
    """Refuse fields that a telegram of this form does not have."""
    kind = message.kind
    if form != "data" and message.data is not None:
        raise _wrong("data", "only special and mirror telegrams have data; say special or mirror")
    if form != "broadcast" and getattr(message, "enable", None) is not None:
        raise _wrong("enable", "only a broadcast has an enable array; say broadcast")
    if form != ("data" if kind in ("special", "mirror") else kind):
        raise _wrong("ak", f"it is missing or too much: this drive's telegrams are {form} telegrams, not {kind}")
    strange = set[str]() if kind == "parameter" else set(_NET_DATA)
    if form == "data":
        strange |= {*_PZD, "enable"}
    else:
        strange.add("data")
        names = _PZD[direction != "request" : 4 : 2]
        strange |= {*names[options.pzd_words :]} | ({"pzd"} if options.pzd_words < 3 else set())
        missing = [name for name in names[: options.pzd_words] if getattr(message, name) is None]
        if missing:
            raise _wrong(missing[0], "it is missing")
    if kind != "broadcast" or not options.pkw_words:
        strange.add("enable")
    for name in sorted(strange):
        if getattr(message, name, None) is not None:
            raise _wrong(
                name, f"a {kind} telegram of this drive has none; say special, mirror or broadcast if it is one"
            )


def _content(pke: int, ind: int, words: str, direction: Direction, options: UssOptions) -> Any:
    value, values, error, text, pwe = parameter_words.content_of(
        _words(words),
        direction,
        pke >> 12,
        ind & 0xFF,
        options.pkw_words,
        writes_text=options.ind == "masterdrives" and bool(ind & 0x100),
    )
    return value, values, text, pwe, error


def _array_words(array: str) -> Words:
    return _words(array)


def _more_words(more: str) -> Words:
    return _words(more)


def _flags(message: Request | Reply) -> tuple[bool, bool, bool]:
    return message.special, message.mirror, message.broadcast


def _measured(message: Request | Reply, net: int, options: UssOptions) -> int:
    if net % 2 or net > _LONGEST or (message.mirror and not _fits(net, options)):
        raise _wrong("data", f"{net} bytes of net data are not what this drive is set to")
    return net


def _fits(net: int, options: UssOptions) -> bool:
    """Whether a drive with these settings takes so many bytes of net data (A-8, C-36)."""
    if options.pkw_words == VARIABLE:
        return net % 2 == 0 and 2 * (3 + options.pzd_words) <= net <= _LONGEST
    return net == 2 * (options.pkw_words + options.pzd_words)


def _pke_parts(pke: int, highest: int) -> tuple[int, bool, int]:
    if pke & 0x7FF >= highest:
        raise ValueError(f"parameter number {pke & 0x7FF} is beyond {highest - 1}")
    return pke >> 12, bool(pke >> 11 & 1), pke & 0x7FF


def _pke_of(message: Request | Reply, direction: Direction, highest: int) -> int:
    ak, pnu = message.ak, message.pnu
    if type(ak) is not int or ak not in range(16) or ak in parameter_words.NEVER_SENT[direction]:
        raise _wrong("ak", "it is missing" if ak is None else f"{ak!r} is no identifier of a {direction}")
    if type(pnu) is not int or pnu not in range(highest):
        raise _wrong("pnu", "it is missing" if pnu is None else f"{pnu!r} is not 0 to {highest - 1}")
    if message.spm not in (None, True, False):
        raise _wrong("spm", f"{message.spm!r} is neither true nor false")
    return ak << 12 | bool(message.spm) << 11 | pnu


def _words(text: str) -> Words:
    data = text.encode("latin-1")
    return tuple(int.from_bytes(data[place : place + 2], "big") for place in range(0, len(data), 2))


def _text(words: Words | None, name: str, count: int) -> str:
    if not isinstance(words, tuple) or any(type(each) is not int or each not in range(0x10000) for each in words):
        raise _wrong(name, "it is missing" if words is None else f"{words!r} is no list of words")
    if len(words) != count:
        raise _wrong(name, f"{len(words)} words where {count} belong")
    return b"".join(word.to_bytes(2, "big") for word in words).decode("latin-1")


def _bytes_of(data: object) -> bytes:
    try:
        return bytes.fromhex(data)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise _wrong("data", "it is missing" if data is None else f"{data!r} is no hexadecimal text") from None


def _wrong(field: str, message: str) -> TelegramError:
    return TelegramError("field", f"{field}: {message}", field=field)


class UssCodec:
    """Telegrams to bytes and back, for one drive's settings."""

    def __init__(self, options: UssOptions) -> None:
        self._options = options
        self.alike = ("uss", options.pkw_words, options.pzd_words, options.ind)
        names = ("data", "broadcast", "parameter" if options.pkw_words else "process")
        self._forms = {
            direction: {name: _form(direction, name, options) for name in names} for direction in _DIRECTIONS
        }

    def measure(self, head: bytes, direction: Direction) -> int:
        """Return how long the telegram is that begins with these bytes, see `Codec.measure`."""
        if not head:
            return _HEAD + 1
        if head[0] != _STX:
            return 0
        if len(head) < _HEAD:
            return _HEAD if len(head) < 2 or head[1] in range(2, _LONGEST + 3, 2) else 0
        return head[1] + 2 if self._takes(head[1] - 2, head[2], direction) else 0

    def _takes(self, net: int, adr: int, direction: Direction) -> bool:
        if adr & _SPECIAL and direction == "request":
            return net in range(0, _LONGEST + 1, 2)
        if direction == "request" and self._options.pkw_words and adr & (_BROADCAST | _MIRROR) == _BROADCAST:
            return net == 8 + 2 * self._options.pzd_words
        return _fits(net, self._options)

    def decode(self, data: bytes, direction: Direction) -> Message:
        """Return the content of one telegram."""
        if data[:1] not in (b"", b"\x02"):
            raise TelegramError("framing", f"a telegram begins with STX 02, not with {data[0]:02X}")
        if len(data) < _HEAD or len(data) < data[1] + 2:
            raise TelegramError("length", f"{len(data)} bytes are no whole telegram")
        if len(data) > data[1] + 2:
            raise TelegramError("length", f"{len(data) - data[1] - 2} bytes too many behind the BCC")
        adr = data[2]
        if not self._takes(data[1] - 2, adr, direction):
            raise TelegramError("length", f"LGE {data[1]} is not what this drive is set to")
        plain = "broadcast" if adr & _BROADCAST and direction == "request" else ""
        message: Message = self._form("data" if adr & (_SPECIAL | _MIRROR) else plain, direction).parse(data)
        if begins_again(data):
            raise TelegramError("framing", "a telegram that broke off and its repetition, run together")
        return message

    def encode(self, message: Message) -> bytes:
        """Return the bytes of one telegram."""
        direction: Direction = "request" if isinstance(message, Request) else "reply"
        kind = message.kind
        return self._form({"special": "data", "mirror": "data", "broadcast": kind}.get(kind, ""), direction).build(
            message
        )

    def _form(self, name: str, direction: Direction) -> Form[Any]:
        return self._forms[direction][name or ("parameter" if self._options.pkw_words else "process")]


_DIRECTIONS: tuple[Direction, Direction] = ("request", "reply")


def message_from(given: Mapping[str, Any], direction: Direction) -> Message:
    """Build a message from fields as test vectors name them."""
    plain = {
        name: tuple(value) if isinstance(value, list) else value for name, value in given.items() if name != "kind"
    }
    message: Request | Reply = message_of(Request if direction == "request" else Reply, plain, f"a {direction}")
    if given.get("kind", message.kind) != message.kind:
        raise _wrong("kind", f"these are the fields of a {message.kind} telegram, not of {given['kind']!r}")
    return message


def blind_spots(data: bytes, direction: Direction) -> frozenset[int]:
    """Return the positions where one wrong bit can go unnoticed: none, BCC covers STX, LGE and ADR too."""
    del data, direction
    return frozenset()


def titled_forms() -> dict[str, Form[Any]]:
    """Return the forms of all telegrams by the titles that people know them by, as most drives are set."""
    bare = UssOptions(pkw_words=0)
    return {
        "With parameter area, master": _form("request", "parameter", UssOptions()),
        "With parameter area, drive": _form("reply", "parameter", UssOptions()),
        "Process data only, master": _form("request", "process", bare),
        "Process data only, drive": _form("reply", "process", bare),
        "To all drives": _form("request", "broadcast", UssOptions()),
        "Mirror or special, master": _form("request", "data", UssOptions()),
        "Mirror or special, drive": _form("reply", "data", UssOptions()),
    }
