"""Fuzz targets: each passes on its seeds and some hundred mutations, and detects planted flaws."""

import dataclasses
from random import Random

import pytest
from all_targets import all_targets
from mutation import LONGEST
from sniffer_target import pieces_of
from target import PropertyBrokenError
from telegram_targets import telegram_targets

import drivecomm
from drivecomm.errors import TelegramError

NAMES = tuple(all_targets())


def target_of(plugin, kind):
    return next(each for each in telegram_targets(plugin) if each.name.endswith(kind))


def test_every_reader_has_a_target():
    for protocol in drivecomm.protocols():
        assert {f"{protocol}-{what}" for what in ("decoder", "framer", "encoder", "orders")} <= set(NAMES)
    assert {
        "vector-files",
        "model-files",
        "plant-files",
        "capture-json-lines",
        "capture-pcapng",
        "sniffer",
    } <= set(NAMES)


@pytest.mark.soak
@pytest.mark.parametrize("name", NAMES)
def test_seeds_reveal_no_flaw(name):
    target = all_targets()[name]
    assert target.seeds
    # The floods are the last seeds.
    for seed in (*target.seeds[:40], *target.seeds[-4:]):
        target.check(seed)


@pytest.mark.soak
@pytest.mark.parametrize("name", NAMES)
def test_some_hundred_mutations_reveal_no_flaw(name):
    target, random = all_targets()[name], Random(name)
    for _ in range(300 if name != "sniffer" else 150):
        data = target.mutate(random, random.choice(target.seeds), target.seeds)
        assert len(data) <= 2 * LONGEST
        target.check(data)


@pytest.mark.parametrize("name", NAMES)
def test_empty_and_random_bytes_reveal_no_flaw(name):
    target, random = all_targets()[name], Random(5)
    target.check(b"")
    for size in range(1, 60):
        target.check(random.randbytes(size))


class Wrapped:
    """Codec with a faulty part."""

    def __init__(self, codec, **parts):
        self._codec = codec
        self._parts = parts

    def __getattr__(self, name):
        return self._parts.get(name) or getattr(self._codec, name)


def with_codec(**parts):
    plugin = drivecomm.protocols()["vabus"]
    return dataclasses.replace(plugin, codec=lambda options: Wrapped(plugin.codec(options), **parts))


def fails(target, error):
    for seed in reversed(target.seeds):
        try:
            target.check(seed)
        except error:
            return True
    return False


def test_decoder_raising_a_foreign_error_is_detected():
    def decode(data, _direction):
        raise KeyError(len(data))

    assert fails(target_of(with_codec(decode=decode), "-decoder"), KeyError)


def test_encoder_disagreeing_with_the_decoder_is_detected():
    codec = drivecomm.protocols()["vabus"].codec(drivecomm.protocols()["vabus"].options())
    other = codec.encode(codec.decode(bytes.fromhex("04 41 30 30 34 38 31 05"), "request"))
    target = target_of(with_codec(encode=lambda _message: other), "-decoder")
    assert fails(target, (PropertyBrokenError, TelegramError))


def test_framer_holding_all_bytes_is_detected():
    target = target_of(with_codec(measure=lambda head, _direction: len(head) + 1), "-framer")
    assert fails(target, PropertyBrokenError)


def test_encoder_writing_invalid_telegrams_is_detected():
    assert fails(target_of(with_codec(encode=lambda _message: b"\x00"), "-encoder"), PropertyBrokenError)


def test_sniffer_holding_all_bytes_is_detected(monkeypatch):
    monkeypatch.setattr("drivecomm.traffic.sniffer.sniffer._LONGEST_UNKNOWN", 10**6)
    assert fails(all_targets()["sniffer"], PropertyBrokenError)


def test_sniffer_input_is_decoded_to_pieces_of_both_sides():
    pieces = list(pieces_of(bytes([0x60, 0x04, 0x82, 0x01, 0x02, 0x03, 0x05])))
    assert [(piece.source, piece.data) for piece in pieces] == [("master", b"\x04"), ("drive", b"\x01\x02\x03")]
    assert pieces[0].time_s > 0.2
    assert pieces[1].time_s - pieces[0].time_s < 0.2
