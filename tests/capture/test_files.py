"""Capture files: read back as written in both formats, even if cut off; errors name their place."""

import json
import os
import signal
import struct
import subprocess
import sys
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import pytest
from extents import extents
from hypothesis import given, settings, strategies as st
from pcapng_reader import packets_of

from drivecomm.capture import Capture, CaptureWriter, Piece, Provenance, open_capture, read_capture
from drivecomm.errors import FileFormatError, UsageError
from drivecomm.protocol import LineSettings

BEGAN = datetime(2026, 5, 4, 9, 0, 0, 250, tzinfo=UTC)
ABOUT = Provenance(
    began=BEGAN,
    tool="a test",
    port="/dev/ttyUSB0",
    settings=LineSettings(baudrate=19200, bytesize=7, parity="E"),
    drives=("vabus:1", "fuji:7"),
    note="Pumpenraum, Öl",
)
PIECES = [
    Piece(time_s=0.009167, data=bytes.fromhex("04 41 30 30 34 38 31 05"), source="master"),
    Piece(time_s=0.041203, data=b"A\x02", source="drive"),
    Piece(time_s=0.041203001, data=b"x", line="second", settings=LineSettings(baudrate=1200, stopbits=1.5)),
]
SUFFIXES = [".jsonl", ".pcapng"]

texts = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
line_settings = st.builds(
    LineSettings,
    baudrate=st.integers(50, 4_000_000),
    bytesize=st.sampled_from([7, 8]),
    parity=st.sampled_from("NEOMS"),
    stopbits=st.sampled_from([1, 1.5, 2]),
)
moments = st.datetimes(
    min_value=datetime(1970, 1, 2),  # noqa: DTZ001 - hypothesis adds the zone
    max_value=datetime(2200, 1, 1),  # noqa: DTZ001 - as above
    timezones=st.just(timezone(timedelta(hours=2))),
)
provenances = st.builds(
    Provenance,
    began=st.none() | moments,
    tool=texts,
    port=texts,
    settings=st.none() | line_settings,
    drives=st.lists(texts).map(tuple),
    note=texts,
)
pieces = st.builds(
    Piece,
    time_s=st.integers(0, 10**15).map(lambda ns: ns / 1e9),
    data=st.binary(min_size=1, max_size=300),
    source=st.sampled_from(["master", "drive", "unknown"]),
    line=texts,
    settings=st.none() | line_settings,
)


def written(path, provenance, pieces):
    with CaptureWriter(path, provenance) as writer:
        for piece in pieces:
            writer.add(piece)
    return path


@pytest.mark.soak
@pytest.mark.parametrize("suffix", SUFFIXES)
@extents(50, 150)
def test_written_capture_is_read_back_unchanged(tmp_path, suffix, extent):
    @settings(max_examples=extent, deadline=None)
    @given(provenance=provenances, pieces=st.lists(pieces, max_size=8))
    def read_as_written(provenance, pieces):
        found = read_capture(written(tmp_path / f"round{suffix}", provenance, pieces))
        assert found == Capture(provenance=provenance, pieces=sorted(pieces, key=lambda piece: piece.time_s))

    read_as_written()


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_format_is_found_without_the_file_name(tmp_path, suffix):
    path = written(tmp_path / f"a{suffix}", ABOUT, PIECES)
    assert read_capture(path.rename(tmp_path / "renamed")) == Capture(provenance=ABOUT, pieces=PIECES)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_capture_cut_off_anywhere_is_read_up_to_the_cut(tmp_path, suffix):
    """A killed program loses at most the last piece, and the reader reports the loss."""
    whole = written(tmp_path / f"whole{suffix}", ABOUT, PIECES).read_bytes()
    header = len(written(tmp_path / f"header{suffix}", ABOUT, []).read_bytes())
    ends = {
        len(written(tmp_path / f"part{suffix}", ABOUT, PIECES[:count]).read_bytes()): count
        for count in range(len(PIECES) + 1)
    }
    cut = tmp_path / f"cut{suffix}"
    for length in range(len(whole) + 1):
        cut.write_bytes(whole[:length])
        if length < header - (suffix == ".jsonl"):
            with pytest.raises(FileFormatError, match=r"not valid JSON|in the middle of the header"):
                read_capture(cut)
            continue
        found = read_capture(cut)
        kept = max((count for end, count in ends.items() if end <= length), default=0)
        # The last JSON line may be complete without its line end, and a pcapng interface without its packet.
        assert found.pieces in (PIECES[:kept], PIECES[: kept + 1])
        assert found.provenance == ABOUT
        clean = length in ends or found.pieces != PIECES[:kept]
        if suffix == ".jsonl":
            assert bool(found.remarks) == (not clean and length != header - 1)
        elif length in ends:
            assert not found.remarks
        for remark in found.remarks:
            assert str(cut) in remark
            assert "cut off" in remark


@pytest.mark.skipif(os.name != "posix", reason="kills a process")
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_killed_program_loses_no_added_piece(tmp_path, suffix):
    path = tmp_path / f"killed{suffix}"
    program = (
        "import os, signal, sys\n"
        "from drivecomm.capture.files import CaptureWriter\n"
        "from drivecomm.capture.pieces import Piece, Provenance\n"
        "writer = CaptureWriter(sys.argv[1], Provenance())\n"
        "for number in range(1000):\n"
        "    writer.add(Piece(time_s=number, data=b'abc'))\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    done = subprocess.run([sys.executable, "-c", program, str(path)], check=False)
    assert done.returncode == -signal.SIGKILL
    assert len(read_capture(path).pieces) == 1000


def test_pieces_are_sorted_by_their_times(tmp_path):
    late, early = Piece(time_s=2.0, data=b"b"), Piece(time_s=1.0, data=b"a")
    for suffix in SUFFIXES:
        path = written(tmp_path / f"a{suffix}", Provenance(), [late, early])
        assert read_capture(path).pieces == [early, late]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_piece_without_bytes_is_left_out(tmp_path, suffix):
    assert read_capture(written(tmp_path / f"a{suffix}", Provenance(), [Piece(time_s=0, data=b"")])).pieces == []


@pytest.mark.parametrize("time_s", [-1e-9, float("nan"), float("inf"), 1e10])
def test_invalid_times_are_refused(tmp_path, time_s):
    with CaptureWriter(tmp_path / "a.jsonl", Provenance()) as writer, pytest.raises(UsageError, match="time of"):
        writer.add(Piece(time_s=time_s, data=b"a"))


def test_unusable_paths_provenances_and_closed_writers_are_refused(tmp_path):
    with pytest.raises(UsageError, match=r"name it \.jsonl, or \.pcapng"):
        CaptureWriter(tmp_path / "a.txt", Provenance())
    with pytest.raises(UsageError, match="cannot be written"):
        CaptureWriter(tmp_path / "nowhere" / "a.jsonl", Provenance())
    with pytest.raises(UsageError, match="time zone"):
        CaptureWriter(tmp_path / "a.jsonl", Provenance(began=BEGAN.replace(tzinfo=None)))
    with pytest.raises(UsageError, match="too long"):
        CaptureWriter(tmp_path / "a.pcapng", Provenance(note="x" * 70000))
    with pytest.raises(FileFormatError, match="there is no such file"):
        read_capture(tmp_path / "absent.jsonl")
    writer = CaptureWriter(tmp_path / "a.jsonl", Provenance())
    writer.close()
    writer.close()
    with pytest.raises(UsageError, match="closed"):
        writer.add(PIECES[0])


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a full disk")
def test_full_disk_is_refused(tmp_path):
    path = tmp_path / "a.jsonl"
    path.symlink_to("/dev/full")
    with pytest.raises(UsageError, match="cannot be written"):
        CaptureWriter(path, Provenance())


HEADER = '{"format": "drivecomm-capture", "version": 1}'


@pytest.mark.parametrize(
    ("lines", "number", "what"),
    [
        (["nonsense"], 1, "not valid JSON"),
        (["[]"], 1, "not a JSON object"),
        (["{}"], 1, "format"),
        ([""], 1, "not valid JSON"),
        (['{"format": "drivecomm-capture", "version": 2}'], 1, "version 2"),
        (['{"format": "drivecomm-capture", "version": 1, "prot": "x"}'], 1, "unknown key 'prot'"),
        (['{"format": "drivecomm-capture", "version": 1, "began": "today"}'], 1, "began"),
        (['{"format": "drivecomm-capture", "version": 1, "began": "2026-01-01"}'], 1, "no time zone"),
        (['{"format": "drivecomm-capture", "version": 1, "tool": 1}'], 1, "tool is not a text"),
        (['{"format": "drivecomm-capture", "version": 1, "drives": "vabus:1"}'], 1, "drives"),
        (['{"format": "drivecomm-capture", "version": 1, "settings": 9600}'], 1, "settings is not an object"),
        (['{"format": "drivecomm-capture", "version": 1, "settings": {"baudrate": 1}}'], 1, "baud rate of 1"),
        (['{"format": "drivecomm-capture", "version": 1, "settings": {"baud": 1}}'], 1, "unknown key 'baud'"),
        ([HEADER, "{}"], 2, "time_s None"),
        ([HEADER, ""], 2, "not valid JSON"),
        ([HEADER, '{"time_s": 1, "hex": "0"}'], 2, "hexadecimal"),
        ([HEADER, '{"time_s": 1, "hex": ""}'], 2, "hex is missing or empty"),
        ([HEADER, '{"time_s": 1}'], 2, "hex is missing or empty"),
        ([HEADER, '{"time_s": true, "hex": "00"}'], 2, "time_s True"),
        ([HEADER, '{"time_s": -1, "hex": "00"}'], 2, "time_s -1"),
        ([HEADER, '{"time_s": NaN, "hex": "00"}'], 2, "time_s nan"),
        ([HEADER, '{"time_s": 1e999, "hex": "00"}'], 2, "time_s inf"),
        ([HEADER, '{"time_s": 1' + "0" * 999 + ', "hex": "00"}'], 2, "time_s 1000"),
        ([HEADER, '{"time_s": 1, "hex": "00"}', '{"time_s": 1, "hex": "00", "source": "slave"}'], 3, "source 'slave'"),
        ([HEADER, '{"time_s": 1, "hex": "00", "direction": "reply"}'], 2, "unknown key 'direction'"),
        ([HEADER, '{"time_s": 1, "hex": "00", "line": 2}'], 2, "line is not a text"),
        ([HEADER, "[" * 100_000], 2, "not valid JSON"),
    ],
)
def test_malformed_lines_are_reported_with_their_number(tmp_path, lines, number, what):
    path = tmp_path / "wrong.jsonl"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    with pytest.raises(FileFormatError, match=what) as raised:
        read_capture(path)
    assert f"{path}: line {number}: " in str(raised.value)


def test_empty_file_is_refused(tmp_path):
    path = tmp_path / "empty.jsonl"
    path.write_bytes(b"")
    with pytest.raises(FileFormatError, match="empty"):
        read_capture(path)


def test_pcapng_file_follows_its_specification(tmp_path):
    content = written(tmp_path / "a.pcapng", ABOUT, PIECES).read_bytes()
    section, interfaces, packets = packets_of(content)
    header = json.loads(section[1])
    assert header["port"] == "/dev/ttyUSB0"
    assert section[4] == b"a test"
    assert [kind for kind, _ in interfaces] == [250, 250]
    assert interfaces[0][1][3] == b"19200 7E1 at /dev/ttyUSB0"
    assert interfaces[1][1][2] == b"second"
    assert interfaces[1][1][3] == b"1200 8N1.5 at /dev/ttyUSB0"
    assert struct.unpack("<Q", interfaces[1][1][8]) == (1200,)
    began_ns = int((BEGAN - datetime(1970, 1, 1, tzinfo=UTC)).total_seconds()) * 10**9 + 250_000
    for piece, (number, time_ns, data, options) in zip(PIECES, packets, strict=True):
        assert number == (1 if piece.line else 0)
        assert time_ns == began_ns + round(piece.time_s * 1e9)
        seconds, microseconds, event, lines, footer = struct.unpack(">IIBBH", data[:12])
        assert (seconds, microseconds) == (time_ns // 10**9, time_ns % 10**9 // 1000)
        assert (lines, footer) == (0, 0)
        assert data[12:] == piece.data
        assert event == (1 if piece.source == "master" else 2)
        assert struct.unpack("<I", options[2]) == ({"master": 2, "drive": 1, "unknown": 0}[piece.source],)


@given(pieces=st.lists(pieces, max_size=5), provenance=provenances)
@settings(max_examples=60, deadline=None)
def test_every_pcapng_file_is_valid(tmp_path_factory, pieces, provenance):
    path = written(tmp_path_factory.getbasetemp() / "any.pcapng", provenance, pieces)
    _, _, packets = packets_of(path.read_bytes())
    assert [data[12:] for _, _, data, _ in packets] == [piece.data for piece in pieces]


class Foreign:
    """Pcapng file as another program may write it."""

    def __init__(self, order="<", section=b""):
        self.order = order
        head = struct.pack(order + "IHHq", 0x1A2B3C4D, 1, 2, -1)
        self.content = self.block(0x0A0D0D0A, head + section)

    def block(self, kind, body):
        body += bytes(-len(body) % 4)
        length = struct.pack(self.order + "I", 12 + len(body))
        return struct.pack(self.order + "I", kind) + length + body + length

    def option(self, code, value):
        return struct.pack(self.order + "HH", code, len(value)) + value + bytes(-len(value) % 4)

    def add(self, kind, body):
        self.content += self.block(kind, body)
        return self

    def interface(self, link_type=250, options=b""):
        return self.add(1, struct.pack(self.order + "HHI", link_type, 0, 65535) + options)

    def packet(self, time, data, event=1, number=0, options=b""):
        body = struct.pack(">IIBBH", 0, 0, event, 0, 0) + data
        head = struct.pack(self.order + "IIIII", number, time >> 32, time & 0xFFFFFFFF, len(body), len(body))
        return self.add(6, head + body + bytes(-len(body) % 4) + options)

    def read(self, tmp_path):
        path = tmp_path / "foreign.pcapng"
        path.write_bytes(self.content)
        return read_capture(path)


@pytest.mark.parametrize("order", ["<", ">"])
def test_pcapng_files_of_other_programs_are_read(tmp_path, order):
    noon = 1_777_888_000
    file = Foreign(order)
    # Unknown blocks and options are skipped; times are in microseconds by default.
    file.add(0x80000001, b"whatever").interface(options=file.option(77, b"new") + file.option(2, b"COM3"))
    file.packet(noon * 10**6 + 500_000, b"ask").packet(noon * 10**6 + 600_000, b"tell", event=2)
    file.packet(noon * 10**6 + 650_000, b"", event=3).packet(noon * 10**6 + 700_000, b"?", event=7)
    found = file.read(tmp_path)
    assert found.provenance == Provenance(began=datetime.fromtimestamp(noon + 0.5, UTC))
    assert found.pieces == [
        Piece(time_s=0, data=b"ask", source="master", line="COM3"),
        Piece(time_s=0.1, data=b"tell", source="drive", line="COM3"),
        Piece(time_s=0.2, data=b"?", source="unknown", line="COM3"),
    ]


@pytest.mark.parametrize("order", ["<", ">"])
def test_time_resolution_and_offset_of_other_programs_are_applied(tmp_path, order):
    file = Foreign(order)
    file.interface(options=file.option(9, b"\x8a") + file.option(14, struct.pack(order + "q", 1000)))
    file.interface(options=file.option(9, b"\x03"))
    file.packet(1024 * 5, b"a").packet(1_005_250, b"b", number=1)
    found = file.read(tmp_path)
    assert found.provenance.began == datetime.fromtimestamp(1005, UTC)
    assert [piece.time_s for piece in found.pieces] == [0, 0.25]


def test_packet_flags_outrank_event_types(tmp_path):
    file = Foreign().interface()
    for number, flags in enumerate([0, 1, 2, 0xFFFF0001]):
        file.packet(number, b"x", event=2, options=file.option(2, struct.pack("<I", flags)))
    assert [piece.source for piece in file.read(tmp_path).pieces] == ["unknown", "drive", "master", "drive"]


def test_omitted_packets_are_listed_in_the_remarks(tmp_path):
    file = Foreign(section=b"\x01\x00\x05\x00hello\x00\x00\x00").interface().interface(link_type=1)
    file.packet(0, b"a").packet(1, b"b", number=1).add(3, struct.pack("<I", 4) + b"abcd")
    found = file.read(tmp_path)
    assert found.provenance.note == "hello"
    assert len(found.pieces) == 1
    assert any("1 packets of link type 1" in remark for remark in found.remarks)
    assert any("without a time" in remark for remark in found.remarks)


def test_all_sections_of_a_file_are_read(tmp_path):
    first, second = Foreign("<").interface(), Foreign(">").interface().packet(2, b"b", event=2)
    first.packet(1, b"a")
    first.content += second.content
    assert [piece.data for piece in first.read(tmp_path).pieces] == [b"a", b"b"]


def test_malformed_blocks_are_reported_with_the_reason(tmp_path):
    def fails(file, what):
        with pytest.raises(FileFormatError, match=what) as raised:
            file.read(tmp_path)
        assert "foreign.pcapng" in str(raised.value)

    fails(Foreign().interface(link_type=1).packet(0, b"a"), "link type 1")
    fails(Foreign().packet(0, b"a"), "interface 0 is used before its description")
    fails(Foreign().add(6, b"short"), "block at byte 28")
    fails(Foreign().interface().add(6, struct.pack("<IIIII", 0, 0, 0, 99, 99)), "99 bytes does not fit")
    fails(Foreign().interface().add(6, struct.pack("<IIIII", 0, 0, 0, 4, 4) + b"abcd"), "too short for its link type")
    fails(Foreign().add(1, struct.pack("<HHI", 250, 0, 0) + struct.pack("<HH", 9, 8)), "option 9 is longer")
    fails(Foreign().add(1, struct.pack("<HHI", 250, 0, 0) + struct.pack("<HH", 9, 2) + b"abcd"), "block at byte 28")
    wrong = Foreign()
    wrong.content += struct.pack("<III", 1, 13, 13)
    fails(wrong, "invalid length 13")
    wrong = Foreign()
    wrong.content += struct.pack("<II", 1, 2**30) + bytes(8)
    fails(wrong, "invalid length 1073741824")
    wrong = Foreign()
    wrong.content += struct.pack("<III", 1, 12, 16)
    fails(wrong, "12 at the beginning and 16 at the end")
    wrong = Foreign()
    wrong.content = wrong.content.replace(struct.pack("<I", 0x1A2B3C4D), b"abcd")
    fails(wrong, "byte-order mark")
    wrong = Foreign()
    wrong.content = wrong.content.replace(struct.pack("<HH", 1, 2), struct.pack("<HH", 2, 0))
    fails(wrong, r"version 2.0")
    speed = wrong.option(8, struct.pack("<Q", 1)) + wrong.option(3, b"1 8N1")
    fails(Foreign().interface(options=speed), "baud rate of 1 ")
    about = json.dumps({"format": "drivecomm-capture", "version": 1, "began": "2026-05-04T09:00:00+00:00"})
    comment = wrong.option(1, about.encode())
    fails(Foreign(section=comment).interface().packet(1, b"a"), "older than the capture")
    wrong = Foreign(section=b"\x04\x00\x01\x00\xff\x00\x00\x00")
    fails(wrong, "block at byte 0")


def test_pcap_file_is_refused_with_advice(tmp_path):
    path = tmp_path / "old.pcap"
    path.write_bytes(b"\xd4\xc3\xb2\xa1" + bytes(20))
    with pytest.raises(FileFormatError, match="save it as pcapng"):
        read_capture(path)


def test_years_that_pcapng_cannot_store_are_refused(tmp_path):
    for year in (1969, 2401):
        about = Provenance(began=BEGAN.replace(year=year))
        with pytest.raises(UsageError, match="cannot store a capture of the year"):
            CaptureWriter(tmp_path / "a.pcapng", about)
        assert read_capture(written(tmp_path / "a.jsonl", about, PIECES)).provenance == about
    foreign = Foreign()
    foreign.interface(options=foreign.option(9, b"\x00")).packet(2**40, b"a")
    with pytest.raises(FileFormatError, match="between 1970 and"):
        foreign.read(tmp_path)


def _sample(kind):
    """Return the file of another program to be damaged, or None for the formats of drivecomm."""
    if kind == "foreign":
        file = Foreign(">")
        options = file.option(9, b"\x06") + file.option(8, bytes(8)) + file.option(3, b"9600 8N1")
        return file.interface(options=options).packet(10**15, b"abc").packet(10**15 + 1, b"d", event=2).content
    return None


@pytest.mark.parametrize("kind", [*SUFFIXES, "foreign"])
@extents(70, 200)
def test_damaged_file_raises_only_file_format_error(tmp_path, kind, extent):
    """Any bytes are read as a capture or raise FileFormatError."""
    path = tmp_path / f"damaged{kind if kind in SUFFIXES else '.pcapng'}"
    whole = _sample(kind) or written(path, ABOUT, PIECES).read_bytes()

    @settings(max_examples=extent, deadline=None)
    @given(data=st.data())
    def read_or_refused(data):
        content = bytearray(whole)
        for place in data.draw(st.lists(st.integers(0, len(content) - 1), min_size=1, max_size=4)):
            content[place] = data.draw(st.integers(0, 255))
        path.write_bytes(content)
        try:
            found = read_capture(path)
        except FileFormatError as error:
            complaint = str(error)
        else:
            complaint = f"{path}: {len(found.pieces)} pieces"
        assert complaint.startswith(f"{path}: ")

    read_or_refused()


# Captures too large for memory


def _long(number, order=lambda number: number):
    return (Piece(time_s=order(each) / 100, data=b"%08d" % each, source="master") for each in range(number))


# In an interpreter of its own, because threads of other tests allocate memory, too.
_GONE_THROUGH = """
import sys, tracemalloc
from drivecomm.capture import files

files._HELD = 500
for path in sys.argv[1:]:
    tracemalloc.start()
    with files.open_capture(path) as reader:
        number = sum(1 for _ in reader)
    print(number, tracemalloc.get_traced_memory()[1])
    tracemalloc.stop()
"""


@pytest.mark.soak
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_larger_capture_takes_no_more_memory(tmp_path, suffix):
    few, many = (written(tmp_path / f"{number}{suffix}", ABOUT, _long(number)) for number in (2_000, 20_000))
    # The first pass includes the memory for imports and compilation, so it does not count.
    course = [sys.executable, "-c", _GONE_THROUGH, few, few, many]
    told = subprocess.run(course, capture_output=True, text=True, check=True)
    _, (number, little), (larger, most) = ([int(word) for word in line.split()] for line in told.stdout.splitlines())
    assert (number, larger) == (2_000, 20_000)
    # For ten times the pieces; the factor allows for garbage that is not collected yet.
    assert most < 3 * little


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_neighbouring_pieces_are_sorted_while_reading(tmp_path, monkeypatch, suffix):
    monkeypatch.setattr("drivecomm.capture.files._HELD", 8)
    path = written(tmp_path / f"a{suffix}", ABOUT, _long(200, order=lambda number: number ^ 7))
    with open_capture(path) as reader:
        assert reader.provenance == ABOUT
        assert list(reader) == read_capture(path).pieces


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_reader_refuses_a_piece_far_out_of_order(tmp_path, monkeypatch, suffix):
    monkeypatch.setattr("drivecomm.capture.files._HELD", 8)
    path = written(tmp_path / f"a{suffix}", ABOUT, _long(200, order=lambda number: number if number < 100 else 0))
    with open_capture(path) as reader, pytest.raises(FileFormatError, match="more than 8 pieces behind"):
        list(reader)
    assert read_capture(path).pieces[1].time_s == 0


def test_reader_lists_its_omissions_at_the_end(tmp_path):
    path = written(tmp_path / "a.jsonl", ABOUT, PIECES)
    path.write_bytes(path.read_bytes()[:-5])
    with open_capture(path) as reader:
        assert list(reader) == PIECES[:-1]
        assert reader.remarks == read_capture(path).remarks != ()
