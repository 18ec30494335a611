"""Vectors from captures: the strict reader of the kit accepts them, and every check of the kit passes."""

import tomllib
from dataclasses import replace
from datetime import UTC, datetime

import pytest
from hypothesis import given, strategies as st
from sessions import record, work_with_everybody
from test_telling_apart import overheard

from drivecomm.capture import Capture, Piece, Provenance
from drivecomm.errors import TelegramError
from drivecomm.protocol import installed
from drivecomm.testing import carry_out, checks_of, load_vectors, packaged_vectors, run_checks
from drivecomm.tomlfile import toml_value
from drivecomm.traffic.replay import heard_telegrams, vectors_text
from drivecomm.virtual import VirtualLine, virtual_drive

READ = bytes.fromhex("04 41 30 30 34 38 31 05")
NAMES = ["vabus", "danfoss-fc", "vlt3500", "fuji"]
SESSION, _ = record(work_with_everybody)


def loaded(tmp_path, capture, name, **options):
    path = tmp_path / "captured.toml"
    path.write_text(vectors_text(capture, installed[name], name="session.jsonl", options=options), encoding="utf-8")
    return load_vectors(path, protocol=name)


@pytest.mark.soak
@pytest.mark.parametrize("name", NAMES)
def test_captured_vectors_pass_every_check(tmp_path, name):
    found = loaded(tmp_path, SESSION, name)
    report = run_checks(installed[name], found)
    assert list(report.failed) == []
    sent = {each.data for each in found.vectors if each.direction == "request"}
    replies = [each for each in found.vectors if each.direction == "reply"]
    assert sent
    assert replies
    assert all(reply.answers and reply.answers_to in sent for reply in replies)
    assert len({(each.data, each.answers_to) for each in found.vectors}) == len(found.vectors)
    assert {each.source for each in found.vectors} == {"captured in session.jsonl"}


@pytest.mark.parametrize("name", NAMES)
def test_vectors_from_a_tap_equal_those_of_a_recording(tmp_path, name):
    line = VirtualLine([virtual_drive(name, 1)])
    capture, _ = record(lambda bus: [bus.drive(name, 1).start(), bus.drive(name, 1).status()], line)
    assert loaded(tmp_path, overheard(capture), name) == loaded(tmp_path, capture, name)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seen", [lambda capture: capture, overheard], ids=["recorded", "overheard"])
def test_telegrams_of_other_protocols_are_left_out(name, seen):
    """Their telegrams may contain bytes that are a telegram of another protocol, such as the EOT of VABus."""
    line = VirtualLine([virtual_drive(name, 1)])
    capture, _ = record(lambda bus: [bus.drive(name, 1).start(), bus.drive(name, 1).stop()], line)
    for other in NAMES:
        assert bool(heard_telegrams(seen(capture), installed[other], {})) == (other == name)


def test_vector_names_the_origin_of_its_capture(tmp_path):
    about = Provenance(began=datetime(2026, 5, 4, 9, tzinfo=UTC), tool="tap 1", port="COM3", note="pumps")
    read = Piece(time_s=0, data=bytes.fromhex("04 41 30 30 34 38 31 05"), source="master")
    found = loaded(tmp_path, Capture(provenance=about, pieces=[read, read]), "vabus")
    assert len(found.vectors) == 1
    vector = found.vectors[0]
    assert vector.source == "captured in session.jsonl, 2026-05-04T09:00:00+00:00, at COM3, by tap 1, pumps"
    assert not vector.printed
    assert vector.canonical
    assert vector.id == "captured-request-enquiry-1"
    assert vector.fields == {"kind": "enquiry", "address": 1, "sys": 0, "dataset": 0, "parameter": 481}


def test_options_are_part_of_each_vector(tmp_path):
    old = {"model": "vlt5000", "pnu_bits": 11}
    line = VirtualLine([virtual_drive("danfoss-fc", 3, **old)])
    capture, _ = record(lambda bus: bus.drive("danfoss-fc", 3, **old).read("520"), line)
    found = loaded(tmp_path, capture, "danfoss-fc", pnu_bits=11)
    assert all(vector.options == {"pnu_bits": 11} for vector in found.vectors)
    assert "spm" in found.vectors[0].fields


def test_broadcast_vectors_expect_no_reply(tmp_path):
    for name in NAMES:
        capture, _ = record(lambda bus, name=name: bus.broadcast(name).stop())
        found = loaded(tmp_path, capture, name)
        told = [vector for vector in found.vectors if vector.direction == "request" and not vector.reply_expected]
        assert told, name
        assert run_checks(installed[name], found).failed == ()


@pytest.mark.parametrize("name", NAMES)
def test_every_packaged_telegram_can_become_a_vector(tmp_path, name):
    """The kit accepts the vectors made from any telegrams on a line."""
    sources = {"request": "master", "reply": "drive"}
    shown = [vector for vector in packaged_vectors(installed[name]).vectors if vector.valid and not vector.options]
    pieces = [
        Piece(time_s=float(time_s), data=vector.data, source=sources[vector.direction])
        for time_s, vector in enumerate(shown)
    ]
    found = loaded(tmp_path, Capture(provenance=Provenance(), pieces=pieces), name)
    assert {vector.data for vector in found.vectors} == {vector.data for vector in shown}
    canonical = {vector.data for vector in shown if vector.canonical}
    assert all(vector.canonical for vector in found.vectors if vector.data in canonical)
    decoding = [check for check in checks_of(installed[name], found) if check.name.endswith(("/decode", "/encode"))]
    assert len(decoding) == 2 * len(found.vectors)
    assert list(carry_out(decoding).failed) == []


class Particular:
    """A codec that reads telegrams which it would write differently, or not at all."""

    def __init__(self, codec, written):
        self.measure, self.decode, self._written = codec.measure, codec.decode, written

    def encode(self, message):
        if self._written is None:
            raise TelegramError("field", f"{message.kind} is never sent")
        return self._written


@pytest.mark.parametrize(("written", "canonical"), [(READ, True), (b"otherwise", False), (None, False)])
def test_telegram_with_another_encoding_is_marked_as_not_canonical(written, canonical):
    """Bytes that our encoder would write differently are marked, and not dropped."""
    vabus = installed["vabus"]
    plugin = replace(vabus, codec=lambda options: Particular(vabus.codec(options), written))
    capture = Capture(provenance=Provenance(), pieces=[Piece(time_s=0, data=READ, source="master")])
    text = vectors_text(capture, plugin, name="a", options={})
    assert tomllib.loads(text)["vector"][0].get("canonical", True) is canonical


def test_damaged_telegram_gives_no_vector():
    read = bytearray(bytes.fromhex("41 02 30 30 34 38 31 30 38 30 30 30 30 30 33 45 38 03 48"))
    read[-1] ^= 1
    capture = Capture(provenance=Provenance(), pieces=[Piece(time_s=0, data=bytes(read), source="drive")])
    assert heard_telegrams(capture, installed["vabus"], {}) == []


def test_reply_to_another_request_has_no_request_in_its_vector():
    pieces = [
        Piece(time_s=0, data=bytes.fromhex("04 41 30 30 34 38 31 05"), source="master"),
        Piece(time_s=0.1, data=bytes.fromhex("42 06"), source="drive"),
    ]
    found = heard_telegrams(Capture(provenance=Provenance(), pieces=pieces), installed["vabus"], {})
    assert [(each.direction, each.answers) for each in found] == [("request", b""), ("reply", b"")]


def test_truncated_telegram_is_not_continued_later():
    reply = bytes.fromhex("41 02 30 30 34 38 31 30 38 30 30 30 30 30 33 45 38 03 48")
    pieces = [Piece(time_s=0.1, data=reply[:9], source="drive"), Piece(time_s=5, data=reply, source="drive")]
    found = heard_telegrams(Capture(provenance=Provenance(), pieces=pieces), installed["vabus"], {})
    assert [each.data for each in found] == [reply]


@pytest.mark.soak
@given(
    st.recursive(
        st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.text(st.characters(exclude_categories=["Cs"])),
        lambda inner: st.lists(inner, max_size=3),
        max_leaves=6,
    )
)
def test_values_are_written_as_toml_reads_them(value):
    assert tomllib.loads(f"value = {toml_value(value)}")["value"] == value
