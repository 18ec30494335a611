"""The choice among several readings of the same bytes."""

from dataclasses import replace

from traffic import PROTOCOLS, sniffed

from drivecomm.capture import Piece
from drivecomm.protocol import encode, installed
from drivecomm.traffic.sniffer import AmbiguousTelegram, Candidate, HeardTelegram, Reading, choose

FUJI = installed["fuji"]
REQUEST = encode("fuji", {"kind": "request", "address": 5, "command": "R", "function": "F03"}, direction="request")
REPLY = encode("fuji", {"kind": "ack", "address": 5, "command": "R", "function": "F03", "data": 50}, direction="reply")


def candidate(start, end, merit=0):
    return Candidate((Reading(start, end, FUJI, "request", bytes(end - start), object()),), merit)


def test_more_telegrams_win_over_a_single_long_one():
    long, first, second = candidate(0, 60), candidate(2, 24), candidate(30, 52)
    assert choose([long, second, first]) == [first, second]


def test_reading_of_all_bytes_wins_over_a_partial_one():
    whole, part = candidate(0, 20), candidate(1, 20)
    assert choose([part, whole]) == [whole]


def test_reading_that_fits_the_conversation_wins():
    left, right = candidate(0, 20, merit=3), candidate(5, 25)
    assert choose([left, right]) == [left]


def test_equally_good_readings_are_left_open():
    assert choose([candidate(0, 20), candidate(5, 25)]) is None
    assert choose([candidate(0, 20), candidate(0, 20)]) is None


def test_disjoint_readings_are_all_chosen():
    parts = [candidate(0, 8), candidate(8, 16), candidate(20, 30)]
    assert choose(parts) == parts


def test_two_protocols_that_read_the_same_bytes_are_both_named():
    """The protocol of another package may begin its telegrams in the same way."""
    twin = replace(FUJI, name="twin")
    found = sniffed([Piece(time_s=0.0, data=REQUEST)], [*PROTOCOLS, twin])
    (both,) = found
    assert isinstance(both, AmbiguousTelegram)
    assert {protocol for protocol, _, _ in both.readings} == {"fuji", "twin"}


class Stranger:
    """A codec that reads Danfoss FC replies as requests: those with a wrong check, and those with the value 7."""

    def __init__(self, codec):
        self.codec = codec

    def measure(self, head, direction):
        return self.codec.measure(head, "reply") if direction == "request" else 0

    def decode(self, data, direction):  # noqa: ARG002 - only requests are measured
        return self.codec.decode(data if data[10] == 7 else wrong(data), "reply")


def wrong(data):
    return data[:-1] + bytes([data[-1] ^ 0xFF])


def fc(direction, value, **words):
    fields = {"kind": "parameter", "address_format": "1-126", "address": 1, "ak": 1, "pnu": 1630}
    return encode("danfoss-fc", {**fields, "ind": 0, "pwe": value, **words}, direction=direction)


def test_due_reply_is_also_read_by_another_protocol_on_the_line():
    known = installed["danfoss-fc"]
    twin = replace(known, name="twin", codec=lambda options: Stranger(known.codec(options)))
    request = fc("request", 0, control_word=0, reference=0)
    replies = [fc("reply", value, status_word=0x607, main_actual=0) for value in (*range(20, 40), 50, 7)]
    talk = [data for reply in replies for data in (request, reply)]
    talk[-2:-2] = [wrong(replies[0]), wrong(replies[1])]
    found = sniffed([Piece(time_s=0.03 * number, data=data) for number, data in enumerate(talk, 1)], [known, twin])
    assert [one.protocol for one in found[-5:-1]] == ["danfoss-fc", "twin", "twin", "danfoss-fc"]
    assert isinstance(found[-1], AmbiguousTelegram)
    assert {protocol for protocol, _, _ in found[-1].readings} == {"danfoss-fc", "twin"}


def test_telegram_is_found_after_the_possible_start_of_a_longer_one():
    """02H, and 30H as a length: the start of a Danfoss FC telegram of 50 bytes."""
    found = sniffed([Piece(time_s=0.0, data=b"\x02\x30" + REQUEST), Piece(time_s=0.03, data=REPLY)])
    assert [one.data for one in found if isinstance(one, HeardTelegram)] == [REQUEST, REPLY]
