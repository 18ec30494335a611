"""Pairs of requests and replies, their times and outcomes; counters; names of parameters."""

import pytest
from traffic import PROTOCOLS, model_of, plant, sniffed

from drivecomm.capture import Piece
from drivecomm.errors import RefusedError
from drivecomm.protocol import encode, installed
from drivecomm.traffic.sniffer import HeardTelegram, LineMonitor, Pairing, ParameterNames

ENQUIRY = bytes.fromhex("0441303034383105")
OTHER = bytes.fromhex("0441303034383005")


def value(parameter=481, data="000003E8", address=1):
    fields = {"kind": "value", "address": address, "parameter": parameter, "data": data}
    return encode("vabus", fields, direction="reply")


def watched(*parts):
    """Return the events and the statistics of bytes at these times."""
    watch = LineMonitor(PROTOCOLS)
    events = [event for time_s, data in parts for event in watch.feed(Piece(time_s=time_s, data=data))]
    return events + watch.finish(), watch.statistics


def outcomes(events):
    return [event.pair.outcome for event in events if event.pair is not None]


def test_reply_is_paired_with_its_request_and_timed():
    events, statistics = watched((0.01, ENQUIRY), (0.04, value()))
    assert outcomes(events) == ["answered"]
    assert events[1].pair.request is events[0].item
    assert events[1].pair.reply_time_s == pytest.approx(0.03)
    assert statistics["vabus:1"].counters == {"requests": 1, "replies": 1}
    assert statistics["vabus:1"].reply_times.count == 1
    assert not any(event.wrong for event in events)


def test_repeated_request_is_a_retry_after_an_unanswered_one():
    events, statistics = watched((0.0, ENQUIRY), (0.6, ENQUIRY), (1.2, ENQUIRY), (1.23, value()))
    assert outcomes(events) == ["unanswered", "unanswered", "answered"]
    assert [event.retries for event in events if isinstance(event.item, HeardTelegram)] == [0, 1, 2, 0]
    assert events[-1].pair.retries == 2
    assert [event.wrong for event in events] == [False, True, True, True, True, False]
    assert statistics["vabus:1"].counters == {"requests": 1, "retries": 2, "replies": 1, "timeouts": 2}


def test_late_reply_is_distinguished_from_a_stray_one():
    events, statistics = watched((0.0, ENQUIRY), (0.6, OTHER), (0.8, value(481)), (0.85, value(480)), (9.0, value(480)))
    assert outcomes(events) == ["unanswered", "late", "answered", "stray"]
    late = next(event for event in events if event.pair and event.pair.outcome == "late")
    assert late.pair.reply_time_s == pytest.approx(0.8)
    assert late.wrong
    assert statistics["vabus:1"].counters["strays"] == 2


def test_reply_long_after_its_request_is_a_stray():
    events, _ = watched((0.0, ENQUIRY), (0.6, OTHER), (0.63, value(480)), (9.0, value(481)))
    assert outcomes(events) == ["unanswered", "answered", "stray"]


def test_damaged_reply_is_not_a_timeout():
    damaged = value()[:-1] + b"\x00"
    _, statistics = watched((0.0, ENQUIRY), (0.03, damaged), (0.6, ENQUIRY), (0.63, value()))
    assert statistics["vabus:1"].counters == {
        "requests": 1,
        "retries": 1,
        "replies": 1,
        "damaged": 1,
        "checksum errors": 1,
    }


def test_unknown_bytes_are_counted_for_the_line():
    _, statistics = watched((0.0, b"hello"))
    assert statistics["line"].counters == {"noise bytes": 5}


def test_unanswered_request_is_reported_at_the_end():
    events, statistics = watched((0.0, ENQUIRY))
    assert outcomes(events) == ["unanswered"]
    assert events[-1].drive == "vabus:1"
    assert statistics["vabus:1"].counters["timeouts"] == 1


def test_broadcasts_are_counted_and_expect_no_reply():
    data = encode("vabus", {"kind": "select", "address": 32, "parameter": 480, "data": "00000BB8"}, direction="request")
    events, statistics = watched((0.0, data), (1.0, ENQUIRY))
    assert statistics["vabus:all"].counters == {"requests": 1}
    assert outcomes(events) == ["unanswered"]


@pytest.mark.soak
def test_listener_counts_the_same_as_the_master():
    """The listener knows the outcome of every request; on a line without faults all are answered."""
    traffic = plant(20, seed=4)
    watch = LineMonitor(PROTOCOLS)
    for piece in traffic.pieces():
        watch.feed(piece)
    watch.finish()
    replies = sum(one.source == "drive" for one in traffic.sent)
    counted = [each.counters for each in watch.statistics.values()]
    assert sum(each["replies"] for each in counted) == replies == sum(each["requests"] for each in counted)
    assert not any(each["timeouts"] or each["retries"] or each["strays"] for each in counted)


# Names


def pairs(protocol, seed=6):
    """Return the answered requests of a plant with one drive."""
    findings = sniffed(plant(10, seed=seed, names=[(protocol, 3)]).pieces())
    pairing = Pairing(PROTOCOLS)
    found = [pair for finding in findings for pair in pairing.feed(finding)]
    return [(pair.request.message, pair.reply.message) for pair in found if pair.outcome == "answered"]


WANTED = {
    "vabus": ("481", "fixed_frequency_2", "10.00 Hz"),
    "danfoss-fc": ("16-30", "dc_link_voltage", "566 V"),
    "vlt3500": ("502[17]", "read_out_status_word", "1584"),
    "fuji": ("F03", "maximum_frequency", "50.0 Hz"),
}


@pytest.mark.parametrize("protocol", sorted(WANTED))
def test_parameters_have_names_and_values(protocol):
    plugin = installed[protocol]
    names = ParameterNames(plugin, 3, model_of(protocol), plugin.options())
    named = {
        (info.address, info.name, str(reading))
        for request, reply in pairs(protocol)
        if (info := names.parameter(request)) is not None and (reading := names.reading(request, reply)) is not None
    }
    assert WANTED[protocol] in named


def test_write_has_a_name_and_its_refusal_is_raised():
    plugin = installed["danfoss-fc"]
    names = ParameterNames(plugin, 3, model_of("danfoss-fc"), plugin.options())
    fields = {"kind": "parameter", "address_format": "1-126", "address": 3, "pnu": 341, "ind": 0}
    write = plugin.message({**fields, "ak": 13, "pwe": 300, "control_word": 0, "reference": 0}, "request")
    refusal = plugin.message({**fields, "ak": 7, "pwe": 17, "status_word": 0x607, "main_actual": 0}, "reply")
    assert names.parameter(write).name == "ramp_1_up_time"
    with pytest.raises(RefusedError, match="3-41"):
        names.reading(write, refusal)


def test_parameter_missing_in_the_model_has_no_name():
    plugin = installed["vabus"]
    names = ParameterNames(plugin, 1, model_of("vabus"), plugin.options())
    request = plugin.message({"kind": "enquiry", "address": 1, "parameter": 999}, "request")
    reply = plugin.message({"kind": "value", "address": 1, "parameter": 999, "data": "0001"}, "reply")
    assert names.parameter(request) is None
    assert names.reading(request, reply) is None
    eot = plugin.message({"kind": "eot"}, "request")
    assert names.parameter(eot) is None
