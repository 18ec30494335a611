"""The direction of a telegram, estimated from its bytes and its time."""

from types import SimpleNamespace

import pytest

from drivecomm.traffic.sniffer.directions import DirectionEstimator, Observation
from drivecomm.traffic.sniffer.readings import Reading

TIMEOUT_S = 0.1
TIMING = SimpleNamespace(reply_timeout_s=TIMEOUT_S, late_s=0.25)
DRIVE = SimpleNamespace(address=1)
PROTOCOL = SimpleNamespace(facts=SimpleNamespace(timing=TIMING), mismatch=lambda *_: "", broadcast_address=None)


def either(data):
    """Return both readings of a telegram that could be a request or a reply."""
    return [Reading(0, len(data), PROTOCOL, direction, data, DRIVE) for direction in ("request", "reply")]


def heard(data, began_s, silence_s):
    return Observation(either(data), began_s, began_s + 0.02, silence_s)


def after(exchanges):
    """Return the estimator after these exchanges, one second each, and the time."""
    estimator = DirectionEstimator(PROTOCOL)
    for number, (asked, answered) in enumerate(exchanges):
        request, reply = either(asked)[0], either(answered)[1]
        estimator.take(request, number, number + 0.02)
        estimator.take(reply, number + 0.03, number + 0.05)
    return estimator, len(exchanges)


@pytest.mark.parametrize(("again", "direction"), [(b"ab00", "request"), (b"ad00", "reply")])
def test_possibly_late_telegram_heard_before_keeps_its_direction(again, direction):
    estimator, now = after([(b"ab00", b"ad00"), (b"cd00", b"cb00")])
    estimator.take(either(b"cd00")[0], now, now + 0.02)
    late_s = now + 0.02 + 5 * TIMEOUT_S
    assert estimator.direction_of(heard(again, late_s, late_s - now - 0.02)) == direction


@pytest.mark.parametrize(("data", "direction"), [(b"QQQ9_", "request"), (b"PPP9_", "reply")])
def test_telegram_due_as_a_reply_is_one_unless_it_resembles_requests(data, direction):
    estimator, now = after([(b"QQQ%d_" % number, b"PPP%d_" % number) for number in range(6)])
    estimator.take(either(b"QQQ0_")[0], now, now + 0.02)
    assert estimator.direction_of(heard(data, now + 0.03, 0.01)) == direction


@pytest.mark.parametrize(("like_requests", "is_reply"), [(1, True), (2, False)])
def test_two_bytes_typical_of_requests_outweigh_a_due_reply(like_requests, is_reply):
    asked, answered = b"__" + b"Q" * like_requests, b"__" + b"P" * like_requests
    estimator, now = after([(asked + b"%d_" % number, answered + b"%d_" % number) for number in range(6)])
    estimator.take(either(asked + b"0_")[0], now, now + 0.02)
    assert (estimator.direction_of(heard(asked + b"9_", now + 0.03, 0.01)) == "reply") is is_reply
