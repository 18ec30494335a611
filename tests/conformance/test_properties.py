"""What must hold for every telegram of every installed protocol, not only for those that a document prints.

DRIVECOMM_EXAMPLES sets how many examples of each are tried.
"""

import os
from functools import lru_cache

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from drivecomm.conformance import strategies
from drivecomm.conformance.forms import forms_of
from drivecomm.conformance.framing_checks import finds, frames
from drivecomm.conformance.schema_checks import compiles_whole, same_both_ways
from drivecomm.conformance.vectors import packaged_vectors
from drivecomm.errors import DriveCommError, FileFormatError, TelegramError
from drivecomm.framing import Framed, Framer, Noise
from drivecomm.models import load_model
from drivecomm.registry import installed
from drivecomm.telegram import fields_of


def _judged():
    for plugin in installed.working():
        try:
            packaged_vectors(plugin)
        except FileFormatError:
            # Reported by test_vectors; without vectors there are no shapes to start from.
            continue
        yield plugin


PLUGINS = list(_judged())
BOTH = [(plugin, direction) for plugin in PLUGINS for direction in ("request", "reply")]
EXAMPLES = settings(
    max_examples=int(os.environ.get("DRIVECOMM_EXAMPLES", "150")),
    derandomize=True,
    deadline=None,
    database=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)

every_protocol = pytest.mark.parametrize("plugin", PLUGINS, ids=[plugin.name for plugin in PLUGINS])
both_directions = pytest.mark.parametrize(
    ("plugin", "direction"), BOTH, ids=[f"{plugin.name}-{direction}" for plugin, direction in BOTH]
)


def default_codec(plugin):
    return plugin.codec(plugin.options())


# Asking the encoder for the limits of every field takes longer than drawing from them.
@lru_cache
def fields_for(name, direction):
    return strategies.telegram_fields(installed[name], direction)


@lru_cache
def telegrams_for(name, direction):
    return strategies.telegrams(installed[name], direction)


@lru_cache
def junk_fields_for(name, direction):
    return strategies.junk_fields(installed[name], direction)


@lru_cache
def near_telegrams_for(name, direction):
    return strategies.near_telegrams(installed[name], direction)


@lru_cache
def noise_for(name, direction):
    return strategies.line_noise(default_codec(installed[name]), direction)


@both_directions
@EXAMPLES
@given(data=st.data())
def test_what_is_encoded_decodes_to_the_same(plugin, direction, data):
    fields = data.draw(fields_for(plugin.name, direction))
    codec = default_codec(plugin)
    message = plugin.message(fields, direction)
    written = codec.encode(message)
    read = codec.decode(written, direction)
    assert read == message
    assert codec.encode(read) == written
    # By name as well: what decode shows can be given to encode.
    assert codec.encode(plugin.message(fields_of(read), direction)) == written


@both_directions
@EXAMPLES
@given(data=st.data())
def test_arbitrary_bytes_are_decoded_or_refused(plugin, direction, data):
    received = data.draw(near_telegrams_for(plugin.name, direction))
    codec = default_codec(plugin)
    try:
        message = codec.decode(received, direction)
    except TelegramError:
        return
    # Believed, so it must be something that can be said.
    assert fields_of(message)["kind"] == message.kind


@both_directions
@EXAMPLES
@given(data=st.data())
def test_arbitrary_fields_are_encoded_or_refused(plugin, direction, data):
    fields = data.draw(junk_fields_for(plugin.name, direction))
    codec = default_codec(plugin)
    try:
        written = codec.encode(plugin.message(fields, direction))
    except DriveCommError:
        return
    # What the encoder lets through must be a telegram.
    codec.decode(written, direction)


@both_directions
@EXAMPLES
@given(data=st.data())
def test_a_framer_finds_the_same_in_any_pieces(plugin, direction, data):
    codec = default_codec(plugin)
    parts = st.one_of(
        telegrams_for(plugin.name, direction),
        noise_for(plugin.name, direction),
        near_telegrams_for(plugin.name, direction),
    )
    stream = b"".join(data.draw(st.lists(parts, max_size=5)))
    whole = frames(codec, direction, [stream])
    pieces = data.draw(strategies.pieces(stream))
    assert frames(codec, direction, pieces) == whole
    assert frames(codec, direction, [stream[place : place + 1] for place in range(len(stream))]) == whole


@both_directions
@EXAMPLES
@given(data=st.data())
def test_a_framer_finds_every_telegram_between_noise(plugin, direction, data):
    codec = default_codec(plugin)
    sent = data.draw(st.lists(telegrams_for(plugin.name, direction), min_size=1, max_size=4))
    framer = Framer(codec, direction)
    found = []
    for telegram in sent:
        noise = data.draw(noise_for(plugin.name, direction))
        # The gap behind the noise and behind the telegram is the line's, not the framer's.
        found += frames(codec, direction, [noise])
        found += [find.data for find in [*framer.feed(telegram), *framer.flush()]]
    assert found == sent


@both_directions
@EXAMPLES
@given(data=st.data())
def test_a_framer_loses_and_invents_no_byte(plugin, direction, data):
    received = data.draw(near_telegrams_for(plugin.name, direction))
    codec = default_codec(plugin)
    found = finds(codec, direction, [received])
    telegrams = sum(len(find.data) for find in found if isinstance(find, Framed))
    noise = sum(len(find.data) for find in found if isinstance(find, Noise))
    # What is damaged is looked at again, so its bytes are counted as noise or as part of a telegram.
    assert telegrams + noise == len(received)


@both_directions
@EXAMPLES
@given(data=st.data())
def test_measure_never_asks_for_less_than_it_knows(plugin, direction, data):
    telegram = data.draw(telegrams_for(plugin.name, direction))
    codec = default_codec(plugin)
    known = 1
    for length in range(1, len(telegram)):
        needed = codec.measure(telegram[:length], direction)
        assert needed == length == 1 or needed > length, "a telegram that is not whole needs more"
        assert needed >= known
        known = needed
    assert codec.measure(telegram, direction) >= len(telegram)


@every_protocol
@EXAMPLES
@given(data=st.data())
def test_compiled_schemas_read_as_declared_ones(plugin, data):
    forms = forms_of(plugin)
    assert forms
    direction = data.draw(st.sampled_from(["request", "reply"]))
    received = data.draw(near_telegrams_for(plugin.name, direction))
    for named in forms:
        same_both_ways(named, received)


@every_protocol
def test_schemas_are_compiled_whole(plugin):
    for named in forms_of(plugin):
        compiles_whole(named.form)


@every_protocol
@EXAMPLES
@given(data=st.data())
def test_the_virtual_drive_survives_whatever_it_hears(plugin, data, virtual):
    received = data.draw(
        st.lists(
            st.one_of(near_telegrams_for(plugin.name, "request"), near_telegrams_for(plugin.name, "reply")),
            max_size=6,
        )
    )
    drive = virtual(plugin)
    now = 0.0
    for piece in received:
        now += 1.0
        for find in finds(drive.codec, "request", [piece]):
            if isinstance(find, Noise):
                continue
            answer = drive.hear(find, now)
            if answer is not None:
                drive.codec.decode(answer.data, "reply")
                assert answer.delay_s >= 0


@pytest.fixture(scope="module")
def virtual():
    models = {}

    def make(plugin):
        if plugin.name not in models:
            models[plugin.name] = load_model(plugin.package, plugin.name, plugin.default_model)
        return plugin.virtual(plugin.addresses[0], plugin.options(), models[plugin.name])

    return make
