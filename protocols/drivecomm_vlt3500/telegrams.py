"""The telegram of VLT Series 3500: 22 characters, both ways.

VLT Series 3500 manual, printed pages 85 to 92; VLT 3000 manual MG.30.A7.02, pages 73 to 80; nearly the same on VLT 2000
(manual MG.20.B6.02, pages 54 to 56). Bytes are numbered from 1, as there.

    <  a a  k  w w w w  p p p p  s  d d d d d  e  c c  >
    1  2    4  5        9        13 14         19 20   22

a: address, 00 for all drives. k: U update, R read, C control, I read index. w: control word in a request, status word
in a reply, byte 5 holds bits 0 to 3; `@` is 0, `O` is 15, and in a request `P` leaves its four bits as they are. p:
parameter. s: `-`, every other character is plus. d: data without a point. e: how many digits stand after the point; 9
in a reply is a refusal with its cause in bytes 17 and 18. c: the sum of the codes of bytes 2 to 19, its last two
decimal digits; `??` switches the check off. Nothing follows the `>`.

Faults to expect: a wrong sum, a cut telegram, a reply of another drive, our own telegram handed back (two-wire
adapters, the echo chain of VLT 2000). The sum does not see digits that changed places, and it takes 100 more or less
for nothing: no two characters that a field may hold are 100 apart, but byte 13 may hold any, and there `-` can become
91H, a plus. `mismatch` therefore refuses a reply whose byte 13 has bit 7 set.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.errors import TelegramError
from drivecomm.protocol.schema import Check, Form, Leaf, choice, constant, decimal_number, decimal_sum
from drivecomm_vlt3500.messages import Control, ControlReply, Read, ReadIndex, Reply, Update
from drivecomm_vlt3500.values import DECIMALS, number, packed, unpacked

if TYPE_CHECKING:
    from collections.abc import Mapping
    from decimal import Decimal

    from drivecomm_vlt3500.messages import ReplyKind, Request

LENGTH = 22
START, STOP = b"<", b">"
UNCHECKED = b"??"
BROADCAST = 0
ADDRESSES = range(1, 100)
PARAMETERS = range(10_000)
HOLD = 0x50
REFUSED = 9


def _seven_bits(found: bytes) -> str:
    if not found.isascii():
        raise ValueError(f"{found!r} has bit 7 set; is one end set to 7 data bits with parity?")
    return found.decode("ascii")


def _write_text(text: Any) -> bytes:
    if not isinstance(text, str):
        raise TypeError(f"{text!r} is not text")
    return text.encode("latin-1")


def _text(size: int, meaning: str) -> Leaf:
    """Seven-bit characters, looked at later or not at all."""
    return Leaf(size, _seven_bits, _write_text, meaning=meaning)


def _any_sign() -> Leaf:
    return Leaf(1, lambda found: found.decode("latin-1"), _write_text, meaning="`-`, every other character is plus")


_WORDS = range(0x10000)
_LETTERS = bytes(range(0x40, 0x50))
_DIGIT_OF_ANY = bytes(b"0123456789ABCDEF"[code & 0xF] for code in range(256))
_LETTER_OF_DIGIT = bytes.maketrans(b"0123456789ABCDEF", _LETTERS)


def _word(letters: bytes) -> int:
    """Return the word in the low four bits of four characters, the lowest group first."""
    return int(letters.translate(_DIGIT_OF_ANY)[::-1], 16)


def _letters(word: int) -> bytes:
    return (b"%04X" % word)[::-1].translate(_LETTER_OF_DIGIT)


def _control_word() -> Leaf:
    """Four characters, low four bits each; `P` leaves a group as it is, and may stand in any byte but 7."""

    def parse(found: bytes) -> tuple[int, int | None]:
        _seven_bits(found)
        if HOLD not in found:
            return _word(found), None
        word = mask = 0
        for group, code in enumerate(found):
            if code != HOLD:
                word |= (code & 0xF) << 4 * group
                mask |= 0xF << 4 * group
        return word, None if mask == 0xFFFF else mask

    def write(given: tuple[Any, Any]) -> bytes:
        if given[1] is None and type(given[0]) is int and given[0] in _WORDS:
            return _letters(given[0])
        word, mask = given[0], 0xFFFF if given[1] is None else given[1]
        for each in (word, mask):
            if type(each) is not int or each not in range(0x10000):
                raise ValueError(f"{each!r} is no word of 16 bits")
        groups = [mask >> shift & 0xF for shift in range(0, 16, 4)]
        if any(group not in (0, 0xF) for group in groups):
            raise ValueError(f"mask {mask:04X}H holds part of a group; only whole groups of four bits can be held")
        if not groups[2]:
            raise ValueError("holding byte 7 would leave it open whether the word is valid (bit 10)")
        if word & ~mask:
            raise ValueError(f"control word {word:04X}H has bits that mask {mask:04X}H holds")
        return bytes(0x40 | word >> 4 * place & 0xF if group else HOLD for place, group in enumerate(groups))

    return Leaf(4, parse, write, meaning="control word, bits 0-3 first, `@` = 0 to `O` = 15, `P` = leave as it is")


def _status_word(*, lenient: bool) -> Leaf:
    def parse(found: bytes) -> int:
        _seven_bits(found)
        if not lenient and found.translate(None, _LETTERS):
            raise ValueError(f"{found!r} holds a character outside `@` to `O`")
        return _word(found)

    def write(word: Any) -> bytes:
        if type(word) is not int or word not in _WORDS:
            raise ValueError(f"{word!r} is no word of 16 bits")
        return _letters(word)

    return Leaf(4, parse, write, meaning="status word, bits 0-3 first, `@` = 0 to `O` = 15")


def _frame(kinds: Mapping[bytes, str], word: Any, *rest: Any, addresses: range = ADDRESSES) -> tuple[Any, ...]:
    return (
        constant(START, "start"),
        "address" / decimal_number(2, addresses, "address"),
        "kind" / choice(dict(kinds), "control character " + ", ".join(kind.decode() for kind in kinds)),
        word,
        *rest,
        "check" / Check(2, 1, decimal_sum, off=UNCHECKED, meaning="sum of bytes 2-19, last two digits; `??` for none"),
        constant(STOP, "stop"),
    )


def _request(kind: bytes, name: str, *rest: Any) -> tuple[Any, ...]:
    # One drive or all of them; that R and I to all make no sense is for the encoder to say.
    return _frame({kind: name}, "control_word" / _control_word(), *rest, addresses=range(100))


_PARAMETER = "parameter" / decimal_number(4, meaning="parameter")
_DIGITS = "digits" / _text(5, "data value: five digits, leading zeros, no point")
_IGNORED = ("filler_parameter" / _text(4, "not looked at"), "sign" / _any_sign(), "filler" / _text(6, "not looked at"))
_ANSWERED: dict[bytes, ReplyKind] = {b"U": "update", b"R": "read", b"I": "read_index"}


def _switched_off(check: bytes) -> bool | None:
    return True if check == UNCHECKED else None


def _check_of(message: Any) -> bytes | None:
    return UNCHECKED if message.unchecked else None


def _word_and_mask(control_word: tuple[int, int | None]) -> tuple[int, int | None]:
    return control_word


def _masked_word(message: Request) -> tuple[int, int | None]:
    return message.control_word, message.control_mask


_READS: dict[str, Any] = {"unchecked": _switched_off}
_WRITES: dict[str, Any] = {"check": _check_of}
_READS_REQUEST: dict[str, Any] = {**_READS, "control_word control_mask": _word_and_mask}
_WRITES_REQUEST: dict[str, Any] = {**_WRITES, "control_word": _masked_word}


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


_READS_VALUE: dict[str, Any] = {"value": _value, "sign": _odd_sign}
_WRITES_VALUE: dict[str, Any] = {"sign digits decimals": _packed_value}


def _has_no_value(message: Reply) -> None:
    if message.value is not None or message.decimals is not None:
        raise TelegramError("field", f"{message.kind} telegram: a refusal has no value", field="value")


def _packed_refusal(message: Reply) -> tuple[str, str, int]:
    return message.sign or "+", "000", REFUSED


def _no_decimals(decimals: int) -> None:
    """Byte 19 says that it is a refusal, and not where a point is."""
    del decimals


def _packed_read(message: Read) -> tuple[str, str]:
    del message
    return "+", "000000"


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
    """Parameter and filler of a telegram in which both mean nothing."""
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
        raise TelegramError("field", f"control telegram, {filler[4]!r} is no character of one byte", field="filler")
    return filler[:4], filler[4], filler[5:]


_READS_UNUSED: dict[str, Any] = {"parameter filler": _unused}
_WRITES_UNUSED: dict[str, Any] = {"filler_parameter sign filler": _packed_unused}


_POINT = "decimals" / decimal_number(1, DECIMALS, "digits after the point, 0 to 5")
_INDEX_POINT = "decimals" / decimal_number(1, DECIMALS, "0: one index; 1 to 5: as many digits are y")

UPDATE = Form(
    Update,
    *_request(b"U", "update", _PARAMETER, "sign" / _any_sign(), _DIGITS, _POINT),
    reads={**_READS_REQUEST, **_READS_VALUE},
    writes={**_WRITES_REQUEST, **_WRITES_VALUE},
)
READ = Form(
    Read,
    *_request(b"R", "read", _PARAMETER, *_IGNORED[1:]),
    reads=_READS_REQUEST,
    writes={**_WRITES_REQUEST, "sign filler": _packed_read},
)
READ_INDEX = Form(
    ReadIndex,
    *_request(b"I", "read_index", _PARAMETER, "sign" / _any_sign(), _DIGITS, _INDEX_POINT),
    reads={**_READS_REQUEST, "index": _index},
    writes={**_WRITES_REQUEST, "sign digits decimals": _packed_index},
)
CONTROL = Form(
    Control,
    *_request(b"C", "control", *_IGNORED),
    reads={**_READS_REQUEST, **_READS_UNUSED},
    writes={**_WRITES_REQUEST, **_WRITES_UNUSED},
)


def _reply(*, lenient: bool, kinds: Mapping[bytes, str], rest: tuple[Any, ...]) -> tuple[Any, ...]:
    return _frame(kinds, "status_word" / _status_word(lenient=lenient), *rest)


def _value_form(*, lenient: bool) -> Form[Reply]:
    rest = (_PARAMETER, "sign" / _any_sign(), _DIGITS, _POINT)
    return Form(
        Reply,
        *_reply(lenient=lenient, kinds=_ANSWERED, rest=rest),
        reads={**_READS, **_READS_VALUE},
        writes={**_WRITES, **_WRITES_VALUE},
    )


def _refusal_form(*, lenient: bool) -> Form[Reply]:
    rest = (
        _PARAMETER,
        "sign" / _any_sign(),
        "filler" / _text(3, "not looked at"),
        "fault_code" / decimal_number(2, meaning="cause"),
        "decimals" / decimal_number(1, (REFUSED,), "9: refused"),
    )
    return Form(
        Reply,
        *_reply(lenient=lenient, kinds=_ANSWERED, rest=rest),
        reads={**_READS, "sign": _odd_sign, "decimals": _no_decimals},
        writes={**_WRITES, "sign filler decimals": _packed_refusal},
        check=_has_no_value,
    )


def _status_form(*, lenient: bool) -> Form[ControlReply]:
    return Form(
        ControlReply,
        *_reply(lenient=lenient, kinds={b"C": "control"}, rest=_IGNORED),
        reads={**_READS, **_READS_UNUSED},
        writes={**_WRITES, **_WRITES_UNUSED},
    )


VALUE, REFUSAL, STATUS = _value_form(lenient=False), _refusal_form(lenient=False), _status_form(lenient=False)
LENIENT_VALUE, LENIENT_REFUSAL, LENIENT_STATUS = (
    _value_form(lenient=True),
    _refusal_form(lenient=True),
    _status_form(lenient=True),
)
