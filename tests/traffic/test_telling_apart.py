"""The senders of a capture, inferred from the bytes of a tap."""

from dataclasses import replace

import pytest
from hypothesis import given, settings, strategies as st
from sessions import everybody, read_everybody, record, work_with_everybody

import drivecomm
from drivecomm.capture import Capture, Piece, Provenance
from drivecomm.protocol import installed
from drivecomm.traffic.replay import infer_sources, recorded_exchanges
from drivecomm.virtual import VirtualLine, virtual_drive

# A process block to Danfoss drive 3 is a sound telegram of MOVILINK, and WEG drives acknowledge like VABus ones.
EVERYBODY = [each for each in installed.working() if each.name not in ("movilink", "weg")]
READ = bytes.fromhex("04 41 30 30 34 38 31 05")


def overheard(capture):
    """Return the capture as a tap would have recorded it."""
    return replace(capture, pieces=[replace(piece, source="unknown") for piece in capture.pieces])


def said(capture):
    return [(each.request, each.reply) for each in recorded_exchanges(capture)]


@pytest.mark.parametrize("program", [read_everybody, work_with_everybody])
def test_sources_are_inferred_for_all_protocols_on_one_line(program):
    capture, _ = record(program)
    told = infer_sources(overheard(capture), EVERYBODY)
    assert said(told) == said(capture)
    assert b"".join(piece.data for piece in told.pieces) == b"".join(piece.data for piece in capture.pieces)


@pytest.mark.parametrize("name", ["vabus", "danfoss-fc", "vlt3500", "fuji", "uss"])
def test_sources_are_inferred_for_one_protocol_alone(name):
    def work(bus):
        drive = bus.drive(name, 1)
        drive.set_reference(percent=30)
        drive.start()
        drive.status()
        drive.stop()

    capture, _ = record(work, VirtualLine([virtual_drive(name, 1)]))
    assert said(infer_sources(overheard(capture), [installed[name]])) == said(capture)


@pytest.mark.soak
@given(cuts=st.lists(st.floats(0, 1), max_size=30))
@settings(max_examples=60, deadline=None)
def test_sources_are_inferred_from_pieces_of_any_size(cuts):
    capture = overheard(SESSION)
    pieces = []
    for piece, cut in zip(capture.pieces, [*cuts, *[0.0] * len(capture.pieces)], strict=False):
        place = round(cut * len(piece.data))
        halves = [replace(piece, data=data) for data in (piece.data[:place], piece.data[place:]) if data]
        pieces += halves
    assert said(infer_sources(replace(capture, pieces=pieces), EVERYBODY)) == said(SESSION)


SESSION, _ = record(work_with_everybody)


def test_repeated_request_is_not_a_reply():
    capture, _ = record(lambda bus: _silence(bus.drive("danfoss-fc", 9, attempts=3)), everybody())
    told = infer_sources(overheard(capture), EVERYBODY)
    assert [piece.source for piece in told.pieces] == ["master"] * 3


def _silence(drive):
    with pytest.raises(drivecomm.NoReplyError):
        drive.read("16-30")


def test_bytes_that_are_not_a_telegram_stay_unknown():
    noise = Capture(
        provenance=Provenance(),
        pieces=[
            Piece(time_s=0.0, data=b"\xff\xfe"),
            Piece(time_s=0.1, data=READ[:5]),
            Piece(time_s=0.5, data=b"\xff" + READ + b"\x7f"),
        ],
    )
    told = infer_sources(noise, [installed["vabus"]])
    assert b"".join(piece.data for piece in told.pieces) == b"".join(piece.data for piece in noise.pieces)
    assert [(piece.time_s, piece.data) for piece in told.pieces if piece.data == READ] == [(0.5, READ)]
    assert next(piece.data for piece in told.pieces if piece.source == "unknown") == b"\xff\xfe"


def test_known_source_is_kept():
    capture = Capture(provenance=Provenance(), pieces=[Piece(time_s=0.0, data=READ, source="drive")])
    assert infer_sources(capture, EVERYBODY) == capture


def test_lines_are_inferred_separately():
    whole = [Piece(time_s=n / 1000, data=READ[n : n + 1], line=line) for n in range(8) for line in ("one", "two")]
    told = infer_sources(Capture(provenance=Provenance(), pieces=whole), EVERYBODY)
    assert sorted((piece.line, piece.data, piece.source) for piece in told.pieces) == [
        ("one", READ, "master"),
        ("two", READ, "master"),
    ]
