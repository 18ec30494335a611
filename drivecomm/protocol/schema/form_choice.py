"""Choice among forms: the form of received bytes, the length of such a telegram, and the form for a message.

The deciding places and the meanings of their contents are determined once, from the forms. The result is one function
that looks at these places in order and ends with a function of the form.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import product
from operator import attrgetter
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from drivecomm.errors import UsageError
from drivecomm.protocol.schema import compiled
from drivecomm.protocol.schema.emission import Code
from drivecomm.protocol.schema.leaf import Until

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from drivecomm.protocol.schema.form import Form

GeneratedFunction: TypeAlias = Callable[[bytes], Any]
"""A generated function that reads or measures bytes."""


class DecidingPlace(NamedTuple):
    """A deciding place: its start and its end."""

    start: int
    end: int


@dataclass(frozen=True, eq=False)
class FormShape:
    """The possible bytes of a form's telegram."""

    title: str
    form: Form[Any]

    @cached_property
    def characters(self) -> Sequence[tuple[Any, int]]:
        """Leaf of each character, and its position in the leaf, up to the first character without a fixed place."""
        found: list[tuple[Any, int]] = []
        for _, leaf in self.form.leaves:
            if not isinstance(leaf.size, int):
                return [*found, *[(leaf, 0)] * _least(leaf)]
            found += [(leaf, number) for number in range(leaf.size)]
        return found

    @cached_property
    def spots(self) -> Mapping[DecidingPlace, Mapping[bytes, Any]]:
        """Deciding places, with the contents that they may have."""
        begins = [(place, leaf) for place, (leaf, number) in enumerate(self.characters) if leaf.decides and not number]
        return {DecidingPlace(place, place + leaf.size): leaf.words for place, leaf in begins}

    @cached_property
    def least(self) -> int:
        """Minimum number of characters in the telegram."""
        return sum(_least(leaf) for _, leaf in self.form.leaves)

    def is_over(self, spot: DecidingPlace) -> bool:
        """Return whether the telegram is too short to have this place."""
        return 0 < self.form.size < spot.end

    def may_have(self, spot: DecidingPlace, word: bytes) -> bool:
        """Return whether the telegram may have these characters at this place."""
        if spot in self.spots:
            return word in self.spots[spot]
        held = zip(self.characters[spot.start : spot.end], word, strict=False)
        return not self.is_over(spot) and all(byte in leaf.alphabets[number] for (leaf, number), byte in held)


def _least(leaf: Any) -> int:
    return leaf.size.least if isinstance(leaf.size, Until) else leaf.size if isinstance(leaf.size, int) else 0


_START = DecidingPlace(-1, -1)


def _unknown(what: str, live: Sequence[FormShape]) -> UsageError:
    titles = " or ".join(repr(each.title) for each in live)
    return UsageError(f"nothing determines {what} {titles}; declare a leaf of theirs as deciding, or leave one out")


def _spots(live: Sequence[FormShape], behind: DecidingPlace) -> list[DecidingPlace]:
    """Return the deciding places of some telegrams, in order, after a place that has already been examined."""
    return sorted({spot for each in live for spot in each.spots if spot > behind})


def _by_word(spot: DecidingPlace, live: Sequence[FormShape]) -> dict[bytes, list[FormShape]]:
    """Return the telegrams that remain possible for each content of a deciding place."""
    words = {word: None for each in live for word in each.spots.get(spot, ())}
    return {word: [each for each in live if each.may_have(spot, word)] for word in words}


_FEW = 4
"""Maximum number of contents that are compared one after the other; more are looked up in a table."""


def _function(say: Callable[[Code, Sequence[FormShape]], str], live: Sequence[FormShape]) -> GeneratedFunction:
    """Return a function of `data` that evaluates the expression which `say` generates for some telegrams."""
    code = Code()
    code.line(f"return {say(code, live)}")
    return code.function("told", "data")


def _looking(
    code: Code,
    spot: DecidingPlace,
    known: Mapping[bytes, Sequence[FormShape]],
    say: Callable[[Code, Sequence[FormShape]], str],
    other: str,
) -> str:
    """Return an expression that examines a place and continues with the telegrams that remain possible.

    known: the telegrams that remain for each content. say: generates the expression for them. other: the expression for
    any other content, and for bytes that end before the place.
    """
    cut = f"data[{spot.start}:{spot.end}]"
    left: dict[tuple[str, ...], Sequence[FormShape]] = {}
    words: dict[tuple[str, ...], list[bytes]] = {}
    for word, those in known.items():
        titles = tuple(each.title for each in those)
        left[titles] = those
        words.setdefault(titles, []).append(word)
    if len(words) > _FEW:
        made = {titles: _function(say, those) for titles, those in left.items()}
        table = {word: made[titles] for titles, same in words.items() for word in same}
        step = code.refer(table)
        return f"({step}[{cut}](data) if {cut} in {step} else {other})"
    for titles, same in reversed(words.items()):
        held = f"== {same[0]!r}" if len(same) == 1 else f"in {code.refer(frozenset(same))}"
        other = f"({say(code, left[titles])} if {cut} {held} else {other})"
    return other


def reader(live: Sequence[FormShape]) -> GeneratedFunction:
    """Return a function that reads any of these telegrams. Raises UsageError if they cannot be distinguished."""
    return live[0].form.parse if len(live) == 1 else _function(_read, live)


def _read(code: Code, live: Sequence[FormShape], behind: DecidingPlace = _START) -> str:
    """Return the expression that reads a telegram.

    behind: the place that was examined before.
    """
    if len(live) == 1:
        return f"{code.refer(live[0].form.parse)}(data)"
    for spot in _spots(live, behind):
        known, over = _by_word(spot, live), [each for each in live if each.is_over(spot)]
        if all(len(left) + len(over) == len(live) for left in known.values()):
            continue
        others = [each for each in live if spot not in each.spots]
        other = _read(code, others, spot) if len(others) > len(over) else _by_length(code, live, over)
        return _looking(code, spot, known, partial(_read, behind=spot), other)
    return _by_length(code, live, live)


def _by_length(code: Code, live: Sequence[FormShape], alike: Sequence[FormShape]) -> str:
    """Return an expression that reads the telegram of this length, or else the first one that may have any length.

    alike: the telegrams that differ only in their lengths.
    """
    if len({each.form.size for each in alike}) < len(alike):
        raise _unknown("which telegram is which:", alike)
    sized = {each.form.size: each.form.parse for each in reversed(live)}
    usual = sized.pop(0, live[0].form.parse)
    return f"{code.refer(sized)}.get(len(data), {code.refer(usual)})(data)"


def measurer(live: Sequence[FormShape]) -> GeneratedFunction:
    """Return a function that measures any of these telegrams. Raises UsageError if they cannot be distinguished."""
    return _function(_measure, live)


def _measure(code: Code, live: Sequence[FormShape], behind: DecidingPlace = _START, ended: int = 0) -> str:
    """Return the expression that measures a telegram.

    behind: the place that was examined before. ended: the length of a telegram that is complete unless a longer one
    continues like this; 0 if there is none.
    """
    spots = _spots(live, behind)
    if spots and (over := [each.form.size for each in live if each.is_over(spots[0])]):
        longer = [each for each in live if not each.is_over(spots[0])]
        return _measure(code, longer, behind, max(ended, *over))
    # The first character is always examined, since one with which no telegram can begin is noise.
    if len({each.form.size or each.title for each in live}) == 1 and not (spots and spots[0].start == 0):
        form = live[0].form
        if form.size:
            return str(form.size)
        return f"{code.refer(compiled.measurer(form))}(data)" + (f" or {ended}" if ended else "")
    if not spots:
        raise _unknown("how long a telegram is:", live)
    spot = spots[0]
    others = [each for each in live if spot not in each.spots]
    needed = spot.end if ended else max(spot.end, min(each.least for each in live))

    def left(code: Code, live: Sequence[FormShape]) -> str:
        return f"({_measure(code, live, spot, ended)})" if live else str(ended)

    other = f"({left(code, others)} if len(data) >= {spot.end} else {needed})"
    return _looking(code, spot, _by_word(spot, live), left, other)


def writer(forms: Sequence[Form[Any]]) -> Callable[[Any], bytes]:
    """Return a function that writes a message in the right form among those of its class.

    The form is found by the fields whose leaves are deciding in all the forms, and then by `Form.when`. Raises
    UsageError if these do not decide.
    """
    if len(forms) == 1:
        return forms[0].build
    words = [
        {
            name: {*(leaf.words or {}).values()}
            for name, leaf in each.leaves
            if leaf.decides and each.writes_as_it_is(name)
        }
        for each in forms
    ]
    names = [name for name in words[0] if all(name in each for each in words)]
    names = [name for name in names if any(each[name] != words[0][name] for each in words)]
    by_fields: dict[Any, list[Form[Any]]] = {}
    for form, allowed in zip(forms, words, strict=True):
        for key in product(*(allowed[name] for name in names)):
            by_fields.setdefault(key[0] if len(names) == 1 else key, []).append(form)
    for several in by_fields.values():
        if sum(each.when is None for each in several) > 1:
            raise UsageError(
                f"nothing determines in which form a {forms[0].message.__name__} is written; declare it by `when`"
            )
    builders = {key: _choice(several) for key, several in by_fields.items()}
    key_of: Callable[[Any], Any] = attrgetter(*names) if names else lambda _: ()

    def write(message: Any) -> bytes:
        try:
            build = builders.get(key_of(message), forms[0].build)
        except TypeError:
            # A list cannot be looked up; the form refuses it.
            build = forms[0].build
        return build(message)

    return write


def _choice(forms: Sequence[Form[Any]]) -> Callable[[Any], bytes]:
    usual = next((each for each in forms if each.when is None), forms[-1])
    if len(forms) == 1:
        return usual.build
    asked = [(each.when, each.build) for each in forms if each.when is not None]
    return lambda message: next((build for when, build in asked if when(message)), usual.build)(message)
