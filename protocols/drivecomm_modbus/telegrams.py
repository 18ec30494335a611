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
from struct import pack, unpack
from typing import TYPE_CHECKING, Any

from construct import this

from drivecomm.errors import TelegramError
from drivecomm.protocol.schema import Check, Form, Leaf, characters, choice, unsigned
from drivecomm_modbus import functions as fn
from drivecomm_modbus.messages import Reply, Request

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

ADDRESSES = range(1, 248)
BROADCAST = 0
_MEI = 14


def _crc_of_byte(byte: int) -> int:
    for _ in range(8):
        byte = byte >> 1 ^ (0xA001 if byte & 1 else 0)
    return byte


_CRC = tuple(map(_crc_of_byte, range(256)))


def crc16(covered: bytes) -> bytes:
    """Return the two check characters of a telegram."""
    crc = 0xFFFF
    for byte in covered:
        crc = crc >> 8 ^ _CRC[(crc ^ byte) & 0xFF]
    return bytes((crc & 0xFF, crc >> 8))


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


def _words(data: str) -> tuple[int, ...]:
    return unpack(f">{len(data) // 2}H", data.encode("latin-1"))


def _bits(data: str) -> tuple[int, ...]:
    return tuple(byte >> bit & 1 for byte in data.encode("latin-1") for bit in range(8))


def _whole(values: object, highest: int, name: str = "values") -> Sequence[int]:
    if values is None:
        raise wrong(name, "they are missing")
    if not isinstance(values, tuple) or any(type(each) is not int or not 0 <= each <= highest for each in values):
        raise wrong(name, f"{values!r} is no list of numbers from 0 to {highest}")
    return values


def _packed_words(values: object) -> str:
    words = _whole(values, 0xFFFF)
    return pack(f">{len(words)}H", *words).decode("latin-1")


def _packed_bits(values: object) -> str:
    bits = _whole(values, 1)
    data = bytearray((len(bits) + 7) // 8)
    for place, bit in enumerate(bits):
        data[place // 8] |= bit << place % 8
    return data.decode("latin-1")


def _written_bits(quantity: int, size: int, content: str) -> tuple[int, ...]:
    """Return the coils that are written; Hitachi rounds the byte count up to an even number."""
    needed = (quantity + 7) // 8
    if size not in (needed, needed + needed % 2):
        raise wrong("byte_count", f"{size} bytes do not hold {quantity} coils")
    return _bits(content)[:quantity]


def _written_words(quantity: int, size: int, content: str) -> tuple[int, ...]:
    if size != 2 * quantity:
        raise wrong("byte_count", f"{size} bytes do not hold {quantity} registers")
    return _words(content)


def _read_words(size: int, content: str) -> tuple[int, ...]:
    if size % 2 or not 0 < size <= 2 * fn.MOST_REGISTERS_READ:
        raise wrong("byte_count", f"{size} bytes are no registers")
    return _words(content)


def _read_bits(size: int, content: str) -> tuple[int, ...]:
    if not 0 < size <= fn.MOST_BITS_READ // 8:
        raise wrong("byte_count", f"{size} bytes are not what can be asked for")
    return _bits(content)


def _sized(pack_values: Callable[[object], str], most: int) -> Callable[[Any], tuple[int, str]]:
    def written(message: Reply) -> tuple[int, str]:
        values = message.values
        data = pack_values(values)
        if not values or len(values) > most or (pack_values is _packed_bits and len(values) % 8):
            raise wrong("values", f"{len(values or ())} of them are no reply to any request")
        return len(data), data

    return written


def _counted(pack_values: Callable[[object], str]) -> Callable[[Any], tuple[int, int, str]]:
    def written(message: Request) -> tuple[int, int, str]:
        data = pack_values(message.values)
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


_MOST_BYTES = 251


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
    numbers, texts = _whole(message.object_ids, 0xFF, "object_ids"), message.texts
    if not isinstance(texts, tuple) or len(texts) != len(numbers) or not all(isinstance(each, str) for each in texts):
        raise wrong("texts", "there is not one text for each of object_ids")
    try:
        encoded = [each.encode("latin-1") for each in texts]
        data = b"".join(bytes((number, len(each))) + each for number, each in zip(numbers, encoded, strict=True))
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


def _of(*forms: tuple[str, Form[Any], Sequence[int]]) -> Mapping[int, Form[Any]]:
    return {code: form for _, form, codes in forms for code in codes}


def _requests() -> list[tuple[str, Form[Any], Sequence[int]]]:
    table: list[tuple[str, Sequence[int], tuple[Any, ...], Any, Any]] = [
        ("Read bits", (1, 2), (_START, _count(fn.MOST_BITS_READ)), None, None),
        ("Read registers", (3, 4), (_START, _count(fn.MOST_REGISTERS_READ)), None, None),
        ("Write a coil", (5,), (_START, _COIL), None, None),
        ("Write a register", (6,), (_START, _VALUE), None, None),
        ("Diagnostics", (8,), (_SUB_FUNCTION, _VALUE), None, None),
        ("Event counter, report id", (0x0B, 0x11), (), None, None),
        (
            "Write coils",
            (0x0F,),
            (_START, _count(fn.MOST_BITS_WRITTEN, "quantity"), _SIZE, _CONTENT),
            {"values": _written_bits},
            {"quantity size content": _counted(_packed_bits)},
        ),
        (
            "Write registers",
            (0x10,),
            (_START, _count(fn.MOST_REGISTERS_WRITTEN, "quantity"), _SIZE, _CONTENT),
            {"values": _written_words},
            {"quantity size content": _counted(_packed_words)},
        ),
        (
            "Read and write registers",
            (0x17,),
            (
                _START,
                _count(fn.MOST_REGISTERS_READ),
                "write_start" / unsigned(2, "first register to write"),
                _count(fn.MOST_WRITTEN_WITH_A_READ, "quantity"),
                _SIZE,
                _CONTENT,
            ),
            {"values": _written_words},
            {"quantity size content": _counted(_packed_words)},
        ),
        (
            "Read identification",
            (0x2B,),
            (_MEI_TYPE, _READ_CODE, "object_id" / unsigned(1, "first object")),
            None,
            {"mei": _mei},
        ),
        ("Read 32 bits", (0x64,), (_START,), None, None),
        ("Write 32 bits", (0x65,), (_START, _LONG_VALUE), None, None),
    ]
    return [
        (title, _form(Request, codes, *leaves, reads=reads, writes=writes), codes)
        for title, codes, leaves, reads, writes in table
    ]


def _replies() -> list[tuple[str, Form[Any], Sequence[int]]]:
    bits, words = _sized(_packed_bits, fn.MOST_BITS_READ), _sized(_packed_words, fn.MOST_REGISTERS_READ)
    table: list[tuple[str, Sequence[int], tuple[Any, ...], Any, Any]] = [
        (
            "Bits, drive",
            (1, 2),
            (_SIZE, _CONTENT),
            {"values": _read_bits},
            {"size content": bits},
        ),
        (
            "Registers, drive",
            (3, 4, 0x17),
            (_SIZE, _CONTENT),
            {"values": _read_words},
            {"size content": words},
        ),
        ("Coil written, drive", (5,), (_START, _COIL), None, None),
        ("Register written, drive", (6,), (_START, _VALUE), None, None),
        ("Diagnostics, drive", (8,), (_SUB_FUNCTION, _VALUE), None, None),
        (
            "Event counter, drive",
            (0x0B,),
            ("status" / unsigned(2, "FFFF busy, 0 idle"), "event_count" / unsigned(2, "events")),
            None,
            None,
        ),
        ("Coils written, drive", (0x0F,), (_START, _count(fn.MOST_BITS_WRITTEN)), None, None),
        ("Registers written, drive", (0x10,), (_START, _count(fn.MOST_REGISTERS_WRITTEN)), None, None),
        (
            "Id, drive",
            (0x11,),
            (_SIZE, _CONTENT),
            {"data": _hexadecimal},
            {"size content": _bytes_of_data},
        ),
        ("32 bits, drive", (0x64,), (_LONG_VALUE,), None, None),
        ("32 bits written, drive", (0x65,), (_START, _LONG_VALUE), None, None),
    ]
    return [
        (title, _form(Reply, codes, *leaves, reads=reads, writes=writes), codes)
        for title, codes, leaves, reads, writes in table
    ]


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


_TITLED_REQUESTS, _TITLED_REPLIES = _requests(), _replies()
REQUESTS, REPLIES = _of(*_TITLED_REQUESTS), _of(*_TITLED_REPLIES)
EXCEPTION = _form(
    Reply, range(1, 128), "exception" / _number(1, range(1, 256), "why, 1 to 255"), bit_7=0x80
)  # fmt: skip


def titled_forms() -> dict[str, Form[Any]]:
    """Return the forms of all telegrams by title; of identifications, one of the many lengths."""
    forms = {title: form for title, form, _ in (*_TITLED_REQUESTS, *_TITLED_REPLIES)}
    return {**forms, "Identification, drive": identification_reply(45), "Exception, drive": EXCEPTION}
