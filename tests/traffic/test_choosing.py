"""Which of several readings of the same bytes are believed."""

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


def test_more_telegrams_win_over_a_long_one():
    long, first, second = candidate(0, 60), candidate(2, 24), candidate(30, 52)
    assert choose([long, second, first]) == [first, second]


def test_who_explains_all_bytes_wins_over_a_part():
    whole, part = candidate(0, 20), candidate(1, 20)
    assert choose([part, whole]) == [whole]


def test_what_fits_the_conversation_wins():
    left, right = candidate(0, 20, merit=3), candidate(5, 25)
    assert choose([left, right]) == [left]


def test_equally_good_ones_are_left_open():
    assert choose([candidate(0, 20), candidate(5, 25)]) is None
    assert choose([candidate(0, 20), candidate(0, 20)]) is None


def test_those_that_share_nothing_are_all_chosen():
    parts = [candidate(0, 8), candidate(8, 16), candidate(20, 30)]
    assert choose(parts) == parts


def test_two_protocols_that_read_the_same_bytes_are_both_named():
    """A stranger's protocol may begin its telegrams as another one does."""
    twin = replace(FUJI, name="twin")
    found = sniffed([Piece(time_s=0.0, data=REQUEST)], [*PROTOCOLS, twin])
    (both,) = found
    assert isinstance(both, AmbiguousTelegram)
    assert {protocol for protocol, _, _ in both.readings} == {"fuji", "twin"}


def test_a_telegram_is_found_behind_a_character_that_could_begin_a_longer_one():
    """02H, and 30H as a length: a telegram of 50 bytes of the Danfoss FC protocol."""
    found = sniffed([Piece(time_s=0.0, data=b"\x02\x30" + REQUEST), Piece(time_s=0.03, data=REPLY)])
    assert [one.data for one in found if isinstance(one, HeardTelegram)] == [REQUEST, REPLY]
