"""The telegrams of Modbus RTU.

    address  function  data ...  CRC low  CRC high

The cyclic check is CRC-16, polynomial A001H reflected, start FFFFH, its low byte first (Danfoss FC 111 guide p. 114).
Nothing marks where a telegram begins or ends but silence; how long it is follows from its function and the byte count
that some have. A refusal is the function with bit 7 set, and one byte that says why.

Faults to expect: our own request handed back by a two-wire adapter, which for 05, 06 and 08 is the reply byte for byte;
a late reply, since a reply to a read repeats nothing of the request but its length.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

from construct import this

from drivecomm.errors import TelegramError
from drivecomm.protocol.schema import (
    Check,
    Form,
    Leaf,
    bits_as,
    bits_in,
    characters,
    choice,
    crc16,
    numbers,
    unsigned,
    words_as,
    words_in,
)
from drivecomm_modbus import functions as fn
from drivecomm_modbus.messages import Reply, Request

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

ADDRESSES = range(1, 248)
BROADCAST = 0
_MEI = 14
_MOST_BYTES = 251


def wrong(field: str, text: str) -> TelegramError:
    """Return the error for a field that holds what it may not."""
    return TelegramError("field", f"{field}: {text}", field=field)


def _number(size: int, allowed: range, meaning: str) -> Leaf:
    def checked(value: Any) -> int:
        if type(value) is not int or value not in allowed:
            raise ValueError(f"{value!r} is not {allowed.start} to {allowed.stop - 1}")
        return value

    def parse(found: bytes) -> int:
        return checked(int.from_bytes(found, "big"))

    return Leaf(size, parse, lambda value: checked(value).to_bytes(size, "big"), meaning=meaning)


def _written_bits(quantity: int, size: int, content: str) -> tuple[int, ...]:
    """Return the coils that are written; Hitachi rounds the byte count up to an even number."""
    needed = (quantity + 7) // 8
    if size not in (needed, needed + needed % 2):
        raise wrong("byte_count", f"{size} bytes do not hold {quantity} coils")
    return bits_in(content)[:quantity]


def _written_words(quantity: int, size: int, content: str) -> tuple[int, ...]:
    if size != 2 * quantity:
        raise wrong("byte_count", f"{size} bytes do not hold {quantity} registers")
    return words_in(content)


def _read_words(size: int, content: str) -> tuple[int, ...]:
    if size % 2 or not 0 < size <= 2 * fn.MOST_REGISTERS_READ:
        raise wrong("byte_count", f"{size} bytes are no registers")
    return words_in(content)


def _read_bits(size: int, content: str) -> tuple[int, ...]:
    if not 0 < size <= fn.MOST_BITS_READ // 8:
        raise wrong("byte_count", f"{size} bytes are not what can be asked for")
    return bits_in(content)


def _sized(packed: Callable[[object], str], most: int, step: int = 1) -> Callable[[Any], tuple[int, str]]:
    """Return what writes the values of a reply, with their byte count. step: they come in multiples of it."""

    def written(message: Reply) -> tuple[int, str]:
        data, count = packed(message.values), len(message.values or ())
        if not 0 < count <= most or count % step:
            raise wrong("values", f"{count} of them are no reply to any request")
        return len(data), data

    return written


def _counted(packed: Callable[[object], str]) -> Callable[[Any], tuple[int, int, str]]:
    def written(message: Request) -> tuple[int, int, str]:
        data = packed(message.values)
        return len(message.values or ()), len(data) & 0xFF, data

    return written


def _hexadecimal(content: str) -> str:
    return content.encode("latin-1").hex(" ").upper()


def _bytes_of_data(message: Reply) -> tuple[int, str]:
    try:
        data = bytes.fromhex(str(message.data))
    except ValueError:
        what = "they are missing" if message.data is None else f"{message.data!r} are no hexadecimal bytes"
        raise wrong("data", what) from None
    if len(data) > _MOST_BYTES:
        raise wrong("data", f"{len(data)} bytes are more than fit")
    return len(data), data.decode("latin-1")


def _objects(number: int, objects: str) -> tuple[tuple[int, ...], tuple[str, ...]]:
    numbers, texts, place = [], [], 0
    while place + 2 <= len(objects):
        size = ord(objects[place + 1])
        numbers.append(ord(objects[place]))
        texts.append(objects[place + 2 : place + 2 + size])
        place += 2 + size
    if len(numbers) != number:
        raise wrong("object_ids", f"{len(numbers)} objects are there, {number} are announced")
    return tuple(numbers), tuple(texts)


def _packed_objects(message: Reply) -> str:
    ids, texts = numbers(message.object_ids, 0xFF, "object_ids"), message.texts
    if not isinstance(texts, tuple) or len(texts) != len(ids) or not all(isinstance(each, str) for each in texts):
        raise wrong("texts", "there is not one text for each of object_ids")
    try:
        encoded = [each.encode("latin-1") for each in texts]
        data = b"".join(bytes((number, len(each))) + each for number, each in zip(ids, encoded, strict=True))
    except ValueError:
        raise wrong("texts", "a text is too long, or is not made of ISO 8859-1") from None
    return data.decode("latin-1")


_START = "start" / unsigned(2, "first register or coil")
_VALUE = "value" / unsigned(2, "value")
_COIL = "value" / choice({b"\xff\x00": 1, b"\x00\x00": 0}, "FF00 on, 0000 off")
_LONG_VALUE = "value" / unsigned(4, "value, 32 bits")
_SUB_FUNCTION = "sub_function" / unsigned(2, "sub-function")
_SIZE = "size" / unsigned(1, "byte count")
_CONTENT = "content" / characters(this.size, lowest=0, highest=0xFF, meaning="data")
_MEI_TYPE = "mei" / choice({bytes([_MEI]): _MEI}, "0E: read device identification")
_WRITE_START = "write_start" / unsigned(2, "first register to write")
_OBJECT = "object_id" / unsigned(1, "first object")
_STATUS, _EVENTS = "status" / unsigned(2, "FFFF busy, 0 idle"), "event_count" / unsigned(2, "events")
_READ_CODE = "read_code" / _number(1, range(1, 5), "1 basic, 2 regular, 3 extended, 4 one object")


def _count(most: int, name: str = "count") -> Any:
    return name / _number(2, range(1, most + 1), f"how many, 1 to {most}")


def _mei(_message: Any) -> int:
    return _MEI


def _form(
    message: type[Any], codes: Sequence[int], *leaves: Any, reads: Any = None, writes: Any = None, bit_7: int = 0
) -> Form[Any]:
    own = {name for each in (reads or {}) for name in each.split()}
    own |= {leaf.name for leaf in leaves} | {"address", "function"}
    others = [name for name in message.__dataclass_fields__ if name not in own]

    def check(given: Any) -> None:
        if strange := next((name for name in others if getattr(given, name) is not None), None):
            raise wrong(strange, f"a {given.kind} telegram has no such field")
        if given.address == BROADCAST and isinstance(given, Request) and given.function not in fn.BROADCASTS:
            raise wrong("address", "nobody answers a broadcast, so only writes can be sent to all drives")

    addresses = range(248) if message is Request else ADDRESSES
    return Form(
        message,
        "address" / _number(1, addresses, "address; 0: all drives" if message is Request else "address"),
        "function"
        / choice({bytes([code | bit_7]): code for code in codes}, ", ".join(f"{code:02X}" for code in codes)),
        *leaves,
        Check(2, 0, crc16, meaning="CRC of all bytes before it, low byte first"),
        reads=reads,
        writes=writes,
        check=check,
    )


_SOME = (_SIZE, _CONTENT)
_BITS, _WORDS = {"values": _read_bits}, {"values": _read_words}
_COILS = {"reads": {"values": _written_bits}, "writes": {"quantity size content": _counted(bits_as)}}
_REGISTERS = {"reads": {"values": _written_words}, "writes": {"quantity size content": _counted(words_as)}}
_Forms = dict[str, tuple[tuple[int, ...], tuple[Any, ...], dict[str, Any]]]

# By title: the functions, the leaves between function and CRC, and how fields of the message are made of them.
_REQUESTS: _Forms = {
    "Read bits": ((1, 2), (_START, _count(fn.MOST_BITS_READ)), {}),
    "Read registers": ((3, 4), (_START, _count(fn.MOST_REGISTERS_READ)), {}),
    "Write a coil": ((5,), (_START, _COIL), {}),
    "Write a register": ((6,), (_START, _VALUE), {}),
    "Diagnostics": ((8,), (_SUB_FUNCTION, _VALUE), {}),
    "Event counter, report id": ((0x0B, 0x11), (), {}),
    "Write coils": ((0x0F,), (_START, _count(fn.MOST_BITS_WRITTEN, "quantity"), *_SOME), _COILS),
    "Write registers": ((0x10,), (_START, _count(fn.MOST_REGISTERS_WRITTEN, "quantity"), *_SOME), _REGISTERS),
    "Read and write registers": (
        (0x17,),
        (_START, _count(fn.MOST_REGISTERS_READ), _WRITE_START, _count(fn.MOST_WRITTEN_WITH_A_READ, "quantity"), *_SOME),
        _REGISTERS,
    ),
    "Read identification": ((0x2B,), (_MEI_TYPE, _READ_CODE, _OBJECT), {"writes": {"mei": _mei}}),
    "Read 32 bits": ((0x64,), (_START,), {}),
    "Write 32 bits": ((0x65,), (_START, _LONG_VALUE), {}),
}
_REPLIES: _Forms = {
    "Bits, drive": (
        (1, 2), _SOME, {"reads": _BITS, "writes": {"size content": _sized(bits_as, fn.MOST_BITS_READ, step=8)}},
    ),
    "Registers, drive": (
        (3, 4, 0x17), _SOME, {"reads": _WORDS, "writes": {"size content": _sized(words_as, fn.MOST_REGISTERS_READ)}},
    ),
    "Coil written, drive": ((5,), (_START, _COIL), {}),
    "Register written, drive": ((6,), (_START, _VALUE), {}),
    "Diagnostics, drive": ((8,), (_SUB_FUNCTION, _VALUE), {}),
    "Event counter, drive": ((0x0B,), (_STATUS, _EVENTS), {}),
    "Coils written, drive": ((0x0F,), (_START, _count(fn.MOST_BITS_WRITTEN)), {}),
    "Registers written, drive": ((0x10,), (_START, _count(fn.MOST_REGISTERS_WRITTEN)), {}),
    "Id, drive": ((0x11,), _SOME, {"reads": {"data": _hexadecimal}, "writes": {"size content": _bytes_of_data}}),
    "32 bits, drive": ((0x64,), (_LONG_VALUE,), {}),
    "32 bits written, drive": ((0x65,), (_START, _LONG_VALUE), {}),
}  # fmt: skip


@cache
def identification_reply(size: int) -> Form[Any]:
    """Return the form of an identification whose objects have so many bytes, their numbers and lengths with them."""
    return _form(
        Reply,
        (0x2B,),
        _MEI_TYPE,
        _READ_CODE,
        "conformity" / unsigned(1, "conformity level"),
        "more_follows" / choice({b"\x00": 0, b"\xff": 1}, "FF: more objects follow"),
        "next_object" / unsigned(1, "where they follow"),
        "number" / unsigned(1, "number of objects"),
        "objects" / characters(size, lowest=0, highest=0xFF, meaning="each: number, length, text"),
        reads={"object_ids texts": _objects},
        writes={"mei": _mei, "number": lambda message: len(message.object_ids or ()), "objects": _packed_objects},
    )


def _made(kind: type[Any], table: _Forms) -> dict[str, tuple[tuple[int, ...], Form[Any]]]:
    return {title: (codes, _form(kind, codes, *leaves, **fields)) for title, (codes, leaves, fields) in table.items()}


_TITLED = [_made(Request, _REQUESTS), _made(Reply, _REPLIES)]
REQUESTS, REPLIES = ({code: form for codes, form in made.values() for code in codes} for made in _TITLED)
EXCEPTION = _form(Reply, range(1, 128), "exception" / _number(1, range(1, 256), "why, 1 to 255"), bit_7=0x80)


def titled_forms() -> dict[str, Form[Any]]:
    """Return the forms of all telegrams by title; of identifications, one of the many lengths."""
    forms = {title: form for made in _TITLED for title, (_, form) in made.items()}
    return {**forms, "Identification, drive": identification_reply(45), "Exception, drive": EXCEPTION}
