"""Telegrams of Modbus RTU.

    address  function  data ...  CRC low  CRC high

The cyclic check is CRC-16, polynomial A001H reflected, start FFFFH, its low byte first (Danfoss FC 111 guide p. 114).
Only silence marks where a telegram begins and ends; its length follows from its function and, for some functions, from
a byte count. A refusal is the function with bit 7 set, and one byte with the reason.

Faults to expect: our own request handed back by a two-wire adapter, which for 05, 06 and 08 equals the reply byte for
byte; a late reply, because a reply to a read repeats only the length that its request implies.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

from construct import this

from drivecomm.protocol import schema
from drivecomm.protocol.schema import Form
from drivecomm_modbus import functions as fn
from drivecomm_modbus.messages import Reply, Request

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

ADDRESSES = range(1, 248)
EVERY_ADDRESS = range(1, 256)
BROADCAST = 0
_MEI = 14
_MOST_BYTES = 251


def _written_bits(quantity: int, size: int, content: str) -> tuple[int, ...]:
    """Return the coils that a request writes; Hitachi rounds the byte count up to an even number."""
    needed = (quantity + 7) // 8
    if size not in (needed, needed + needed % 2):
        raise schema.wrong_field("byte_count", f"{size} bytes do not hold {quantity} coils")
    return schema.bits_in(content)[:quantity]


def _written_words(quantity: int, size: int, content: str) -> tuple[int, ...]:
    if size != 2 * quantity:
        raise schema.wrong_field("byte_count", f"{size} bytes do not hold {quantity} registers")
    return schema.words_in(content)


def _values(
    most: int, step: int, cut: Callable[[str], tuple[int, ...]], packed: Callable[[object], str]
) -> dict[str, Any]:
    """Return the conversions for the values of a reply. most: bytes. step: bytes of a value, or of eight bits."""

    def read(size: int, content: str) -> tuple[int, ...]:
        if size % step or not 0 < size <= most:
            raise schema.wrong_field("byte_count", f"{size} bytes are not a permitted quantity")
        return cut(content)

    def written(message: Reply) -> tuple[int, str]:
        data, count = packed(message.values), len(message.values or ())
        if not 0 < len(data) <= most or len(cut(data)) != count:
            raise schema.wrong_field("values", f"{count} of them do not answer any request")
        return len(data), data

    return {"reads": {"values": read}, "writes": {"size content": written}}


def _counted(packed: Callable[[object], str]) -> Callable[[Any], tuple[int, int, str]]:
    def written(message: Request) -> tuple[int, int, str]:
        data = packed(message.values)
        return len(message.values or ()), len(data) & 0xFF, data

    return written


def _sized_bytes(message: Reply) -> tuple[int, str]:
    data = schema.bytes_as(message.data, "data", _MOST_BYTES)
    return len(data), data


def _objects(number: int, objects: str) -> tuple[tuple[int, ...], tuple[str, ...]]:
    ids, texts = schema.numbered_texts_in(objects)
    if len(ids) != number:
        raise schema.wrong_field("object_ids", f"{len(ids)} objects are there, {number} are announced")
    return ids, texts


_START = "start" / schema.unsigned(2, "first register or coil")
_VALUE = "value" / schema.unsigned(2, "value")
_COIL = "value" / schema.choice({b"\xff\x00": 1, b"\x00\x00": 0}, "FF00 on, 0000 off")
_LONG_VALUE = "value" / schema.unsigned(4, "value, 32 bits")
_SUB_FUNCTION = "sub_function" / schema.unsigned(2, "sub-function")
_SIZE = "size" / schema.unsigned(1, "byte count")
_CONTENT = "content" / schema.characters(this.size, lowest=0, highest=0xFF, meaning="data")
_MEI_TYPE = "mei" / schema.choice({bytes([_MEI]): _MEI}, "0E: read device identification")
_WRITE_START = "write_start" / schema.unsigned(2, "first register to write")
_OBJECT = "object_id" / schema.unsigned(1, "first object")
_STATUS, _EVENTS = "status" / schema.unsigned(2, "FFFF busy, 0 idle"), "event_count" / schema.unsigned(2, "events")
_READ_CODE = "read_code" / schema.whole(1, range(1, 5), "1 basic, 2 regular, 3 extended, 4 one object")


def _count(most: int, name: str = "count") -> Any:
    return name / schema.whole(2, range(1, most + 1), f"how many, 1 to {most}")


def _form(
    message: type[Any], addresses: range, codes: Sequence[int], *leaves: Any, bit_7: int = 0, **made: Any
) -> Form[Any]:
    """Return the form of telegrams with these functions. made: conversions between fields and leaves."""

    def check(given: Any) -> None:
        if given.address == BROADCAST and isinstance(given, Request) and given.function not in fn.BROADCASTS:
            raise schema.wrong_field(
                "address", "no drive answers a broadcast, so only writes can be sent to all drives"
            )

    known = range(addresses.stop) if message is Request else addresses
    return Form(
        message,
        "address" / schema.whole(1, known, "address; 0: all drives" if message is Request else "address"),
        "function"
        / schema.choice({bytes([code | bit_7]): code for code in codes}, ", ".join(f"{code:02X}" for code in codes)),
        *leaves,
        schema.CheckCharacters(2, 0, schema.crc16, meaning="CRC of all bytes before it, low byte first"),
        check=check,
        **made,
    )


_SOME = (_SIZE, _CONTENT)
_BITS = _values(fn.MOST_BITS_READ // 8, 1, schema.bits_in, schema.bits_as)
_WORDS = _values(2 * fn.MOST_REGISTERS_READ, 2, schema.words_in, schema.words_as)
_COILS = {"reads": {"values": _written_bits}, "writes": {"quantity size content": _counted(schema.bits_as)}}
_REGISTERS = {"reads": {"values": _written_words}, "writes": {"quantity size content": _counted(schema.words_as)}}
_Forms = dict[str, tuple[Sequence[int], tuple[Any, ...], dict[str, Any]]]

# By title: functions, leaves between function and CRC, and conversions between these and the message's fields.
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
    "Read identification": ((0x2B,), (_MEI_TYPE, _READ_CODE, _OBJECT), {"writes": {"mei": lambda _message: _MEI}}),
    "Read 32 bits": ((0x64,), (_START,), {}),
    "Write 32 bits": ((0x65,), (_START, _LONG_VALUE), {}),
}
_REPLIES: _Forms = {
    "Bits, drive": ((1, 2), _SOME, _BITS),
    "Registers, drive": ((3, 4, 0x17), _SOME, _WORDS),
    "Coil written, drive": ((5,), (_START, _COIL), {}),
    "Register written, drive": ((6,), (_START, _VALUE), {}),
    "Diagnostics, drive": ((8,), (_SUB_FUNCTION, _VALUE), {}),
    "Event counter, drive": ((0x0B,), (_STATUS, _EVENTS), {}),
    "Coils written, drive": ((0x0F,), (_START, _count(fn.MOST_BITS_WRITTEN)), {}),
    "Registers written, drive": ((0x10,), (_START, _count(fn.MOST_REGISTERS_WRITTEN)), {}),
    "Id, drive": ((0x11,), _SOME, {"reads": {"data": schema.bytes_in}, "writes": {"size content": _sized_bytes}}),
    "32 bits, drive": ((0x64,), (_LONG_VALUE,), {}),
    "32 bits written, drive": ((0x65,), (_START, _LONG_VALUE), {}),
    "Exception, drive": (
        range(1, 128),
        ("exception" / schema.whole(1, range(1, 256), "why, 1 to 255"),),
        {"bit_7": 0x80},
    ),
}


@cache
def identification_reply(addresses: range, size: int) -> Form[Any]:
    """Return the form of an identification whose objects have this size in bytes, including numbers and lengths."""
    return _form(
        Reply,
        addresses,
        (0x2B,),
        _MEI_TYPE,
        _READ_CODE,
        "conformity" / schema.unsigned(1, "conformity level"),
        "more_follows" / schema.choice({b"\x00": 0, b"\xff": 1}, "FF: more objects follow"),
        "next_object" / schema.unsigned(1, "where they follow"),
        "number" / schema.unsigned(1, "number of objects"),
        "objects" / schema.characters(size, lowest=0, highest=0xFF, meaning="each: number, length, text"),
        reads={"object_ids texts": _objects},
        writes={
            "mei": lambda _message: _MEI,
            "number": lambda message: len(message.object_ids or ()),
            "objects": lambda each: schema.numbered_texts_as(each.object_ids, each.texts, "object_ids", "texts"),
        },
    )


@cache
def titled_forms(addresses: range = ADDRESSES) -> Mapping[str, Form[Any]]:
    """Return the forms of all telegrams by title; for identifications, only one of their many lengths."""
    tables: tuple[tuple[type[Any], _Forms], ...] = (Request, _REQUESTS), (Reply, _REPLIES)
    forms = {
        title: _form(kind, addresses, codes, *leaves, **fields)
        for kind, table in tables
        for title, (codes, leaves, fields) in table.items()
    }
    return {**forms, "Identification, drive": identification_reply(addresses, 45)}


TITLES = {
    direction: {code | fields.get("bit_7", 0): title for title, (codes, _, fields) in table.items() for code in codes}
    for direction, table in (("request", _REQUESTS), ("reply", _REPLIES))
}
"""Titles of the forms, by direction and by the function as it appears in a telegram."""
