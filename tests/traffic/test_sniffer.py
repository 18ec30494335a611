"""Telegrams of several protocols and both directions, found in one stream of bytes."""

from collections import Counter
from dataclasses import replace
from math import ceil
from random import Random

import pytest
from hypothesis import given, settings, strategies as st
from traffic import ALL, DIRECTIONS, PROTOCOLS, Meant, Traffic, heard, plant, sniffed, telegrams, told

from drivecomm.capture import Piece
from drivecomm.protocol import LineSettings, encode, installed
from drivecomm.traffic.sniffer import AmbiguousTelegram, HeardTelegram, LineMonitor, Sniffer, UnknownBytes
from drivecomm.virtual import heard as as_heard


@pytest.fixture(scope="module")
def clean():
    return plant(40, seed=1)


@pytest.fixture(scope="module")
def noisy():
    return plant(60, seed=2, rate=0.1)


def characters(pieces, size):
    """Cut pieces into smaller ones, each with the time of its last character."""
    for piece in pieces:
        length, character_s, at = len(piece.data), piece.settings.character_s, 0
        while at < length:
            end = min(length, at + size())
            yield replace(piece, data=piece.data[at:end], time_s=piece.time_s - (length - end) * character_s)
            at = end


# Mixed traffic


@pytest.mark.soak
def test_sniffer_finds_telegrams_in_an_hour_of_mixed_noisy_traffic():
    traffic = plant(3600, seed=1, rate=0.01, pauses=(0.0, 0.03, 0.4, 1.5, 3.0))
    found = sniffed(traffic.pieces())
    sound = heard(found)
    undamaged = traffic.undamaged
    assert undamaged.total() > 5000
    assert {one.protocol for one in telegrams(found)} == {"vabus", "danfoss-fc", "vlt3500", "fuji"}
    assert (undamaged - sound).total() <= undamaged.total() * 0.0015
    assert not sound - traffic.on_the_wire
    # A changed telegram that is still sound has no check, and is marked so.
    changed = sound - undamaged
    assert not [
        one for one in telegrams(found) if one.guarded and changed[one.direction, one.data, round(one.time_s, 6)]
    ]


def test_all_telegrams_are_found_without_noise(clean):
    found = sniffed(clean.pieces())
    assert heard(found) == clean.undamaged == clean.on_the_wire
    assert len(telegrams(found)) == len(found)


@pytest.mark.parametrize(("rate", "seed"), [(0.1, 19), (0.2, 0), (0.2, 1), (0.2, 2), (0.3, 0), (0.3, 4), (0.3, 9)])
def test_very_bad_line_gives_no_invented_telegrams(rate, seed):
    traffic = plant(60, seed=seed, rate=rate, pauses=(0.0, 0.03, 0.4, 1.5, 3.0))
    found = sniffed(traffic.pieces())
    assert not heard(found) - traffic.on_the_wire
    assert (traffic.undamaged - heard(found)).total() <= 0.06 * traffic.undamaged.total()


# Remains of damaged telegrams

ENQUIRY = bytes.fromhex("0441303034383105")
VALUE = encode("vabus", {"kind": "value", "address": 1, "parameter": 481, "data": "000003E8"}, direction="reply")


def closing(*parts):
    """Return the findings for these bytes, at these seconds after conversations that all end with EOT."""
    pieces = []
    for number in range(6):
        pieces += [
            Piece(time_s=number + 0.1, data=ENQUIRY),
            Piece(time_s=number + 0.13, data=VALUE),
            Piece(time_s=number + 0.135, data=b"\x04"),
        ]
    pieces += [Piece(time_s=8.1, data=ENQUIRY), Piece(time_s=8.13, data=VALUE)]
    pieces += [Piece(time_s=8.13 + after_s, data=data) for after_s, data in parts]
    found = sniffed(pieces)
    known = [ENQUIRY, VALUE, b"\x04"] * 6 + [ENQUIRY, VALUE]
    assert [one.data for one in telegrams(found)][: len(known)] == known
    return found[len(known) :]


def test_eot_is_a_telegram_if_all_conversations_end_with_one():
    (found,) = closing((0.005, b"\x04"))
    assert isinstance(found, HeardTelegram)


def test_eot_with_a_wrong_bit_7_is_not_a_seven_bit_eot():
    (found,) = closing((0.005, b"\x84"))
    assert found.data == b"\x84"
    assert not isinstance(found, HeardTelegram)


@pytest.mark.parametrize("request_", [b"\x04\xf900480\x05", b"\x04A>0411\x05"], ids=["address", "parameter"])
def test_first_character_of_a_damaged_request_is_not_an_eot(request_):
    found = closing((0.4, request_))
    assert b"".join(one.data for one in found) == request_
    assert not telegrams(found)


# Late replies that look like requests

FC = {"kind": "parameter", "address_format": "1-126", "address": 3, "pnu": 1614, "ind": 0}
READ = encode("danfoss-fc", {**FC, "ak": 1, "pwe": 0, "control_word": 0x43C, "reference": 0}, direction="request")
WORD = encode("danfoss-fc", {**FC, "ak": 2, "pwe": 0, "status_word": 0x607, "main_actual": 0}, direction="reply")


def known_line():
    """Return an exchange that settles the directions on the line; it holds no reply to a parameter request."""
    process = {"kind": "process", "address_format": "1-126", "address": 3}
    request = encode("danfoss-fc", {**process, "control_word": 0x47C, "reference": 0}, direction="request")
    reply = encode("danfoss-fc", {**process, "status_word": 0xF07, "main_actual": 0}, direction="reply")
    return [Piece(time_s=time_s, data=data) for time_s, data in ((5.0, request), (5.02, reply))]


@pytest.mark.parametrize("late_s", [0.2, 0.4, 1.0])
def test_possible_late_reply_is_not_called_a_request(late_s):
    pieces = [*known_line(), Piece(time_s=6.0, data=READ), Piece(time_s=6.0 + late_s, data=WORD)]
    asked, answered = sniffed(pieces)[2:]
    assert (asked.direction, asked.data) == ("request", READ)
    assert isinstance(answered, AmbiguousTelegram)


def test_late_reply_is_recognised_once_the_replies_of_its_drive_are_known():
    usual = [(6.0, READ), (6.02, WORD)]
    late = encode("danfoss-fc", {**FC, "ak": 2, "pwe": 7, "status_word": 0x607, "main_actual": 0}, direction="reply")
    pieces = [*known_line(), *(Piece(time_s=time_s, data=data) for time_s, data in [*usual, (7.0, READ), (7.4, late)])]
    assert [one.direction for one in sniffed(pieces)[-2:]] == ["request", "reply"]


def test_requests_to_an_absent_drive_are_soon_recognised():
    absent = {"kind": "process", "address_format": "1-126", "address": 9, "control_word": 0x47C}
    asked = [
        Piece(time_s=6 + number, data=encode("danfoss-fc", {**absent, "reference": number}, direction="request"))
        for number in range(12)
    ]
    found = sniffed([*known_line(), *asked])[2:]
    assert {one.direction for one in telegrams(found)} == {"request"}
    assert all(isinstance(one, HeardTelegram) for one in found[-5:])


# Pieces of any size


@pytest.mark.soak
def test_pieces_of_any_size_give_the_same_telegrams(noisy):
    whole = heard(sniffed(noisy.pieces()))
    random = Random(1)
    for size in (lambda: 1, lambda: random.randint(1, 7)):
        cut = sorted(characters(noisy.pieces(), size), key=lambda piece: piece.time_s)
        assert heard(sniffed(cut)) == whole


@pytest.mark.soak
def test_adapter_that_delivers_every_16_ms_hides_no_telegram(clean):
    handed = {}
    for piece in sorted(characters(clean.pieces(), lambda: 1), key=lambda piece: piece.time_s):
        handed.setdefault(ceil(piece.time_s / 0.016) * 0.016, bytearray()).extend(piece.data)
    found = sniffed([Piece(time_s=time_s, data=bytes(data)) for time_s, data in handed.items()])
    wanted = Counter((direction, data) for direction, data, _ in heard(sniffed(clean.pieces())).elements())
    assert Counter((one.direction, one.data) for one in telegrams(found)) == wanted


def test_findings_come_in_the_order_of_the_line(noisy):
    found = sniffed(noisy.pieces())
    assert [one.time_s for one in found] == sorted(one.time_s for one in found)


def test_every_byte_is_in_exactly_one_finding(noisy):
    found = sniffed(noisy.pieces())
    assert b"".join(one.data for one in found) == b"".join(piece.data for piece in noisy.pieces())


def test_sources_of_a_capture_are_trusted(clean):
    pieces = [Piece(time_s=one.ended, data=one.data, settings=one.settings, source=one.source) for one in clean.sent]
    # A capture that begins with a reply leaves nothing open.
    found = sniffed(pieces[1:])
    assert not heard(found) - clean.on_the_wire
    assert not [one for one in found if isinstance(one, AmbiguousTelegram) and one.data != b"\x04"]


@pytest.mark.soak
def test_start_in_the_middle_turns_no_request_into_a_reply(clean):
    for first in range(1, 12):
        rest = Traffic(clean.sent[first:])
        found = heard(sniffed(rest.pieces()))
        assert not found - rest.on_the_wire
        # Its first telegrams may be ambiguous, or reply to a request that was not heard.
        assert (rest.undamaged - found).total() <= 3


@pytest.mark.soak
def test_seven_bit_drive_is_found_among_eight_bit_ones():
    listener = LineSettings()
    traffic = plant(20, seed=3, settings={"baudrate": 9600})
    pieces = [
        Piece(time_s=one.ended, data=as_heard(one.data, one.settings, listener), settings=listener)
        for one in traffic.sent
        if one.settings.parity == "N" or one.settings.bytesize == 7
    ]
    wanted = Counter(told(one) for one in traffic.sent if one.settings.parity == "N" or one.settings.bytesize == 7)
    found = heard(sniffed(pieces))
    assert found == wanted
    assert {"vabus", "fuji", "vlt3500"} == {one.protocol for one in telegrams(sniffed(pieces))}


@pytest.mark.parametrize("seed", range(2))
def test_drives_with_different_line_settings_are_understood(seed):
    """The pieces have their own settings, as in a capture by the master itself."""
    traffic = plant(20, seed=seed, settings={})
    assert heard(sniffed(traffic.pieces())) == traffic.on_the_wire


# Ambiguity


def test_eot_is_ambiguous_if_no_conversation_ends_with_one():
    """On such a line, a single EOT is the rest of a broken request."""
    enquiry = bytes.fromhex("0441303034383105")
    value = encode("vabus", {"kind": "value", "address": 1, "parameter": 481, "data": "000003E8"}, direction="reply")
    talk = [(number + part, data) for number in range(6) for part, data in ((0.0, enquiry), (0.05, value))]
    found = sniffed([Piece(time_s=time_s, data=data) for time_s, data in [*talk, (5.5, b"\x04")]])
    assert isinstance(found[-1], AmbiguousTelegram)
    assert len(telegrams(found)) == len(talk)
    with_eot = sorted([*talk, *((time_s + 0.01, b"\x04") for time_s, data in talk if data == value)])
    assert len(telegrams(sniffed([Piece(time_s=time_s, data=data) for time_s, data in with_eot]))) == len(with_eot)


def test_telegram_with_two_possible_directions_is_ambiguous():
    data = encode(
        "danfoss-fc",
        {"kind": "process", "address_format": "1-31", "address": 3, "control_word": 1, "reference": 0},
        direction="request",
    )
    (found,) = sniffed([Piece(time_s=0.01, data=data)])
    assert isinstance(found, AmbiguousTelegram)
    assert [(protocol, direction) for protocol, direction, _ in found.readings] == [
        ("danfoss-fc", "request"),
        ("danfoss-fc", "reply"),
    ]


def test_telegram_after_a_long_silence_is_a_request():
    fields = {"kind": "process", "address_format": "1-31", "address": 3}
    request = encode("danfoss-fc", {**fields, "control_word": 0x47C, "reference": 0}, direction="request")
    reply = encode("danfoss-fc", {**fields, "status_word": 0xF07, "main_actual": 0}, direction="reply")
    found = sniffed([Piece(time_s=5.0, data=request), Piece(time_s=5.02, data=reply)])
    assert [one.direction for one in found] == ["request", "reply"]


def test_acknowledge_without_a_request_is_not_a_telegram():
    assert sniffed([Piece(time_s=1.0, data=b"\x41\x06")]) == [UnknownBytes(time_s=1.0, data=b"\x41\x06")]


def test_wrong_check_is_a_damaged_reply_of_the_drive_requested():
    enquiry = bytes.fromhex("0441303034383105")
    value = encode("vabus", {"kind": "value", "address": 1, "parameter": 481, "data": "000003E8"}, direction="reply")
    pieces = [Piece(time_s=0.0, data=enquiry), Piece(time_s=0.03, data=value[:-1] + bytes([value[-1] ^ 1]))]
    request, damaged = sniffed(pieces)
    assert isinstance(request, HeardTelegram)
    assert not request.guarded
    assert (damaged.protocol, damaged.direction, damaged.drive) == ("vabus", "reply", "vabus:1")
    assert damaged.error.category == "checksum"


def test_damage_is_not_ascribed_to_an_unspoken_protocol():
    assert isinstance(sniffed([Piece(time_s=0.0, data=b"<01R")])[0], UnknownBytes)


def test_select_is_not_mistaken_for_the_reply_it_contains():
    fields = {"address": 1, "parameter": 480, "data": "00000BB8"}
    select = encode("vabus", {"kind": "select", **fields}, direction="request")
    assert select[1:] == encode("vabus", {"kind": "value", **fields}, direction="reply")
    (found,) = sniffed([Piece(time_s=1.0, data=select)])
    assert (found.direction, found.data) == ("request", select)


def test_silence_ends_an_unfinished_telegram():
    sniffer = Sniffer(PROTOCOLS, settings=LineSettings())
    assert sniffer.feed(Piece(time_s=1.0, data=bytes.fromhex("04413030"))) == []
    assert sniffer.flush(1.01) == []
    (found,) = sniffer.flush(1.2)
    assert found.data == bytes.fromhex("04413030")
    assert sniffer.finish() == []


def test_broadcast_is_for_all_drives_and_expects_no_reply():
    data = encode("vabus", {"kind": "select", "address": 32, "parameter": 480, "data": "00000BB8"}, direction="request")
    (found,) = sniffed([Piece(time_s=1.0, data=data)])
    assert (found.drive, found.broadcast, found.expects_reply, found.guarded) == ("vabus:all", True, False, False)


@settings(deadline=None)
@given(st.binary(max_size=400))
def test_noise_causes_no_error_and_loses_no_byte(data):
    found = sniffed([Piece(time_s=1.0, data=data)])
    assert b"".join(one.data for one in found) == data


@pytest.mark.soak
@settings(deadline=None)
@given(st.lists(st.tuples(st.binary(min_size=1, max_size=30), st.floats(0, 0.2)), max_size=20))
def test_bytes_at_any_time_are_all_in_a_finding(parts):
    pieces, now = [], 0.0
    for data, pause in parts:
        now += pause
        pieces.append(Piece(time_s=now, data=data))
    assert b"".join(one.data for one in sniffed(pieces)) == b"".join(data for data, _ in parts)


def test_unselected_protocol_is_not_found(clean):
    only = [installed["fuji"]]
    assert {one.protocol for one in telegrams(sniffed(clean.pieces(), only))} == {"fuji"}


def test_virtual_traffic_marks_damaged_telegrams():
    traffic = plant(20, seed=3, rate=0.5, names=ALL[:1])
    spoilt = [one for one in traffic.sent if not isinstance(one.data, Meant)]
    assert spoilt
    assert {one.source for one in traffic.sent} == set(DIRECTIONS)


# A reply that equals its request completely


def fc(direction, ak, pnu, pwe, word):
    words = ("control_word", "reference") if direction == "request" else ("status_word", "main_actual")
    fields = {"kind": "parameter", "address_format": "1-126", "address": 1, "ind": 0, "ak": ak, "pnu": pnu, "pwe": pwe}
    return encode("danfoss-fc", {**fields, words[0]: word, words[1]: 0}, direction=direction)


FC_SETTINGS = LineSettings()
VOLTAGE = (fc("request", 1, 1630, 0, 0), fc("reply", 1, 1630, 560, 0x607))
CURRENT = (fc("request", 1, 1614, 0, 0), fc("reply", 1, 1614, 0, 0x607))
NOTHING = (fc("request", 0, 0, 0, 0), fc("reply", 0, 0, 0, 0))
ROUND = (*VOLTAGE, *CURRENT, *NOTHING)


def said(*talk, pause_s=0.02):
    """Feed the telegrams of a master and its drive; None is a missed telegram.

    Return the directions and the outcomes.
    """
    watch, now, events = LineMonitor(PROTOCOLS), 0.0, []
    for number, data in enumerate(talk):
        now += (0.01 if number % 2 else pause_s) + 16 * FC_SETTINGS.character_s
        if data is not None:
            events += watch.feed(Piece(time_s=now, data=data))
    events += watch.finish()
    directions = [event.item.direction for event in events if isinstance(event.item, HeardTelegram)]
    return directions, [event.pair.outcome for event in events if event.pair]


def test_reply_that_equals_its_request_is_recognised_by_its_time():
    assert NOTHING[0] == NOTHING[1]
    directions, outcomes = said(*ROUND * 4)
    assert directions == ["request", "reply"] * 12
    assert outcomes == ["answered"] * 12


@pytest.mark.parametrize("missed", range(6))
def test_reply_that_equals_its_request_is_recognised_after_a_missed_half(missed):
    talk = [*ROUND, *ROUND, *ROUND, *ROUND, *ROUND]
    talk[12 + missed] = None
    directions, outcomes = said(*talk)
    assert len(directions) == 29
    assert len(outcomes) - outcomes.count("answered") == 1
    assert directions[18:] == (["request", "reply"] * 15)[19:]


def test_repetition_outside_the_reply_time_is_not_a_reply():
    again = [*ROUND, *ROUND, CURRENT[0]]
    watch, now, events = LineMonitor(PROTOCOLS), 0.0, []
    for number, data in enumerate(again):
        now += (0.01 if number % 2 else 0.02) + 16 * FC_SETTINGS.character_s
        events += watch.feed(Piece(time_s=now, data=data))
    for pause_s in (0.0, 0.08):
        now += pause_s + 16 * FC_SETTINGS.character_s
        events += watch.feed(Piece(time_s=now, data=CURRENT[0]))
    events += watch.finish()
    assert [event.item.direction for event in events if event.item][-3:] == ["request"] * 3
    assert [event.retries for event in events if event.item][-3:] == [0, 1, 2]


def test_unusual_reply_still_answers_its_request():
    said = ["U@@@@0516+00030076", "U@CF@0516+03000287", "C@@@@0000+00000043", "C@CF@0000+00000052"]
    said += ["COGD@0000+00000069", "CG@N@0000+00000064", "C@@@@0000+00000043", "CG@N@0000+00000064"]
    said += ["COCD@0000+00000065", "CG@N@0000+00000064"]
    pieces = [Piece(time_s=0.033 * n, data=f"<01{text}>".encode()) for n, text in enumerate(said, start=1)]
    sniffer = Sniffer([installed["vlt3500"]])
    found = [finding for piece in pieces for finding in sniffer.feed(piece)] + sniffer.finish()
    assert [finding.direction for finding in found] == ["request", "reply"] * 5
