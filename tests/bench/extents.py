"""Extent of a test: a sample at each change, much more with the marker `soak`, and everything with DRIVECOMM_LONG=1."""

import itertools
import os

import pytest

LONG = os.environ.get("DRIVECOMM_LONG") == "1"
"""Whether a long run (one night) is requested."""


STANDING_FOR_ALL = frozenset({"ct-ansi", "danfoss-fc", "modbus", "uss", "vabus"})
"""Protocols that represent all others on a line.

They include replies that identify their request, replies that do not, and replies of one character; telegrams of a
fixed length, of a stated length, and up to a last character; and requests that are returned.
"""


def extents(sample, everything):
    """Parametrise a test's `extent` with the sample, and with everything, marked `soak`."""
    return pytest.mark.parametrize(
        "extent",
        [pytest.param(sample, id="sample"), pytest.param(everything, id="all", marks=pytest.mark.soak)],
    )


def protocol_extents(protocols, sample, everything, *, all_of_them=LONG):
    """Return each protocol with the sample, and the representative ones also with everything, marked `soak`.

    The representatives suffice because a line behaves the same for all protocols. all_of_them: use everything with each
    protocol.
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
    """Return every Nth of these things; all of them in a long run."""
    return list(things) if LONG else list(things)[::number]


def every(number, things):
    """Return all of these things, all except every Nth marked `soak`."""
    return [
        thing if place % number == 0 else pytest.param(thing, marks=pytest.mark.soak)
        for place, thing in enumerate(things)
    ]


def every_choice(number, *things):
    """Return all combinations with one of each of these, for as many parameters; all except every Nth marked `soak`."""
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
    """Return the properties of a telegram that matter to a framer: kind, length and options, but not content."""
    kind = vector.fields.get("kind")
    return vector.direction, vector.valid, kind, vector.error, len(vector.data), repr(sorted(vector.options.items()))


def shape_of_exchange(exchange):
    """Return the properties of an exchange that matter to a line: its kinds of steps, and its calls."""
    return frozenset(step.action for step in exchange.steps), frozenset(call.call for call in exchange.calls)
