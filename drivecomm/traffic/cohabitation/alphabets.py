"""Characters that each place of a leaf accepts, found by trying the leaf itself.

A leaf only reports whether it accepts a string of characters. A leaf of one character is tried with all 256. A longer
leaf is tried with strings that it accepts, changing one character at a time. The first accepted strings are searched
for among combinations of digits, a letter and other typical characters; a longer leaf that accepts none of these counts
as accepting everything. This finds every character if each place of the leaf accepts the same characters whatever the
other places hold, as with digits.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import product
from random import Random
from typing import TYPE_CHECKING, Any

from drivecomm.protocol.schema import CheckCharacters, Leaf, LeafFault

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

ALL = frozenset(range(256))

_TYPICAL = b"01A@ \x00\xff"
_MOST_TYPICAL = 3
"""Number of leading places filled with every combination of typical characters; later ones repeat the last."""

_LOOKED_AROUND = 8
"""Limit of the accepted typical strings that are varied, and of the accepted variants that are varied in turn."""

_CHECKED = 4096
"""Number of random texts from which the check characters are collected.

The chance to miss one of 256 check characters is one in ten million.
"""


def accepts(leaf: Leaf, data: bytes) -> bool:
    """Whether a leaf accepts these characters."""
    return leaf.fault_at(0, len(data), data) is None


def words(leaf: Leaf) -> Iterator[tuple[bytes, Any]]:
    """Yield each text that a leaf of one or two characters accepts, with its value."""
    for characters in product(*map(sorted, readable(leaf))):
        data = bytes(characters)
        try:
            value = leaf.take_at(0, len(data), data)
        except LeafFault:
            continue
        yield data, value


@lru_cache(maxsize=4096)
def written(leaf: Leaf) -> tuple[frozenset[int], ...]:
    """Return the characters with which a fixed-size leaf may be written, place by place."""
    if isinstance(leaf, CheckCharacters):
        return _check_characters(leaf)
    if leaf.implied:
        return tuple(frozenset([code]) for code in leaf.write_behind(b"", None))
    return _found(leaf.size, lambda data: is_written(leaf, data))


@lru_cache(maxsize=4096)
def readable(leaf: Leaf) -> tuple[frozenset[int], ...]:
    """Return the characters that a fixed-size leaf accepts when it is read, place by place."""
    if isinstance(leaf, CheckCharacters):
        return _check_characters(leaf)
    # Constant text such as a line end is not among the typical texts, so start from it.
    known = [leaf.write_behind(b"", None)] if leaf.implied else []
    return _found(leaf.size, lambda data: accepts(leaf, data), known)


def is_written(leaf: Leaf, data: bytes) -> bool:
    """Whether a leaf of fixed size writes these characters back unchanged after reading them."""
    try:
        return bool(leaf.write_behind(b"", leaf.take_at(0, len(data), data)) == data)
    except LeafFault:
        return False


def _found(size: int, accepted: Callable[[bytes], bool], known: Sequence[bytes] = ()) -> tuple[frozenset[int], ...]:
    if size == 1:
        return (frozenset(code for code in range(256) if accepted(bytes([code]))),)
    found: list[set[int]] = [set() for _ in range(size)]
    typical = [text for text in (*known, *_typical(size)) if accepted(text)]
    if not typical:
        return (ALL,) * size
    pending = typical[:: max(1, len(typical) // _LOOKED_AROUND)]
    for _ in range(2 * _LOOKED_AROUND):
        if not pending or all(len(codes) == 256 for codes in found):
            break
        # Try the typical texts first, then the accepted variants found from them.
        text = pending.pop(0)
        for place, codes in enumerate(found):
            codes.add(text[place])
            for code in ALL - codes:
                changed = text[:place] + bytes([code]) + text[place + 1 :]
                if accepted(changed):
                    codes.add(code)
                    pending.append(changed)
    return tuple(map(frozenset, found))


def _typical(size: int) -> Iterator[bytes]:
    first = min(size, _MOST_TYPICAL)
    for head in product(_TYPICAL, repeat=first):
        yield bytes(head) + bytes(head[-1:]) * (size - first)


def _check_characters(leaf: CheckCharacters) -> tuple[frozenset[int], ...]:
    chance = Random(0)  # noqa: S311 - no secret
    texts = [leaf.compute(chance.randbytes(8)) for _ in range(_CHECKED)]
    if leaf.off is not None:
        texts.append(leaf.off)
    return tuple(frozenset(text[place] for text in texts) for place in range(leaf.size))
