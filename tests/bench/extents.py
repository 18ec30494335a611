"""How much a test plays: a sample at each change, much before it counts (marker `soak`), all with DRIVECOMM_LONG=1."""

import itertools
import os

import pytest

LONG = os.environ.get("DRIVECOMM_LONG") == "1"
"""Whether a night is spent on it."""


STANDING_FOR_ALL = frozenset({"ct-ansi", "danfoss-fc", "modbus", "uss", "vabus"})
"""Protocols with one of each kind that a line notices: replies that name their question, or nothing, or are one
character; telegrams of a fixed length, of a stated length, up to a last character; requests that are sent back."""


def extents(sample, everything):
    """Give a test its `extent`: the sample, and marked `soak` all there is."""
    return pytest.mark.parametrize(
        "extent",
        [pytest.param(sample, id="sample"), pytest.param(everything, id="all", marks=pytest.mark.soak)],
    )


def protocol_extents(protocols, sample, everything, *, all_of_them=LONG):
    """Return each protocol with the sample, and those that stand for all with everything there is, marked `soak`.

    What a line does is not made anew for each protocol. all_of_them: everything there is with each.
    """
    names = {protocol: getattr(protocol, "name", protocol) for protocol in protocols}
    return [
        *(pytest.param(protocol, sample, id=f"{name}-sample") for protocol, name in names.items()),
        *(
            pytest.param(protocol, everything, id=f"{name}-all", marks=pytest.mark.soak)
            for protocol, name in names.items()
            if all_of_them or name in STANDING_FOR_ALL
        ),
    ]


def some(number, things):
    """Return one in so many of these; all of them where a night is spent on it."""
    return list(things) if LONG else list(things)[::number]


def every(number, things):
    """Return all of these, marked `soak` but for one in so many."""
    return [
        thing if place % number == 0 else pytest.param(thing, marks=pytest.mark.soak)
        for place, thing in enumerate(things)
    ]


def every_choice(number, *things):
    """Return all choices of one of each, for as many names, marked `soak` but for one in so many."""
    return [
        pytest.param(*choice, marks=[] if place % number == 0 else [pytest.mark.soak])
        for place, choice in enumerate(itertools.product(*things))
    ]


def first_of_each(things, shape):
    """Return the first thing of each shape."""
    found = {}
    for thing in things:
        found.setdefault(shape(thing), thing)
    return list(found.values())


def shape_of_vector(vector):
    """What a framer sees of a telegram: which one it is, its length and the options of the line, not its content."""
    kind = vector.fields.get("kind")
    return vector.direction, vector.valid, kind, vector.error, len(vector.data), repr(sorted(vector.options.items()))


def shape_of_exchange(exchange):
    """What a line sees of an exchange: what happens on it and which calls are made."""
    return frozenset(step.action for step in exchange.steps), frozenset(call.call for call in exchange.calls)
