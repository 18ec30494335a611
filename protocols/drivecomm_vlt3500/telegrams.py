"""The telegram of VLT Series 3500: 22 characters in both directions.

VLT Series 3500 manual, printed pages 85 to 92; VLT 3000 manual MG.30.A7.02, pages 73 to 80; nearly the same on VLT 2000
(manual MG.20.B6.02, pages 54 to 56). Bytes are numbered from 1, as there.

    <  a a  k  w w w w  p p p p  s  d d d d d  e  c c  >
    1  2    4  5        9        13 14         19 20   22

a: address, 00 for all drives. k: U update, R read, C control, I read index. w: control word in a request, status word
in a reply, byte 5 holds bits 0 to 3; `@` is 0, `O` is 15, and in a request `P` leaves its four bits as they are. p:
parameter. s: `-`, every other character is plus. d: data without a point. e: number of digits after the point; 9 in a
reply is a refusal with its cause in bytes 17 and 18. c: the sum of the codes of bytes 2 to 19, its last two decimal
digits; `??` switches the check off. Nothing follows the `>`.

Faults to expect: a wrong sum, a cut telegram, a reply of another drive, our own telegram handed back (two-wire
adapters, the echo chain of VLT 2000). The sum detects neither exchanged digits nor a difference of 100. No two
characters that a field may hold are 100 apart, but byte 13 may hold any character, and there `-` can become 91H, a
plus. `mismatch` therefore refuses a reply whose byte 13 has bit 7 set.
"""

from __future__ import annotations

from functools import cache, partial
from typing import TYPE_CHECKING, Any

from drivecomm.errors import TelegramError
from drivecomm.protocol.schema import (
    CheckCharacters,
    Form,
    Leaf,
    Telegrams,
    characters,
    choice,
    constant,
    deciding,
    decimal_number,
    decimal_sum,
    wrong_field,
)
from drivecomm_vlt3500.messages import Control, ControlReply, Read, ReadIndex, Reply, Update
from drivecomm_vlt3500.parameters import DECIMALS, number, packed, unpacked

if TYPE_CHECKING:
    from collections.abc import Mapping
    from decimal import Decimal

    from drivecomm_vlt3500.messages import ReplyKind

LENGTH = 22
START, STOP = b"<", b">"
UNCHECKED = b"??"
BROADCAST = 0
ADDRESSES = range(1, 100)
PARAMETERS = range(10_000)
HOLD = 0x50
REFUSED = 9


def _must_have_seven_bits(found: bytes) -> None:
    if not found.isascii():
        raise ValueError(f"{found!r} has bit 7 set; is one end set to 7 data bits with parity?")


_LETTERS = bytes(range(0x40, 0x50))
_DIGIT_OF_ANY = bytes(b"0123456789ABCDEF"[code & 0xF] for code in range(256))
_LETTER_OF_DIGIT = bytes.maketrans(b"0123456789ABCDEF", _LETTERS)


def _word(letters: bytes) -> int:
    """Return the word in the low four bits of four characters, the lowest group first."""
    return int(letters.translate(_DIGIT_OF_ANY)[::-1], 16)


def _letters(word: Any) -> bytes:
    if type(word) is not int or word not in range(0x10000):
        raise ValueError(f"{word!r} is not a word of 16 bits")
    return (b"%04X" % word)[::-1].translate(_LETTER_OF_DIGIT)


def _control_word() -> Leaf:
    """Return the leaf of a control word: four characters with four bits each.

    `P` leaves a group as it is, and may occur in any byte but 7.
    """

    def parse(found: bytes) -> tuple[int, int | None]:
        _must_have_seven_bits(found)
        if HOLD not in found:
            return _word(found), None
        return _word(found), sum(0xF << 4 * group for group, code in enumerate(found) if code != HOLD)

    def write(given: tuple[Any, Any]) -> bytes:
        word, mask = given
        letters = _letters(word)
        if mask is None:
            return letters
        groups = _letters(mask)
        if groups.translate(None, b"@O"):
            raise ValueError(f"mask {mask:04X}H holds part of a group; only whole groups of four bits can be held")
        if groups[2:3] == b"@":
            raise ValueError("holding byte 7 would leave the validity of the word undefined (bit 10)")
        if word & ~mask:
            raise ValueError(f"control word {word:04X}H has bits that mask {mask:04X}H holds")
        return bytes(letter if group & 0xF else HOLD for letter, group in zip(letters, groups, strict=True))

    return Leaf(4, parse, write, meaning="control word, bits 0-3 first, `@` = 0 to `O` = 15, `P` = leave as it is")


def _status_word(*, lenient: bool) -> Leaf:
    def parse(found: bytes) -> int:
        _must_have_seven_bits(found)
        if not lenient and found.translate(None, _LETTERS):
            raise ValueError(f"{found!r} holds a character outside `@` to `O`")
        return _word(found)

    return Leaf(4, parse, _letters, meaning="status word, bits 0-3 first, `@` = 0 to `O` = 15")


def _form(
    message: type[Any],
    kinds: Mapping[bytes, str],
    *rest: Any,
    reads: Mapping[str, Any],
    writes: Mapping[str, Any],
    addresses: range = ADDRESSES,
    **more: Any,
) -> Form[Any]:
    """Return the form of a telegram with these leaves behind the control character."""
    return Form(
        message,
        constant(START, "start"),
        "address" / decimal_number(2, addresses, "address"),
        "kind" / deciding(choice(kinds, "control character " + ", ".join(kind.decode() for kind in kinds))),
        *rest,
        "check"
        / CheckCharacters(
            2, 1, decimal_sum, off=UNCHECKED, meaning="sum of bytes 2-19, last two digits; `??` for none"
        ),
        constant(STOP, "stop"),
        reads={"unchecked": lambda check: True if check == UNCHECKED else None, **reads},
        writes={"check": lambda message: UNCHECKED if message.unchecked else None, **writes},
        **more,
    )


def _request(
    message: type[Any],
    kind: bytes,
    *rest: Any,
    writes: Mapping[str, Any],
    reads: Mapping[str, Any] | None = None,
    **more: Any,
) -> Form[Any]:
    return _form(
        message,
        {kind: message.kind},
        "control_word" / _control_word(),
        *rest,
        reads={"control_word control_mask": lambda control_word: control_word, **(reads or {})},
        writes={"control_word": lambda message: (message.control_word, message.control_mask), **writes},
        addresses=range(100),
        **more,
    )


def _not_to_all(message: Read | ReadIndex) -> None:
    if message.address == BROADCAST:
        raise wrong_field("address", "a read cannot be a broadcast, because no drive would answer")


def _value(sign: str, digits: str, decimals: int) -> Decimal:
    try:
        return unpacked(negative=sign == "-", digits=digits, decimals=decimals)
    except ValueError as error:
        raise TelegramError("field", f"data value: {error}", field="value") from None


def _odd_sign(sign: str) -> str | None:
    return None if sign in "+-" else sign


def _packed_value(message: Update | Reply) -> tuple[str, str, int]:
    try:
        value = number(message.value)
        digits, decimals = packed(value, message.decimals)
        sign = "-" if value < 0 else "+"
        if message.sign is not None:
            if value < 0 or message.sign == "-":
                raise ValueError(f"{value} cannot have the sign {message.sign!r}")  # noqa: TRY301
            sign = message.sign
    except ValueError as error:
        raise TelegramError("field", f"{message.kind} telegram, value: {error}", field="value") from None
    return sign, f"{digits:05d}", decimals


def _index(digits: str, decimals: int) -> tuple[int, ...]:
    if not digits.isdigit():
        raise TelegramError("field", f"index: {digits!r} are not five decimal digits", field="index")
    x, y = digits[: 5 - decimals], digits[5 - decimals :]
    return (int(x),) if decimals == 0 else (int(x or 0), int(y))


def _packed_index(message: ReadIndex) -> tuple[str, str, int]:
    index = message.index
    limits = {1: (100_000,), 2: (1_000, 100)}.get(len(index), ()) if isinstance(index, tuple | list) else ()
    if not limits or any(type(n) is not int or n not in range(limit) for n, limit in zip(index, limits, strict=True)):
        raise TelegramError("field", f"index {index!r} is neither 0 to 99999 nor (0 to 999, 0 to 99)", field="index")
    decimals = 0 if len(index) == 1 else 2
    if message.decimals not in (None, decimals):
        raise TelegramError("field", f"an index of this form is sent with byte 19 = {decimals}", field="decimals")
    return "+", f"{index[0]:05d}" if decimals == 0 else f"{index[0]:03d}{index[1]:02d}", decimals


def _unused(filler_parameter: str, sign: str, filler: str) -> tuple[int | None, str | None]:
    """Return parameter and filler of a telegram in which both have no meaning."""
    parameter, data = filler_parameter, sign + filler
    is_number = parameter.isdigit()
    return int(parameter) if is_number else None, None if is_number and data == "+000000" else parameter + data


def _packed_unused(message: Control | ControlReply) -> tuple[str, str, str]:
    parameter = 0 if message.parameter is None else message.parameter
    if type(parameter) is not int or parameter not in PARAMETERS:
        raise TelegramError("field", f"control telegram, parameter {parameter!r} is not 0 to 9999", field="parameter")
    filler = f"{parameter:04d}+000000" if message.filler is None else message.filler
    if not isinstance(filler, str) or len(filler) != 11 or not (filler[:4] + filler[5:]).isascii():
        raise TelegramError("field", f"control telegram, filler {filler!r} is not 11 characters", field="filler")
    if filler[:4] != f"{parameter:04d}" and (parameter or filler[:4].isdigit()):
        raise TelegramError("field", f"filler {filler!r} is for another parameter than {parameter}", field="filler")
    if ord(filler[4]) > 0xFF:
        raise TelegramError("field", f"control telegram, {filler[4]!r} is not a character of one byte", field="filler")
    return filler[:4], filler[4], filler[5:]


_characters = partial(characters, lowest=0, highest=0x7F)
_PARAMETER = "parameter" / decimal_number(4, meaning="parameter")
_SIGN = "sign" / characters(1, lowest=0, highest=0xFF, meaning="`-`, every other character is plus")
_DIGITS = "digits" / _characters(5, meaning="data value: five digits, leading zeros, no point")
_POINT = "decimals" / decimal_number(1, DECIMALS, "digits after the point, 0 to 5")
_INDEX_POINT = "decimals" / decimal_number(1, DECIMALS, "0: one index; 1 to 5: as many digits are y")
_FILLER = "filler" / _characters(6, meaning="not looked at")
_UNUSED = ("filler_parameter" / _characters(4, meaning="not looked at"), _SIGN, _FILLER)
_ANSWERED: dict[bytes, ReplyKind] = {b"U": "update", b"R": "read", b"I": "read_index"}
_VALUE: dict[str, Any] = {
    "reads": {"value": _value, "sign": _odd_sign},
    "writes": {"sign digits decimals": _packed_value},
}
_NO_VALUE: dict[str, Any] = {
    "reads": {"parameter filler": _unused},
    "writes": {"filler_parameter sign filler": _packed_unused},
}

REQUESTS = {
    "U, update": _request(Update, b"U", _PARAMETER, _SIGN, _DIGITS, _POINT, **_VALUE),
    "R, read": _request(
        *(Read, b"R", _PARAMETER, _SIGN, _FILLER), writes={"sign filler": lambda _: ("+", "000000")}, check=_not_to_all
    ),
    "I, read index": _request(
        *(ReadIndex, b"I", _PARAMETER, _SIGN, _DIGITS, _INDEX_POINT),
        reads={"index": _index},
        writes={"sign digits decimals": _packed_index},
        check=_not_to_all,
    ),
    "C, control": _request(Control, b"C", *_UNUSED, **_NO_VALUE),
}


@cache
def telegrams(*, lenient: bool = False) -> Telegrams:
    """Return the codec. Inside a telegram `<` and `>` have no special meaning; byte 13 may be either.

    lenient: use the low four bits of any character in a status word.
    """
    word = "status_word" / _status_word(lenient=lenient)
    refused = (
        "filler" / _characters(3, meaning="not looked at"),
        "fault_code" / decimal_number(2, meaning="cause"),
        "refused" / deciding(decimal_number(1, (REFUSED,), "9: refused")),
    )
    replies = {
        "Reply to U, R, I with a value": _form(Reply, _ANSWERED, word, _PARAMETER, _SIGN, _DIGITS, _POINT, **_VALUE),
        "Reply to U, R, I with a refusal": _form(
            Reply,
            _ANSWERED,
            *(word, _PARAMETER, _SIGN, *refused),
            reads={"sign": _odd_sign},
            writes={"sign filler refused": lambda message: (message.sign or "+", "000", REFUSED)},
            when=lambda message: message.fault_code is not None,
        ),
        "Reply to C": _form(ControlReply, {b"C": "control"}, word, *_UNUSED, **_NO_VALUE),
    }
    return Telegrams(REQUESTS, replies, alike=("vlt3500", lenient))
