"""Reading and writing parameters: values, texts, option texts, description elements, RAM and EEPROM.

Specification, sections 6 to 8; VLT 5000 Design Guide p. 95-99.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from drivecomm.errors import RefusedError, UnexpectedReplyError
from drivecomm_danfoss_fc.description import BASIC, NAME, description_reading
from drivecomm_danfoss_fc.messages import TextReply
from drivecomm_danfoss_fc.parameters import TYPES_BY_NUMBER, raw_for, reading_of, text_reading, trimmed
from drivecomm_danfoss_fc.tables import WRONG_TYPE, fault_text, table

if TYPE_CHECKING:
    from drivecomm.profiles import ProcessWords
    from drivecomm.protocol import Exchange, Reading, Value
    from drivecomm_danfoss_fc.parameters import Target

READ, READ_ELEMENT, TEXT = 1, 4, 15
"""Commands (AK) that a master sends; those that write are in tables.toml."""

READ_TEXT, WRITE_TEXT = 0x0400, 0x0500
"""High byte of IND with AK 15 (FC 102 Design Guide section 8.4.10; VLT 6000 operating manual p. 74)."""

_NUMBERS, _ELEMENT, _TEXTS, _WRITTEN_TEXT = (1, 2), (3,), (15,), (1, 2, 15)
"""Response codes (AK). 15, and 3 to a request for element 6, always carry a text; the others never do."""

# A confirmation with another value may be a late reply to an earlier read, so the write is repeated once before that
# value is trusted. Values are absolute, so that writing one twice changes nothing.
_TWICE = range(2)


def read_as_it_is(talk: ProcessWords, wanted: Target, types: dict[int, str]) -> Exchange[Reading]:
    """Read a value; if the drive refuses it for its data type, read the type (AK 4) and read the value again.

    types: the types found so far, by PNU; this function adds to it.
    """
    wanted = replace(wanted, type=types[wanted.pnu]) if wanted.pnu in types else wanted
    try:
        return (yield from read_typed(talk, wanted))
    except RefusedError as refused:
        if refused.code != WRONG_TYPE:
            raise
        found = replace(wanted, type=(yield from _told_type(talk, wanted)))
        if (found.type == "text") is (wanted.type == "text"):
            raise
        try:
            reading = yield from read_typed(talk, found)
        except RefusedError:
            raise refused from None
    types[found.pnu] = found.type
    note = f"the drive refuses to read it as {'a text' if wanted.type == 'text' else 'a number'}"
    return replace(reading, note="; ".join(filter(None, (note, reading.note))))


def read_typed(talk: ProcessWords, wanted: Target) -> Exchange[Reading]:
    """Read a value as a text or as a number, as its type says."""
    return read_text(talk, wanted) if wanted.type == "text" else read_number(talk, wanted)


def _told_type(talk: ProcessWords, wanted: Target) -> Exchange[str]:
    """Return the type that the drive reports, or the other kind of type if it reports none.

    The other kind of a refused number is text; that of a refused text is a number of unknown type, which is empty.
    """
    try:
        basic = yield from read_element(talk, wanted, BASIC)
    except (RefusedError, UnexpectedReplyError):
        kind = ""
    else:
        kind = TYPES_BY_NUMBER.get(int(basic.raw) & 0xFF, "")
    return kind or ("" if wanted.type == "text" else "text")


def read_number(talk: ProcessWords, wanted: Target) -> Exchange[Reading]:
    """Read a value with AK 1."""
    return reading_of(wanted, (yield from _answer(talk, wanted, _NUMBERS, ak=READ, ind=wanted.ind)))


def read_text(talk: ProcessWords, wanted: Target) -> Exchange[Reading]:
    """Read the text of a parameter: AK 15, IND 04xx, in a parameter block with PWE 0."""
    reply = yield from _answer(talk, wanted, _TEXTS, ak=TEXT, ind=READ_TEXT | wanted.ind)
    return text_reading(wanted, reply.text)


def read_option_text(talk: ProcessWords, wanted: Target, option: int) -> Exchange[Reading]:
    """Read the text of one option value: AK 15, IND = value + 1 (VLT 5000 Design Guide p. 99)."""
    reply = yield from _answer(talk, wanted, _TEXTS, ak=TEXT, ind=option + 1)
    return text_reading(wanted, reply.text, f"text of option {option}")


def read_element(talk: ProcessWords, wanted: Target, element: int) -> Exchange[Reading]:
    """Read a description element with AK 4; element 6, the name, is a text."""
    reply = yield from _answer(talk, wanted, _ELEMENT, ak=READ_ELEMENT, ind=element)
    if element == NAME:
        return text_reading(wanted, reply.text, "description element 6, name")
    return description_reading(wanted, element, reply.pwe)


def write_number(talk: ProcessWords, wanted: Target, ak: int, pwe: int) -> Exchange[Reading]:
    """Write a number with AK and PWE from `task_that_writes`; return the value that the drive reports."""
    for _ in _TWICE:
        reply = yield from _answer(talk, wanted, _NUMBERS, acts=True, ak=ak, ind=wanted.ind, pwe=pwe)
        reported = reading_of(wanted, reply)
        if reported.raw == pwe:
            return reported
    differs = f"the drive reports {reported.raw} where {pwe} was written"
    return replace(reported, note="; ".join(filter(None, (differs, reported.note))))


def write_text(talk: ProcessWords, wanted: Target, text: str) -> Exchange[Reading | None]:
    """Write a text with AK 15, IND 05xx, in a text block, exactly the characters given."""
    # No manual states the reply to a text write, so accept a text, or a word of unknown meaning.
    kept = "whether a drive keeps a text over power-off is not printed"
    for _ in _TWICE:
        reply = yield from _answer(talk, wanted, _WRITTEN_TEXT, acts=True, ind=WRITE_TEXT | wanted.ind, text=text)
        if not isinstance(reply, TextReply):
            return None
        if trimmed(reply.text) == trimmed(text):
            return text_reading(wanted, reply.text, kept)
    if not trimmed(reply.text):
        return None
    return text_reading(wanted, reply.text, f"the drive reports another text than the one written, {text!r}; {kept}")


def task_that_writes(wanted: Target, value: Value | float, *, store: bool) -> tuple[int, int]:
    """Return AK and PWE of a write: AK 2 or 3 for RAM, 14 or 13 for EEPROM as well. Raises as `raw_for`."""
    sought = {"bits": wanted.bits, "stored": store}
    ak = next(ak for ak, each in table("commands").items() if sought.items() <= each.items())
    return ak, raw_for(wanted, value) % 2**wanted.bits


def _answer(
    talk: ProcessWords, wanted: Target, expected: tuple[int, ...], *, acts: bool = False, **task: Any
) -> Exchange[Any]:
    """Return the reply to a task for a parameter if it is one of the expected responses.

    Raises RefusedError for AK 7 with the fault code in PWE low, UnexpectedReplyError for AK 0 and for unlisted AKs.
    """
    reply = yield from talk.ask(acts=acts, pnu=wanted.pnu, **task)
    if reply.ak in expected:
        return reply
    if reply.ak == 7:
        code = reply.pwe & 0xFFFF
        raise RefusedError(wanted.address, code, fault_text(code))
    if reply.ak == 0:
        raise UnexpectedReplyError(
            f'the drive answered parameter {wanted.address} with AK 0, "no response": it did not process the command'
        )
    raise UnexpectedReplyError(
        f"the drive answered parameter {wanted.address} with AK {reply.ak}, which is not a known response code"
    )
