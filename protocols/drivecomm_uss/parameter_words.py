"""PWE: where values, errors and texts stand in the parameter area (USS specification C-10, C-11, C-24).

A word stands in the last word of an area of 3 or 4 words, and in the first one of a variable area. Double words and the
elements of whole arrays (index 255) go high word first.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm_uss.options import VARIABLE

if TYPE_CHECKING:
    from drivecomm.protocol import Direction
    from drivecomm_uss.messages import Reply, Request, Words

WHOLE_ARRAY = 255
NO_TASK, READ, READ_DESCRIPTION, READ_ELEMENT, COUNT_ELEMENTS, TEXT = 0, 1, 4, 6, 9, 15
IMPOSSIBLE, NO_RIGHTS = 7, 8
"""Replies to any task, and to any that writes."""

_BITS = {
    "request": dict.fromkeys((2, 7, 12, 14), 16) | dict.fromkeys((3, 8, 11, 13), 32),
    "reply": dict.fromkeys((1, 4, 6, 9, 11), 16) | dict.fromkeys((2, 5, 10, 12), 32),
}
"""How many bits a value has, by AK; the others carry no value."""
_ARRAYS = {"request": (7, 8, 11, 12), "reply": (4, 5, 11, 12)}
_DESCRIBES = {"request": 5, "reply": 3}
"""AK of a description element, whose words only the element itself says."""
NEVER_SENT = {"request": (10,), "reply": (13, 14)}

Content = tuple[int | None, "Words | None", int | None, str | None, "Words | None"]
"""value, values, error, text, pwe"""


def content_of(words: Words, direction: Direction, ak: int, index: int, pkw: int, *, writes_text: bool) -> Content:
    """Return what these words of PWE are. Raises ValueError where there are fewer than AK announces."""
    found = _content(words, direction, ak, index, pkw, writes_text=writes_text)
    plain = _plain_words(dict(zip(("value", "values", "error", "text"), found, strict=True)), direction, ak, index, pkw)
    return (*found, None if plain == words and ak != _DESCRIBES[direction] else words)


def _content(
    words: Words, direction: Direction, ak: int, index: int, pkw: int, *, writes_text: bool
) -> tuple[int | None, Words | None, int | None, str | None]:
    bits, last = _BITS[direction].get(ak), words[1 if pkw == 4 else 0]
    if ak == IMPOSSIBLE and direction == "reply":
        return None, None, last, None
    if ak == TEXT and pkw == VARIABLE and (direction == "reply" or writes_text):
        return None, None, None, b"".join(word.to_bytes(2, "big") for word in words).decode("latin-1")
    if bits is None:
        return None, None, None, None
    if bits == 32 and (len(words) < 2 or (index == WHOLE_ARRAY and len(words) % 2)):
        raise ValueError(f"AK {ak} announces a double word, and there is no room for one")
    if index == WHOLE_ARRAY and pkw == VARIABLE and ak in _ARRAYS[direction]:
        return None, words if bits == 16 else _doubles(words), None, None
    return last if bits == 16 else words[0] << 16 | words[1], None, None, None


def words_of(message: Request | Reply, direction: Direction, pkw: int) -> Words:
    """Return the words of PWE for a message. Raises ValueError for what is missing, too large or has no room."""
    given = {name: getattr(message, name, None) for name in ("value", "values", "error", "text")}
    ak = message.ak
    if type(ak) is not int:
        raise ValueError("ak is missing")
    if message.pwe is None:
        if ak == _DESCRIBES[direction]:
            raise ValueError(f"pwe is missing: AK {ak} of a {direction} says nothing of its words")
        words = _plain_words(given, direction, ak, message.index or 0, pkw)
    else:
        words = _all_words("pwe", message.pwe)
        writes_text = bool(getattr(message, "text_write", False))
        *content, more = content_of(words, direction, ak, message.index or 0, pkw, writes_text=writes_text)
        if [*given.values()] != content:
            raise ValueError(f"pwe says otherwise than {', '.join(given)}")
        if more is None:
            raise ValueError("pwe says no more than the other fields; leave it out")
    if pkw != VARIABLE and len(words) != pkw - 2:
        raise ValueError(f"{len(words)} words for PWE, and a PKW area of {pkw} words has {pkw - 2}")
    if not words:
        raise ValueError("pwe has at least one word")
    return words


def _plain_words(given: dict[str, Any], direction: Direction, ak: int, index: int, pkw: int) -> Words:
    name, bits = "value", _BITS[direction].get(ak)
    if ak == IMPOSSIBLE and direction == "reply":
        name, bits = "error", 16
    elif given["text"] is not None and ak == TEXT:
        return _text_words(given["text"], pkw)
    elif index == WHOLE_ARRAY and pkw == VARIABLE and ak in _ARRAYS[direction]:
        name = "values"
    for other, value in given.items():
        if value is not None and (other != name or bits is None):
            raise ValueError(f"{other} does not belong to AK {ak} of a {direction}")
    if bits is None:
        return (0,) * (1 if pkw == VARIABLE else pkw - 2)
    if name == "values":
        many: Words = given["values"]
        return _all_words("values", many) if bits == 16 else _halves(many)
    value = given[name]
    if type(value) is not int or value not in range(2**bits):
        raise ValueError(f"{name} {'is missing' if value is None else f'{value!r} does not fit {bits} bits'}")
    if bits == 16:
        return (0, value) if pkw == 4 else (value,)
    return value >> 16, value & 0xFFFF


def _text_words(text: object, pkw: int) -> Words:
    if not isinstance(text, str) or len(text) % 2 or not text or any(ord(each) > 0xFF for each in text):
        raise ValueError(f"text {text!r} is no even number of characters of ISO 8859-1")
    if pkw != VARIABLE:
        raise ValueError("text needs a variable PKW area")
    data = text.encode("latin-1")
    return tuple(int.from_bytes(data[place : place + 2], "big") for place in range(0, len(data), 2))


def _all_words(name: str, words: object) -> Words:
    if not isinstance(words, tuple) or any(type(each) is not int or each not in range(0x10000) for each in words):
        raise ValueError(f"{name} {words!r} is no list of words")
    return words


def _doubles(words: Words) -> Words:
    return tuple(high << 16 | low for high, low in zip(words[::2], words[1::2], strict=True))


def _halves(values: Words) -> Words:
    if not isinstance(values, tuple) or any(type(each) is not int or each not in range(2**32) for each in values):
        raise ValueError(f"values {values!r} is no list of double words")
    return tuple(half for value in values for half in (value >> 16, value & 0xFFFF))
