"""Any flood of bytes costs the same effort per byte; the effort is the number of sniffer lines executed."""

import sys
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from random import Random

import pytest
from extents import every
from traffic import PROTOCOLS

import drivecomm.traffic.sniffer as room
from drivecomm.capture import Piece
from drivecomm.protocol import LineSettings, encode
from drivecomm.traffic.sniffer import Candidate, HeardTelegram, Sniffer, TelegramReading, choose

ROOM = str(Path(room.__file__).parent)
SETTINGS = LineSettings(baudrate=115200)
# At 115200 baud a character lasts 87 microseconds; an ordinary computer executes some 2000 lines in that time.
MOST_LINES = 60 * len(PROTOCOLS)

ENQUIRY = bytes.fromhex("0441303034383105")
VALUE = encode("vabus", {"kind": "value", "address": 1, "parameter": 481, "data": "000003E8"}, direction="reply")
WRITE = encode("fuji", {"kind": "request", "address": 5, "command": "R", "function": "F03"}, direction="request")
PROCESS = encode(
    "danfoss-fc",
    {"kind": "process", "address_format": "1-126", "address": 3, "control_word": 0x43C, "reference": 0x1000},
    direction="request",
)
STARTS = b"\x01\x02\x04<A"

FLOODS = {
    "start of VLT": b"<",
    "start of VABus": b"\x04",
    "start of FC": b"\x02",
    "start of Fuji": b"\x01",
    "start of 7E1": b"\x84",
    "nothing": b"\x00",
    "heads of long FC texts": b"\x02\xfe\x83\xf0\x00\x05",
    "heads of VABus": b"\x04A00",
    "heads of Fuji": b"\x0101R",
    "selects without end": b"\x04A\x020481",
    "sound FC": PROCESS,
    "sound enquiries": ENQUIRY,
    "all starts": bytes(Random(2).choices(STARTS, k=997)),
    "noise": Random(1).randbytes(4096),
}


@contextmanager
def counted():
    """Count the lines that the sniffer executes."""
    lines = [0]

    def inside(_frame, event, _argument):
        lines[0] += event == "line"
        return inside

    def entered(frame, _event, _argument):
        return inside if frame.f_code.co_filename.startswith(ROOM) else None

    before = sys.gettrace()
    sys.settrace(entered)
    try:
        yield lines
    finally:
        sys.settrace(before)


def effort(flood, size, chunk):
    """Return the number of lines executed for a flood that follows a conversation and never pauses."""
    sniffer = Sniffer(PROTOCOLS, settings=SETTINGS)
    for number, data in enumerate((ENQUIRY, VALUE, WRITE)):
        sniffer.feed(Piece(time_s=0.1 * number, data=data))
    data = (flood * (size // len(flood) + 1))[:size]
    now = 1.0
    with counted() as lines:
        for start in range(0, size, chunk):
            piece = data[start : start + chunk]
            now += len(piece) * SETTINGS.character_s
            sniffer.feed(Piece(time_s=now, data=piece))
        sniffer.finish()
    return lines[0]


@pytest.mark.soak
@pytest.mark.parametrize("chunk", [1, 64])
@pytest.mark.parametrize("flood", every(2, FLOODS))
def test_longer_flood_costs_no_more_per_byte(flood, chunk):
    short, long = (effort(FLOODS[flood], size, chunk) for size in (700, 2100))
    assert long <= MOST_LINES * 2100
    assert long <= 3.5 * short


def test_telegrams_are_found_again_after_a_flood():
    sniffer = Sniffer(PROTOCOLS, settings=SETTINGS)
    found = sniffer.feed(Piece(time_s=1.0, data=b"<" * 10_000))
    found += sniffer.feed(Piece(time_s=2.0, data=ENQUIRY))
    found += sniffer.feed(Piece(time_s=2.03, data=VALUE)) + sniffer.finish()
    assert [one.data for one in found if isinstance(one, HeardTelegram)] == [ENQUIRY, VALUE]
    assert b"".join(one.data for one in found) == b"<" * 10_000 + ENQUIRY + VALUE


@pytest.mark.soak
def test_overlapping_readings_are_chosen_without_trying_all_combinations():
    """A chain of 200 has more combinations than could ever be tried."""
    readings = [TelegramReading(at, at + 9, PROTOCOLS[0], "request", bytes(9), object()) for at in range(0, 1600, 8)]
    chain = [Candidate((reading,), 0) for reading in readings]
    with counted() as lines:
        assert choose(chain) is None
    assert lines[0] < 1_000_000


@cache
def effort_of_noise():
    """Return the effort of the noise flood, to which other floods are compared."""
    return effort(FLOODS["noise"], 20_000, 512)


@pytest.mark.soak
@pytest.mark.parametrize("flood", ["start of VABus", "start of 7E1"])
def test_flood_of_single_characters_costs_no_more_than_noise(flood):
    # 04 and 84 are also function codes of Modbus.
    # An EOT begins telegrams of VABus, Control Techniques, WEG and EI Bisynch.
    assert effort(FLOODS[flood], 20_000, 512) < 3 * effort_of_noise()


def test_single_character_repeated_a_few_times_counts_as_telegrams():
    def kinds(number):
        sniffer, found = Sniffer(PROTOCOLS, settings=SETTINGS), []
        for at, data in enumerate((ENQUIRY, VALUE, b"\x04" * number)):
            found += sniffer.feed(Piece(time_s=0.05 * at, data=data))
        return [len(each.data) for each in found + sniffer.finish()][2:]

    assert kinds(1) == [1]
    assert kinds(2) == [1, 1]
    assert kinds(30) == [30]


def polled(sniffer):
    """Feed reads of one VABus drive with a new value each time; return the number of findings after each telegram."""
    certain, at_s = [], 0.0
    for number in range(200):
        reply = {"kind": "value", "address": 1, "parameter": 481, "data": f"{number:08X}"}
        for data in (ENQUIRY, encode("vabus", reply, direction="reply"), b"\x04"):
            at_s += len(data) * SETTINGS.character_s
            # The next request follows the closing EOT without any pause.
            certain.append(len(sniffer.feed(Piece(time_s=at_s, data=data))))
            at_s += 0.01 if data == ENQUIRY else 0.0
    return certain


def test_unspoken_protocols_cost_little_and_delay_nothing():
    """A Modbus telegram can begin with nearly any byte, and an EOT could begin a long one."""
    with counted() as alone:
        polled(Sniffer([each for each in PROTOCOLS if each.name == "vabus"], settings=SETTINGS))
    with counted() as among_all:
        certain = polled(Sniffer(PROTOCOLS, settings=SETTINGS))
    # From Python 3.12 on, each turn of a comprehension counts as a line.
    assert among_all[0] < 2.1 * alone[0]
    settled = certain[30:]
    # An EOT is certain when the next request is there.
    assert settled == [2, 1, 0] * (len(settled) // 3)
