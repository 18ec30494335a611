"""Playing of exchange vectors: correct exchanges pass, and every deviation is found."""

from dataclasses import replace

import pytest
from extents import first_of_each, shape_of_exchange

from drivecomm.protocol import installed
from drivecomm.testing import (
    CheckFailure,
    ExchangeVector,
    Expected,
    VectorCall,
    WireStep,
    call_blocking,
    packaged_vectors,
)
from drivecomm.testing.checking import registered
from drivecomm.testing.checks import exchanges

VABUS = installed["vabus"]
ENQUIRY = bytes.fromhex("04 41 30 30 34 38 31 05")
ANSWER = bytes.fromhex("41 02 30 30 34 38 31 30 38 30 30 30 30 30 33 45 38 03 48")
EOT = b"\x04"

WAYS = {way.name: way.function for way in registered("exchanges")}
EVERY_WAY = pytest.mark.parametrize("play", WAYS.values(), ids=WAYS)
FACES = pytest.mark.parametrize("play", [WAYS["exchange"], WAYS["awaited"]])


def send(data):
    return WireStep(action="send", data=data)


def reply(data, after_s=None):
    return WireStep(action="reply", data=data, seconds=after_s)


SILENCE = WireStep(action="silence")


def reading(*steps, expected=None, **fields):
    """Return a vector that reads 481 of drive 1, with 10.00 Hz as the default result."""
    call = VectorCall(
        call="read",
        arguments={"parameter": "481"},
        expected=expected or Expected(result={"value": "10.00", "unit": "Hz", "raw": "000003E8"}),
    )
    given = {"calls": (call,), "model": "agile", "address": 1, **fields}
    return ExchangeVector(id="x", source="here", steps=steps, **given)


SOUND = reading(send(ENQUIRY), reply(ANSWER, 0.01), send(EOT))


@EVERY_WAY
def test_correct_exchange_passes(play):
    play(VABUS, SOUND)


@FACES
@pytest.mark.parametrize("plugin", list(installed.working()), ids=lambda plugin: plugin.name)
def test_packaged_exchanges_pass_on_the_general_path_of_the_link(play, plugin, monkeypatch):
    # Force the link's general path, which it normally takes only in special cases.
    monkeypatch.setattr("drivecomm.link.line_state.LineState.is_plain_for", lambda *_: False)
    for vector in first_of_each(packaged_vectors(plugin).exchanges, shape_of_exchange):
        play(plugin, vector)


@FACES
def test_exchange_with_silence_and_a_second_attempt_passes(play):
    play(VABUS, reading(send(ENQUIRY), SILENCE, send(ENQUIRY), reply(ANSWER), send(EOT)))


@FACES
def test_exchange_without_any_reply_passes(play):
    steps = (send(ENQUIRY), SILENCE) * 2
    expected = Expected(error="NoReplyError", error_text="asked 2 times")
    play(VABUS, reading(*steps, expected=expected, options={"attempts": 2}))


@FACES
def test_exchange_with_two_silences_passes(play):
    late = (send(ENQUIRY), SILENCE, send(ENQUIRY), SILENCE, send(ENQUIRY), reply(ANSWER), send(EOT))
    play(VABUS, reading(*late))


@FACES
def test_exchange_with_garbage_before_a_reply_passes(play):
    garbage = WireStep(action="garbage", data=b"\x7f\x7f")
    play(VABUS, reading(send(ENQUIRY), garbage, reply(ANSWER), send(EOT)))


@FACES
def test_exchange_with_an_expected_error_in_the_middle_passes(play):
    failing = VectorCall(call="read", arguments={"parameter": "481"}, expected=Expected(error="NoReplyError"))
    last = SOUND.calls[0]
    steps = (send(ENQUIRY), SILENCE, send(ENQUIRY), reply(ANSWER), send(EOT))
    play(VABUS, reading(*steps, calls=(failing, last), options={"attempts": 1}))


@FACES
def test_refused_call_without_steps_passes(play):
    call = VectorCall(
        call="write", arguments={"parameter": "481", "value": "fast"}, expected=Expected(error="UsageError")
    )
    play(VABUS, reading(calls=(call,)))


@FACES
def test_broadcast_exchange_passes(play):
    stop = VectorCall(call="stop", arguments={"how": "quick"}, expected=Expected(result={}))
    data = bytes.fromhex("04 60 02 30 30 34 31 30 30 34 30 30 30 30 03 32")
    play(VABUS, reading(send(data), SILENCE, calls=(stop,), address=32))


WRONG = {
    "other bytes": (reading(send(ENQUIRY[:-1] + b"\x06")), "not 04 41 30 30 34 38 31 06"),
    "never sent": (replace(SOUND, steps=(*SOUND.steps, send(EOT))), "step 4: the master never sends 04"),
    "sent behind the end": (replace(SOUND, steps=SOUND.steps[:2]), "the steps have ended, and the master sends 04"),
    "sent too early": (
        replace(SOUND, steps=(*SOUND.steps[:2], WireStep(action="pause_s", seconds=0.5), SOUND.steps[2])),
        "ms too early for the pause of step 3",
    ),
    "given up too early": (
        reading(send(ENQUIRY), replace(SILENCE, seconds=9.0), expected=Expected(error="NoReplyError"),
                options={"attempts": 1}),
        "the master times out .* ms too early: the reply time of step 2 is 9000 ms",
    ),
    "asked again too early": (
        reading(send(ENQUIRY), replace(SILENCE, seconds=9.0), send(ENQUIRY)),
        "ms too early: the reply time of step 2",
    ),
    "left on the line": (
        replace(SOUND, steps=(*SOUND.steps, WireStep(action="garbage", data=b"\x7f"))),
        "7F was left on the line",
    ),
    "another value": (
        reading(*SOUND.steps, expected=Expected(result={"value": "1.00"})),
        "read gives value = '10.00', expected '1.00'",
    ),
    "a number for a text": (reading(*SOUND.steps, expected=Expected(result={"value": 10})), "gives value = '10.00'"),
    "a field that is not there": (
        reading(*SOUND.steps, expected=Expected(result={"colour": 1})),
        "read does not give colour",
    ),
    "something for nothing": (reading(*SOUND.steps, expected=Expected(result={})), "expected nothing"),
    "no error": (reading(*SOUND.steps, expected=Expected(error="NoReplyError")), "expected NoReplyError"),
    "another error": (
        reading(send(ENQUIRY), SILENCE, expected=Expected(error="RefusedError"), options={"attempts": 1}),
        r"read raises NoReplyError \(.*\), expected RefusedError",
    ),
    "another text": (
        reading(send(ENQUIRY), SILENCE, expected=Expected(error="NoReplyError", error_text="lunch"),
                options={"attempts": 1}),
        "with 'lunch'",
    ),
    "an error": (reading(send(ENQUIRY), SILENCE, options={"attempts": 1}), "read raises NoReplyError: vabus:1"),
    "an unknown option": (replace(SOUND, options={"colour": 1}), "there is no such drive: .*colour"),
    "an unknown model": (replace(SOUND, model="none"), "there is no such drive: .*none"),
    "no such way to stop": (
        replace(SOUND, calls=(VectorCall(call="stop", arguments={"how": "gently"}),), steps=()),
        "unknown way of stopping 'gently'",
    ),
    "not for all drives": (
        reading(calls=(VectorCall(call="status"),), address=32),
        "status raises NotSupported: a broadcast has no verb 'status'",
    ),
    "no such verb for all": (
        reading(calls=(VectorCall(call="control_word"),), address=32),
        "a broadcast has no verb 'control_word'",
    ),
}  # fmt: skip


@FACES
@pytest.mark.parametrize(("vector", "why"), WRONG.values(), ids=WRONG)
def test_deviation_from_the_vector_is_found(play, vector, why):
    with pytest.raises(CheckFailure, match=why):
        play(VABUS, vector)


def test_deviation_caught_by_the_operations_is_still_reported(with_operations):
    def swallowing(real):
        def read(parameter):
            try:
                yield from real.read(parameter)
            except AssertionError:
                return None
            return None

        return read

    plugin = with_operations("vabus", read=swallowing)
    wrong = reading(send(ENQUIRY[:-1] + b"\x06"), expected=Expected(result={}))
    with pytest.raises(CheckFailure, match="not 04 41 30 30 34 38 31 06"):
        exchanges.goes_as_written(plugin, wrong)


def test_uncompared_address_is_found_by_a_reply_of_another_drive(in_place_of):
    def mismatch(request, answer):
        found = installed_mismatch(request, answer)
        return "" if found == "address" else found

    installed_mismatch = VABUS.mismatch
    plugin = in_place_of("vabus", mismatch=mismatch)
    exchanges.goes_as_written(plugin, SOUND)
    with pytest.raises(CheckFailure):
        exchanges.passes_over_another_drive(plugin, SOUND)


LIVE = [
    exchanges.goes_as_written_over_a_terminal,
    exchanges.goes_as_written_over_a_terminal_awaited,
    exchanges.goes_as_written_over_a_socket,
    exchanges.goes_as_written_in_a_thread,
]


@pytest.mark.soak
@pytest.mark.parametrize("play", LIVE, ids=lambda play: play.__name__)
def test_exchange_passes_in_real_time(play):
    play(VABUS, SOUND)


@pytest.mark.soak
@pytest.mark.parametrize("name", ["other bytes", "never sent", "sent behind the end", "another value"])
def test_deviation_is_found_in_real_time(name):
    vector, why = WRONG[name]
    # The drive's own reply timeout applies here, because a wrong request gets no reply.
    with pytest.raises(CheckFailure, match=why):
        exchanges.play_at_port("tcp", call_blocking, VABUS, replace(vector, options={"attempts": 1}))


def test_sample_contains_only_quick_exchanges():
    slow = reading(send(ENQUIRY), SILENCE)
    quick = [replace(SOUND, id=str(number)) for number in range(10)]
    assert [vector.id for vector in exchanges.sample([slow, *quick], 3)] == ["0", "3", "6"]
    assert exchanges.sample([slow], 3) == []
    assert exchanges.sample(quick, 0) == []


@pytest.mark.parametrize("name", sorted(installed))
def test_packaged_exchanges_have_unique_ids(name):
    vectors = packaged_vectors(installed[name]).exchanges
    assert len({vector.id for vector in vectors}) == len(vectors)
