"""Detection of an unknown line: baud rate, parity and protocol, found by listening."""

from dataclasses import replace
from random import Random

import pytest
from extents import extents
from traffic import PROTOCOLS, plant

from drivecomm.capture import Piece
from drivecomm.protocol import USUAL_BAUD_RATES, LineSettings
from drivecomm.traffic.sniffer import LineSample, detect
from drivecomm.virtual import heard, received

FORMATS = {
    "vabus": ((7, "E"), (7, "O"), (8, "E"), (8, "N")),
    "danfoss-fc": ((8, "E"), (8, "O"), (8, "N")),
    "vlt3500": ((8, "N"), (8, "E"), (7, "E")),
    "fuji": ((8, "N"), (8, "E"), (8, "O"), (7, "E"), (7, "O")),
}


class Passing:
    """Traffic that continues at any settings of the listener, and is never repeated."""

    def __init__(self, sent):
        self._left = iter(sent)
        self.passed = 0

    def listen(self, settings, telegrams):
        pieces, spoilt = [], 0
        for _ in range(telegrams):
            one = next(self._left)
            self.passed += 1
            characters = received(one.data, one.settings, settings)
            spoilt += sum(not sound for _, sound in characters)
            pieces.append(Piece(time_s=one.ended, data=bytes(character for character, _ in characters)))
        return LineSample(pieces=[piece for piece in pieces if piece.data], spoilt=spoilt)


def unknown_line(seed):
    """Return the protocol, the line settings and the traffic of a random line."""
    random = Random(seed)
    protocol = random.choice(sorted(FORMATS))
    bytesize, parity = random.choice(FORMATS[protocol])
    settings = LineSettings(baudrate=random.choice(USUAL_BAUD_RATES), bytesize=bytesize, parity=parity)
    names = [(protocol, address) for address in random.sample(range(1, 30), random.randint(1, 3))]
    given = {"baudrate": settings.baudrate, "bytesize": bytesize, "parity": parity}
    traffic = plant(600, telegrams=210, rate=0.02, seed=seed, names=names, settings=given, pauses=(0.0, 0.1, 0.4))
    return protocol, settings, traffic.sent


@pytest.mark.soak
@extents(12, 50)
def test_unknown_lines_are_identified_within_two_hundred_telegrams(extent):
    failed = []
    for seed in range(extent):
        protocol, settings, sent = unknown_line(seed)
        line = Passing(sent)
        found = detect(line, PROTOCOLS)
        assert line.passed <= 200
        if found is None or (found.protocols[:1], found.settings) != ((protocol,), settings):
            failed.append((seed, protocol, settings, found))
    assert len(failed) <= extent // 50, failed


def test_all_protocols_of_a_line_are_named_and_stop_bits_stay_open():
    two_stop_bits = {"baudrate": 19200, "bytesize": 8, "parity": "N", "stopbits": 2}
    found = detect(Passing(plant(600, telegrams=210, seed=1, settings=two_stop_bits).sent), PROTOCOLS)
    assert set(found.protocols) == {"vabus", "danfoss-fc", "vlt3500", "fuji"}
    assert found.settings == LineSettings(baudrate=19200)
    assert found.spoilt == 0
    assert found.understood > 0.9


@pytest.mark.parametrize("seed", range(3))
def test_noise_is_not_detected_as_a_protocol(seed):
    random = Random(seed)
    sent = plant(600, telegrams=210, seed=seed, settings={"baudrate": 9600, "bytesize": 8, "parity": "N"}).sent
    noise = [replace(one, data=random.randbytes(len(one.data))) for one in sent]
    line = Passing(noise)
    assert detect(line, PROTOCOLS) is None
    assert line.passed <= 200


def test_single_telegram_is_not_enough_for_a_detection():
    enquiry = bytes.fromhex("0441303034383105")

    class Once:
        def listen(self, *_):
            return LineSample(pieces=[Piece(time_s=1.0, data=enquiry)], spoilt=0)

    class Twice:
        def listen(self, *_):
            return LineSample(pieces=[Piece(time_s=at, data=enquiry) for at in (1.0, 2.0)], spoilt=0)

    assert detect(Once(), PROTOCOLS) is None
    assert detect(Twice(), PROTOCOLS).protocols == ("vabus",)


def test_silent_line_is_not_detected():
    class Silent:
        def listen(self, *_):
            return LineSample(pieces=[], spoilt=0)

    assert detect(Silent(), PROTOCOLS) is None


@pytest.mark.parametrize("sender", [LineSettings(parity="E"), LineSettings(bytesize=7, parity="O"), LineSettings()])
@pytest.mark.parametrize("receiver", [LineSettings(parity="E"), LineSettings(parity="O"), LineSettings(baudrate=19200)])
def test_receiver_with_parity_check_gets_the_same_characters(sender, receiver):
    data = bytes(range(16, 128, 7))
    characters = received(data, sender, receiver)
    assert bytes(character for character, _ in characters) == heard(data, sender, receiver)
    assert all(sound for _, sound in characters) == (sender == receiver)
