"""Logs printed by other programs: senders, times and bytes, and the lines that are not read."""

from io import BytesIO
from pathlib import Path

import pytest
from hypothesis import given, settings, strategies as st

from drivecomm.capture import PRINTED_LOG, PrintedLogReader, open_capture, read_capture
from drivecomm.capture.printed_line import printed_lines
from drivecomm.errors import FileFormatError

LOGS = Path(__file__).parent / "logs"
SHORT_REQUEST = bytes.fromhex("05 03 21 03 00 02 3F B3")
SHORT_REPLY = bytes.fromhex("05 03 04 13 88 00 7B 7B 7E")
WRITTEN = bytes.fromhex("05 06 20 01 0B B8 D5 0C")
LONG_REQUEST = bytes.fromhex("05 03 21 00 00 28 4E 6C")
LONG_REPLY = bytes.fromhex(f"05 03 50 {'00 01 ' * 40} 44 0F")
OTHER = bytes.fromhex("06 03 21 03 00 01 7F 81")

PROGRAMS = {
    "mbpoll.log": (
        [("m", SHORT_REQUEST), ("d", SHORT_REPLY), ("m", OTHER), ("m", LONG_REQUEST), ("d", LONG_REPLY)],
        [],
    ),
    "pymodbus.log": (
        [("m", SHORT_REQUEST), ("d", SHORT_REPLY[:5]), ("d", SHORT_REPLY[5:]), ("m", WRITTEN), ("d", WRITTEN)],
        ["line 3 is not read: the same line again", "line 6 is not read: the line does not say who sent"],
    ),
    "minimalmodbus.log": ([("m", SHORT_REQUEST), ("d", b"\0" + SHORT_REPLY)], []),
    "qmodmaster.log": ([("m", SHORT_REQUEST), ("d", SHORT_REPLY)], []),
    "modbus-poll.txt": ([("m", SHORT_REQUEST), ("d", SHORT_REPLY), ("m", WRITTEN), ("d", WRITTEN)], []),
    "strace.txt": (
        [("m", SHORT_REQUEST), ("d", SHORT_REPLY[:3]), ("d", SHORT_REPLY[3:])],
        ["line 6 is not read: strace cut the bytes off"],
    ),
    "interceptty.log": ([("m", SHORT_REQUEST), ("d", SHORT_REPLY)], []),
    "serial-monitor.txt": ([("m", LONG_REQUEST), ("d", LONG_REPLY)], []),
    "modbus-tk.log": ([("m", SHORT_REQUEST), ("d", SHORT_REPLY)], []),
}
"""Contents of each log (m: sent by the master, d: sent by a drive), and remarks on the lines that are not read."""


@pytest.mark.parametrize("name", PROGRAMS)
def test_log_of_a_program_is_read_as_a_capture(name):
    pieces, remarks = PROGRAMS[name]
    capture = read_capture(LOGS / name)
    assert [(piece.source[0], piece.data) for piece in capture.pieces] == pieces
    told = [remark for remark in capture.remarks if "has no times" not in remark]
    assert len(told) == len(remarks)
    assert all(wanted in remark for wanted, remark in zip(remarks, told, strict=True))
    assert capture.provenance.tool == PRINTED_LOG
    with open_capture(LOGS / name) as reader:
        assert list(reader) == list(capture.pieces)


def times(tmp_path, text):
    path = tmp_path / "a.log"
    path.write_text(text, encoding="utf-8")
    capture = read_capture(path)
    return [round(piece.time_s, 6) for piece in capture.pieces], capture.remarks


def test_times_count_from_the_first_piece_even_past_midnight(tmp_path):
    text = "23:59:59.900 TX: 01 03\n23:59:59,950 RX: 01 03 02\n00:00:00:100 TX: 01 04\n"
    assert times(tmp_path, text)[0] == [0, 0.05, 0.2]
    assert times(tmp_path, "01/02/2026 11:59:59 AM TX: 01 03\n01/02/2026 01:00:00 PM RX: 01 03\n")[0] == [0, 3601]


def test_log_without_times_spaces_its_pieces_with_a_remark(tmp_path):
    found, remarks = times(tmp_path, "TX: 01 03\nRX: 01 03 02\n")
    assert found == [0, 0.1]
    assert "the log has no times; its pieces are put 0.1 s apart" in remarks[0]


def test_lines_of_bytes_alone_are_of_unknown_source_and_not_joined(tmp_path):
    path = tmp_path / "tap.txt"
    path.write_text("05 03 21 03 00 02 3f b3\n05 03 04 13 88 00 7b 7b 7e\n", encoding="utf-16")
    assert [(piece.source, piece.data) for piece in read_capture(path).pieces] == [
        ("unknown", SHORT_REQUEST),
        ("unknown", SHORT_REPLY),
    ]


def test_dump_begins_a_new_piece_at_offset_zero(tmp_path):
    path = tmp_path / "dump.txt"
    shown = "".join(
        f"{start:04x}  {LONG_REPLY[start : start + 16].hex(' ')}  {'.' * 16}\n" for start in range(0, 85, 16)
    )
    path.write_text(f"{shown}0000  {SHORT_REQUEST.hex(' ')}   ........\n", encoding="utf-8")
    assert [piece.data for piece in read_capture(path).pieces] == [LONG_REPLY, SHORT_REQUEST]


@pytest.mark.parametrize(
    ("line", "mark"),
    [
        ("12/05/2024 14:22:31.113 [TX] - 05 03 21 03 00 02 3F B3 ", "sent"),
        ("write <Buffer 05 03 21 03 00 02 3f b3>", "sent"),
        ("Tx (8 bytes): [05][03][21][03][00][02][3f][b3]", "sent"),
        ("14:22:31 -> 0503210300023FB3", "sent"),
        ("<- 05-03-21-03-00-02-3f-b3", "received"),
        ("RX: 05h 03h 21h 03h 00h 02h 3Fh B3h", "received"),
        ("TX: 5 3 21 3 0 2 3f b3", "sent"),
        ("Tx: 5 3 33 3 0 2 63 179", "sent"),
        ("send: [5, 3, 33, 3, 0, 2, 63, 179]", "sent"),
        (r"sent b'\x05\x03!\x03\x00\x02?\xb3'", "sent"),
        (r'[pid 8] 10:11:12 write(4</dev/ttyS0>, "\5\3!\3\0\2?\263", 8) = 8', "sent"),
        ("\x1b[32mRequest\x1b[0m: 0x05 0x03 0x21 0x03 0x00 0x02 0x3f 0xb3", "sent"),
        ("00000000: 0503 2103 0002 3fb3                      ..!...?.", ""),
        ("uint8_t query[] = {0x05, 0x03, 0x21, 0x03, 0x00, 0x02, 0x3F, 0xB3};", "sent"),
    ],
)
def test_bytes_of_a_line_are_found_in_any_notation(line, mark):
    (found,) = printed_lines(line)
    assert (found.data, found.mark, found.reason) == (SHORT_REQUEST, mark, "")


def test_line_with_request_and_response_gives_both():
    found = printed_lines(f"request: {SHORT_REQUEST.hex(' ')}, response: {SHORT_REPLY.hex(' ')}")
    assert [(each.mark, each.data) for each in found] == [("sent", SHORT_REQUEST), ("received", SHORT_REPLY)]


@pytest.mark.parametrize(
    "line",
    [
        "",
        "Frame 107: 66 bytes on wire (528 bits), 66 bytes captured (528 bits)",
        "Port COM3 opened 9600 8 N 1",
        "2026-05-04 09:15:02,100 DEBUG connecting to /dev/ttyUSB0",
        "read(3, 0x7ffd, 512) = -1 EAGAIN (Resource temporarily unavailable)",
    ],
)
def test_line_without_bytes_gives_no_bytes_and_no_reason(line):
    assert [(each.data, each.reason) for each in printed_lines(line)] == [(b"", "")]


@pytest.mark.parametrize("line", ["TX: 1, 3, 10, 0, 0, 2", "Poll 12 10 14 16", f"TX: {'01 ' * 10_000}"])
def test_doubtful_line_is_left_out_with_the_reason(line):
    (found,) = printed_lines(line)
    assert not found.data
    assert found.reason


def test_text_without_bytes_is_neither_a_capture_nor_a_log(tmp_path):
    path = tmp_path / "notes.txt"
    path.write_text("nothing was sent today\n", encoding="utf-8")
    with pytest.raises(FileFormatError, match="neither a capture nor a log"):
        read_capture(path)


SCRAPS = [
    "TX: ",
    "RX: ",
    "05 03 ",
    "0x5 ",
    "[05]",
    "<03>",
    r"\x05",
    'write(3, "',
    '", 8) = 8',
    "12:00:00.1 ",
    "2026-05-04 ",
]
SCRAPS += ["0000  ", "-> ", "\n", "1, 2, ", "b'", "'", "300", "\x1b[3m", "\\", "request", "response", "\u0661", "é"]


@settings(max_examples=150, deadline=None)
@given(st.lists(st.sampled_from(SCRAPS) | st.text(max_size=3), max_size=20).map("".join))
def test_any_text_is_read_in_order_or_refused(text):
    try:
        reader = PrintedLogReader(Path("any.log"), BytesIO(text.encode("utf-8", "replace")))
    except FileFormatError:
        return
    times = [piece.time_s for piece in reader.pieces()]
    assert times == sorted(times)
    assert times[0] >= 0
