"""Properties of every telegram of every installed protocol, including telegrams that no document prints.

DRIVECOMM_EXAMPLES sets the number of examples per property.
"""

import os
from copy import copy
from dataclasses import replace
from functools import lru_cache

import pytest
from extents import extents

from drivecomm.errors import DriveCommError, FileFormatError
from drivecomm.protocol import installed
from drivecomm.testing import CheckFailure, packaged_vectors
from drivecomm.testing.checking import registered
from drivecomm.testing.checks.properties import Drawn, measures_rising, try_examples

PROPERTIES = [each.function for each in registered("properties")]
EXAMPLES = int(os.environ.get("DRIVECOMM_EXAMPLES", "25"))


def _judged():
    for plugin in installed.working():
        try:
            packaged_vectors(plugin)
        except FileFormatError:
            # test_vectors reports the missing vectors; without vectors no telegrams can be drawn.
            continue
        yield plugin.name


# Finding the limits of every field takes longer than drawing examples, so the result is cached.
@lru_cache
def source(name, direction):
    return Drawn(installed[name], direction)


@pytest.mark.parametrize("holds", PROPERTIES, ids=lambda holds: holds.__name__)
@pytest.mark.parametrize("direction", ["request", "reply"])
@pytest.mark.parametrize("name", list(_judged()))
@extents(5, EXAMPLES)
def test_property_holds_for_drawn_telegrams(name, direction, holds, extent):
    try_examples(holds, source(name, direction), extent)


def test_drawn_examples_are_the_same_every_time():
    def seen():
        drawn_ones = []
        try_examples(lambda source, data: drawn_ones.append(data.draw(source.telegrams)), source("vabus", "reply"), 10)
        return drawn_ones

    assert seen() == seen()


class Wrong:
    """Codec with one method replaced."""

    def __init__(self, codec, **methods):
        self._codec = codec
        self._methods = methods

    def __getattr__(self, name):
        return self._methods.get(name) or getattr(self._codec, name)


def failing(**methods):
    """Return the properties that fail for a VABus codec with these methods."""
    real = source("vabus", "reply")
    altered = copy(real)
    altered.codec = Wrong(real.codec, **methods)
    broken = set()
    for holds in PROPERTIES:
        try:
            try_examples(holds, altered, 15)
        except (CheckFailure, DriveCommError, KeyError):
            broken.add(holds.__name__)
    return broken


@pytest.mark.soak
def test_codec_decoding_another_message_than_encoded_is_found():
    codec = source("vabus", "reply").codec

    def decode(data, direction):
        message = codec.decode(data, direction)
        return replace(message, address=1)

    assert "decodes_what_it_encodes" in failing(decode=decode)


@pytest.mark.soak
def test_codec_raising_a_foreign_error_is_found():
    codec = source("vabus", "reply").codec

    def decode(data, direction):
        return codec.decode(data, direction) if len(data) % 3 else {}[data]

    assert "decodes_or_refuses" in failing(decode=decode)


@pytest.mark.soak
def test_codec_encoding_bytes_that_it_refuses_is_found():
    codec = source("vabus", "reply").codec
    assert "encodes_or_refuses" in failing(encode=lambda message: codec.encode(message) + b"\r")


def test_decreasing_measured_length_is_found():
    codec = source("vabus", "reply").codec

    def measure(head, direction):
        return codec.measure(head, direction) - (len(head) == 3)

    altered = copy(source("vabus", "reply"))
    altered.codec = Wrong(codec, measure=measure)
    with pytest.raises(CheckFailure, match="are measured as"):
        try_examples(measures_rising, altered, 60)
