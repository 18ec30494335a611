"""Which characters may stand at each place of a leaf, found by asking the leaf itself.

A leaf says only whether it reads a string of characters. Those of one character are asked for all 256. Longer ones are
asked from strings that they accept, changing one character at a time. The first accepted strings are looked for among
all that are made of digits, a letter and other typical characters; a longer leaf that accepts none of them is taken to
accept everything. That finds all there is in a leaf whose places accept what they accept whatever stands at the others,
such as digits.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import product
from random import Random
from typing import TYPE_CHECKING, Any

from drivecomm.protocol.schema import Check, Fault, Leaf

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

ALL = frozenset(range(256))

_TYPICAL = b"01A@ \x00\xff"
_MOST_TYPICAL = 3
"""Longer leaves are tried with one typical character at all places, and with the first places apart."""

_LOOKED_AROUND = 8
"""Of so many accepted strings the neighbours are tried, and of as many of those that are accepted in turn."""

_CHECKED = 4096
"""Random texts, to see which check characters there are; each of 256 is met but for once in ten million."""


def accepts(leaf: Leaf, data: bytes) -> bool:
    """Whether a leaf accepts these characters."""
    return leaf.fault_at(0, len(data), data) is None


def words(leaf: Leaf) -> Iterator[tuple[bytes, Any]]:
    """Yield all that a leaf of one or two characters reads, and what it reads there."""
    for characters in product(*map(sorted, readable(leaf))):
        data = bytes(characters)
        try:
            value = leaf.take_at(0, len(data), data)
        except Fault:
            continue
        yield data, value


@lru_cache(maxsize=4096)
def written(leaf: Leaf) -> tuple[frozenset[int], ...]:
    """Return the characters that a leaf of fixed size may be written with, place by place."""
    if isinstance(leaf, Check):
        return _check_characters(leaf)
    if leaf.implied:
        return tuple(frozenset([code]) for code in leaf.write_behind(b"", None))
    return _found(leaf.size, lambda data: is_written(leaf, data))


@lru_cache(maxsize=4096)
def readable(leaf: Leaf) -> tuple[frozenset[int], ...]:
    """Return the characters that a leaf of fixed size may be read with, place by place."""
    if isinstance(leaf, Check):
        return _check_characters(leaf)
    # What is always written the same, such as a line end, is no typical text, and known.
    known = [leaf.write_behind(b"", None)] if leaf.implied else []
    return _found(leaf.size, lambda data: accepts(leaf, data), known)


def is_written(leaf: Leaf, data: bytes) -> bool:
    """Whether a leaf of fixed size reads these characters and writes the same ones back."""
    try:
        return bool(leaf.write_behind(b"", leaf.take_at(0, len(data), data)) == data)
    except Fault:
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
        # First those that were asked for, then those that they have led to.
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


def _check_characters(leaf: Check) -> tuple[frozenset[int], ...]:
    chance = Random(0)  # noqa: S311 - no secret
    texts = [leaf.compute(chance.randbytes(8)) for _ in range(_CHECKED)]
    if leaf.off is not None:
        texts.append(leaf.off)
    return tuple(frozenset(text[place] for text in texts) for place in range(leaf.size))
