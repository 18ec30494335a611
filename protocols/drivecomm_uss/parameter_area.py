"""The parameter area, PKE IND PWE (USS specification C-10 to C-24).

PKE: AK in bits 12 to 15, the toggle bit SPM in 11, PNU in 0 to 10.

IND: array index, and additions of the manufacturers (C-18 to C-21).

    page          index in bits 0-7, page of 2000 parameters in bits 15-10 with the weights 1 8 4 2 32 16
                  (CU240S Operating Instructions 11/2006 p. 8-31; MICROMASTER 420 Operating Instructions p. 115)
    masterdrives  index in bits 0-7, page in bit 15; with AK 15 bit 8 writes a text and bit 9 selects the second text
                  field (Compendium Motion Control p. 8.1-14)
    nord          parameter set 1 to 4 in bits 0-1, array element in bits 2-7 (BU 0050 p. 41)
    plain         index in bits 0-7
    word          the whole word is the index

PWE: a word is in the last word of an area of 3 or 4 words, and in the first word of a variable area. Double words and
the elements of whole arrays (index 255) have the high word first.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivecomm.protocol.schema import numbers, words_as, words_in, wrong_field
from drivecomm_uss.options import VARIABLE
from drivecomm_uss.tasks import TASKS, UssTask

if TYPE_CHECKING:
    from drivecomm.protocol import Direction
    from drivecomm_uss.messages import Reply, Request, Words
    from drivecomm_uss.options import Ind

_TEXT, _WHOLE_ARRAY = 15, 255
_BYTE = {bit: 1 << bit for bit in range(8)}
_PAGE = {15: 1, 14: 8, 13: 4, 12: 2, 11: 32, 10: 16}
_INDEX_WORDS: dict[str, dict[str, dict[int, int]]] = {
    "page": {"index": _BYTE, "page": _PAGE},
    "masterdrives": {"index": _BYTE, "page": {15: 1}},
    "masterdrives text": {"index": _BYTE, "page": {15: 1}, "text_field": {9: 1}, "text_write": {8: 1}},
    "nord": {"index": {bit: 1 << bit - 2 for bit in range(2, 8)}, "parameter_set": {0: 1, 1: 2}},
    "plain": {"index": _BYTE},
    "word": {"index": {bit: 1 << bit for bit in range(16)}},
}
"""Weight of each bit, by layout and part of the index word."""
_FIRST = {"parameter_set": 1, "text_field": 1}
"""Parts of the index word that do not count from 0."""
PAGE = 2000


def numbers_of(ind: Ind) -> range:
    """Return the parameter numbers that telegrams can express: by page and PNU, or by the eleven bits of PNU alone."""
    return range(PAGE * values_of("page", ind).stop if "page" in _INDEX_WORDS[ind] else 2048)


def values_of(part: str, ind: str) -> range:
    """Return the values that a part of the index word can hold; only the first value if the word lacks that part."""
    first = _FIRST.get(part, 0)
    return range(first, first + sum(_INDEX_WORDS[ind].get(part, {}).values()) + 1)


@dataclass(frozen=True, slots=True)
class ParameterArea:
    """Conversion of the parameter area.

    direction: direction of the telegram. size: in words. ind: layout of the index word.
    """

    direction: Direction
    size: int
    ind: Ind

    def read(self, pke: int, ind: int, words: str) -> tuple[Any, ...]:
        """Return the content of the area as a tuple in the order of `names`. Raises ValueError."""
        ak, pnu, pwe = pke >> 12, pke & 0x7FF, words_in(words)
        if pnu >= self._highest:
            raise ValueError(f"parameter number {pnu} is beyond {self._highest - 1}")
        found: dict[str, Any] = {"ak": ak, "spm": bool(pke >> 11 & 1), "pnu": pnu}
        parts = _INDEX_WORDS[self._layout(ak)]
        for name, weights in parts.items():
            found[name] = sum(weight for bit, weight in weights.items() if ind >> bit & 1) + _FIRST.get(name, 0)
        if ind & ~sum(1 << bit for weights in parts.values() for bit in weights):
            raise ValueError(f"index word {ind:04X} has bits that mean nothing here")
        if "text_write" in found:
            found["text_write"] = bool(found["text_write"])
        name, task = self._carried(ak, found["index"], found.get("text_write"))
        content = self._content(pwe, name, task)
        if name == "pwe" or self._plain(content, name, task) != pwe:
            found["pwe"] = pwe
        return tuple((found | {name: content} if name and name != "pwe" else found).get(each) for each in self.names)

    def write(self, message: Request | Reply) -> tuple[int, int, Words]:
        """Return PKE, IND and the words of PWE. Raises TelegramError."""
        ak = message.ak
        if type(ak) is not int or ak not in TASKS[self.direction] or TASKS[self.direction][ak].reserved:
            raise wrong_field(
                "ak", "it is missing" if ak is None else f"{ak!r} is not an identifier of a {self.direction}"
            )
        pnu, layout = _number("pnu", message.pnu, range(self._highest)), self._layout(ak)
        if message.spm not in (None, True, False):
            raise wrong_field("spm", f"{message.spm!r} is neither true nor false")
        ind = 0
        for part, weights in _INDEX_WORDS[layout].items():
            allowed, given = values_of(part, layout), getattr(message, part)
            given = int(given) if part == "text_write" and type(given) is bool else given
            number = _number(part, allowed.start if given is None else given, allowed) - allowed.start
            ind |= sum(1 << bit for bit, weight in weights.items() if number & weight)
        name, task = self._carried(ak, message.index or 0, message.text_write)
        process = ("status_word", "actual", "control_word", "reference", "pzd")
        message.must_have_only({"ak", "spm", "pnu", "pwe", name, *_INDEX_WORDS[layout], *process})
        return ak << 12 | bool(message.spm) << 11 | pnu, ind, self._words(message, name, task)

    @property
    def names(self) -> tuple[str, ...]:
        """Fields of a message that are in the area."""
        index = ("index", "page", "parameter_set", "text_field", "text_write")
        error = () if self.direction == "request" else ("error",)
        return "ak", "spm", "pnu", *index, "value", "values", "text", "pwe", *error

    @property
    def _highest(self) -> int:
        return PAGE if "page" in _INDEX_WORDS[self.ind] else 2048

    def _layout(self, ak: int) -> str:
        return "masterdrives text" if ak == _TEXT and self.ind == "masterdrives" else self.ind

    def _carried(self, ak: int, index: int, text_write: object) -> tuple[str, UssTask]:
        """Return the name of the field that PWE carries, empty for none, and its task."""
        task = TASKS[self.direction].get(ak, UssTask())
        if task.array and task.carries and index == _WHOLE_ARRAY and self.size == VARIABLE:
            return "values", task
        has_text = self.size == VARIABLE and (self.direction == "reply" or bool(text_write))
        return "" if task.carries == "text" and not has_text else task.carries, task

    def _content(self, pwe: Words, name: str, task: UssTask) -> Any:
        if name == "text":
            return words_as(pwe)
        if name == "values":
            return _joined(pwe, task.bits)
        if name in ("value", "error"):
            return _joined(pwe[:2] if task.bits == 32 else pwe[1:2] if self.size == 4 else pwe[:1], task.bits)[0]
        return None

    def _plain(self, content: Any, name: str, task: UssTask) -> Words:
        """Return the words that carry a content, without additional ones."""
        if name == "text":
            return _words_of_text(content)
        if name in ("", "pwe"):
            return (0,) * (1 if self.size == VARIABLE else self.size - 2)
        many = content if name == "values" or content is None else (content,)
        halves = _halves(tuple(numbers(many, 2**task.bits - 1, name)), task.bits)
        return (0, *halves) if self.size == 4 and task.bits == 16 else halves

    def _words(self, message: Request | Reply, name: str, task: UssTask) -> Words:
        content = getattr(message, name) if name else None
        if message.pwe is None and name != "pwe":
            words = self._plain(content, name, task)
        else:
            words = tuple(numbers(message.pwe, 0xFFFF, "pwe"))
            try:
                plain = name != "pwe" and self._plain(content, name, task) == words
                same = name == "pwe" or self._content(words, name, task) == content
            except (ValueError, IndexError):
                plain = same = False
            if plain or not same:
                raise wrong_field("pwe", f"it says {'no more' if plain else 'otherwise'} than the other fields")
        if not words or (self.size != VARIABLE and len(words) != self.size - 2):
            raise wrong_field(
                "pwe", f"{len(words)} words have no room, or are none, in a PKW area of {self.size} words"
            )
        return words


def _joined(words: Words, bits: int) -> Words:
    """Return the numbers of 16 or 32 bits in these words. Raises ValueError for an incomplete one."""
    if bits == 16:
        return words
    if not words or len(words) % 2:
        raise ValueError("AK announces a double word, and there is no room for one")
    return tuple(high << 16 | low for high, low in zip(words[::2], words[1::2], strict=True))


def _halves(values: Words, bits: int) -> Words:
    return values if bits == 16 else tuple(half for value in values for half in divmod(value, 1 << 16))


def _words_of_text(text: object) -> Words:
    if not isinstance(text, str) or len(text) % 2 or not text or any(ord(each) > 0xFF for each in text):
        raise wrong_field("text", f"{text!r} is not an even number of characters of ISO 8859-1")
    return words_in(text)


def _number(name: str, value: object, allowed: range) -> int:
    if type(value) is not int or value not in allowed:
        what = "it is missing" if value is None else f"{value!r} is not {allowed.start} to {allowed.stop - 1}"
        raise wrong_field(name, what)
    return value
