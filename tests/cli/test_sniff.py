"""The sniff command at captures and ports: output as lines, JSON objects and a table."""

import json
import os
import socket
import subprocess
import sys
import threading
from collections import defaultdict
from io import StringIO

import pytest
from rich.console import Console

from drivecomm.capture import CaptureWriter, Piece, Provenance, read_capture
from drivecomm.cli import main
from drivecomm.cli.sniff import command
from drivecomm.cli.sniff.lines import drawn
from drivecomm.errors import LinkDownError
from drivecomm.link import Statistics
from drivecomm.protocol import LineSettings, encode
from drivecomm.virtual import received

SETTINGS = LineSettings(baudrate=19200, bytesize=7, parity="E")
ENQUIRY = bytes.fromhex("0441303034383105")
VALUE = encode("vabus", {"kind": "value", "address": 1, "parameter": 481, "data": "000003E8"}, direction="reply")
READ = encode("fuji", {"kind": "request", "address": 5, "command": "R", "function": "F03"}, direction="request")
BROKEN = VALUE[:-1] + b"\x00"
TALK = ((0.01, ENQUIRY), (0.04, VALUE), (0.10, READ), (0.70, ENQUIRY), (0.73, BROKEN), (1.3, ENQUIRY), (1.33, VALUE))


class PlayedPort:
    """Port that plays the traffic of others in virtual time and then raises Ctrl-C or another exception."""

    def __init__(self, talk, settings=SETTINGS, ends_with=KeyboardInterrupt):
        self._talk = list(talk)
        self._sent = settings
        self._heard = settings
        self._ends_with = ends_with
        self._now = 100.0
        self.spoilt = 0
        self.closed = False

    def configure(self, settings):
        self._heard = settings
        return ""

    def now(self):
        return self._now

    def read(self, until):
        if not self._talk:
            raise self._ends_with
        if self._talk[0][0] + 100 > until:
            self._now = max(self._now, until)
            return b""
        time_s, data = self._talk.pop(0)
        self._now = max(self._now, time_s + 100)
        characters = received(data, self._sent, self._heard)
        self.spoilt += sum(not sound for _, sound in characters)
        return bytes(character for character, _ in characters)

    def close(self):
        self.closed = True


@pytest.fixture
def at_port(monkeypatch):
    def play(port):
        monkeypatch.setattr(command, "listening_port", lambda *_: port)
        return port

    return play


@pytest.fixture
def capture(tmp_path):
    path = tmp_path / "talk.jsonl"
    with CaptureWriter(path, Provenance(settings=SETTINGS)) as writer:
        for time_s, data in TALK:
            writer.add(Piece(time_s=time_s, data=data))
    return str(path)


@pytest.fixture
def run(capsys):
    def call(*arguments):
        code = main(["sniff", *arguments])
        return code, capsys.readouterr()

    return call


def objects(output):
    return [json.loads(line) for line in output.out.splitlines()]


def test_capture_is_shown_line_by_line_with_a_summary(run, capture):
    code, output = run(capture, "--drive", "vabus:1,model=agile")
    lines = output.out.splitlines()
    assert code == 0
    assert lines[0].split(maxsplit=3)[:3] == ["0.0100", "->", "vabus:1"]
    assert lines[0].endswith("481 fixed_frequency_2")
    assert lines[1].endswith("481 fixed_frequency_2 = 10.00 Hz  [30.0 ms]")
    assert any("--" in line and "no reply to request" in line for line in lines)
    assert any("!!" in line and "damaged reply" in line for line in lines)
    assert any("[retry 1]" in line for line in lines)
    assert any(line.startswith("| vabus:1 ") for line in lines)


def test_json_objects_hold_all_facts_of_each_telegram(run, capture):
    code, output = run(capture, "--json", "--names")
    found = objects(output)
    assert code == 0
    kinds = [one["what"] for one in found if one["what"] != "statistics"]
    assert kinds == [
        "request", "reply", "request", "unanswered", "request", "damaged", "unanswered", "request", "reply",
    ]  # fmt: skip
    reply = found[1]
    assert (reply["drive"], reply["protocol"], reply["outcome"]) == ("vabus:1", "vabus", "answered")
    assert (reply["parameter"], reply["name"], reply["value"], reply["unit"]) == (
        "481", "fixed_frequency_2", "10.00", "Hz",
    )  # fmt: skip
    assert reply["reply_time_ms"] == 30.0
    assert reply["data"] == VALUE.hex(" ").upper()
    assert reply["fields"]["data"] == "000003E8"
    counted = {one["drive"]: one["counters"] for one in found if one["what"] == "statistics"}
    assert counted == {
        "fuji:5": {"requests": 1, "timeouts": 1},
        "vabus:1": {"requests": 2, "replies": 2, "retries": 1, "damaged": 1, "checksum errors": 1},
    }


def test_errors_and_only_flags_filter_the_output(run, capture):
    _, output = run(capture, "--json", "--errors", "--only", "vabus:1")
    assert [one["what"] for one in objects(output) if one["what"] != "statistics"] == [
        "damaged",
        "unanswered",
        "request",
    ]
    _, output = run(capture, "--json", "--only", "fuji")
    assert {one["drive"] for one in objects(output) if one["what"] != "statistics"} == {"fuji:5"}


def test_table_shows_the_last_value_of_each_drive(run, capture):
    code, output = run(capture, "--table", "--names")
    assert code == 0
    assert "last value" in output.out
    assert "1 retry, 1 damaged, 1 error" in output.out
    assert "fixed_frequency_2 = 10.00 Hz" in output.out
    assert "->" not in output.out


@pytest.mark.parametrize("last", [{}, {("", "danfoss-fc:3"): "reference_via_bus = 100.00 %"}])
def test_table_fits_into_80_columns(monkeypatch, last):
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    counted = defaultdict(Statistics)
    for drive in ("danfoss-fc:3", "vabus:12", "vlt3500:4", "line"):
        counters = {"requests": 123456, "replies": 123456, "retries": 12, "timeouts": 1, "strays": 3}
        counted[drive].counters.update(counters)
        counted[drive].reply_times.add(0.1234)
    console = Console(width=80, file=StringIO())
    console.print(drawn({"": counted}, last))
    table = console.file.getvalue()
    assert "…" not in table
    assert all(len(line) <= 80 for line in table.splitlines())
    words = set(table.replace(",", "").split())
    assert words >= {"danfoss-fc:3", "requests", "123456", "mean", "123.4", "retries", "timeout", "strays"}
    assert not last or "reference_via_bus" in words


def test_protocol_flag_limits_the_decoded_protocols(run, capture):
    _, output = run(capture, "--json", "--protocol", "fuji")
    assert {one["what"] for one in objects(output)} == {"request", "unknown", "unanswered", "statistics"}


def uss_capture(path, **provenance):
    """Write a request to USS drive 3 and its reply, which are valid Danfoss FC telegrams as well; return the path."""
    request = bytes.fromhex("02 0E 03 14 3A 00 00 00 00 00 00 00 00 00 00 21")
    reply = bytes.fromhex("02 0E 03 24 3A 00 00 42 48 00 00 03 31 00 00 29")
    with CaptureWriter(path, Provenance(settings=LineSettings(parity="E"), **provenance)) as writer:
        for time_s, data in ((0.1, request), (0.15, reply)):
            writer.add(Piece(time_s=time_s, data=data))
    return str(path)


def drives_heard(output):
    return {one["drive"] for one in objects(output) if one["what"] in ("request", "reply")}


def test_ambiguous_telegrams_are_decoded_by_the_protocol_of_the_named_drive(run, tmp_path):
    path = uss_capture(tmp_path / "uss.jsonl")
    for arguments, name in (((), "danfoss-fc:3"), (("--drive", "uss:3"), "uss:3"), (("--protocol", "uss"), "uss:3")):
        _, output = run(path, "--json", *arguments)
        assert drives_heard(output) == {name}


@pytest.mark.parametrize("name", ["uss.jsonl", "uss.pcapng"])
def test_recording_is_decoded_by_the_protocol_of_its_drives(run, tmp_path, name):
    path = uss_capture(tmp_path / name, drives=("uss:3", "nothing:1", "uss", "uss:999"))
    _, output = run(path, "--json")
    assert drives_heard(output) == {"uss:3"}
    # The recording names no model, so parameters get no names, which could be wrong.
    assert not any(one.get("name") for one in objects(output) if one["what"] in ("request", "reply"))
    _, output = run(path, "--json", "--drive", "danfoss-fc:3")
    assert drives_heard(output) == {"danfoss-fc:3"}


def test_recording_takes_the_models_of_its_drives_from_the_plant(run, tmp_path, monkeypatch):
    plant = tmp_path / "plant.toml"
    plant.write_text(
        'format = 1\n[[line]]\nname = "saw"\nport = "/dev/ttyUSB7"\n'
        '[[drive]]\nname = "saw"\nline = "saw"\ndrive = "uss:3"\noptions = { model = "micromaster4" }\n',
        encoding="utf-8",
    )
    monkeypatch.setenv("DRIVECOMM_PLANT", str(plant))
    _, output = run(uss_capture(tmp_path / "here.jsonl", drives=("uss:3",), port="/dev/ttyUSB7"))
    assert "1082" in output.out
    _, output = run(uss_capture(tmp_path / "without.jsonl", port="/dev/ttyUSB7"), "--json")
    assert drives_heard(output) == {"danfoss-fc:3"}, "the recording is not known to be of drives of the plant"


def test_broken_plant_file_does_not_prevent_reading_a_recording(run, tmp_path, monkeypatch):
    plant = tmp_path / "plant.toml"
    plant.write_text("][ half saved", encoding="utf-8")
    monkeypatch.setenv("DRIVECOMM_PLANT", str(plant))
    code, output = run(uss_capture(tmp_path / "uss.jsonl", drives=("uss:3",)), "--json")
    assert code == 0
    assert drives_heard(output) == {"uss:3"}
    assert "plant.toml" in output.err


def test_ctrl_c_at_a_port_ends_with_a_summary_and_exit_code_0(run, at_port):
    port = at_port(PlayedPort(TALK))
    code, output = run("/dev/ttyUSB9", "--json", "--baudrate", "19200", "--bytesize", "7", "--parity", "e")
    assert code == 0
    assert "listening at /dev/ttyUSB9 with 19200 7E1" in output.err
    assert port.closed
    assert [one["what"] for one in objects(output)].count("reply") == 2
    assert {one["drive"] for one in objects(output) if one["what"] == "statistics"} == {"vabus:1", "fuji:5"}


def test_written_capture_can_be_read_again(run, at_port, tmp_path):
    kept = tmp_path / "kept.jsonl"
    at_port(PlayedPort(TALK))
    _, live = run("/dev/ttyUSB9", "--json", "--write", str(kept), "--drive", "vabus:1,model=agile")
    capture = read_capture(kept)
    assert (capture.provenance.port, capture.provenance.settings) == ("/dev/ttyUSB9", SETTINGS)
    assert [piece.data for piece in capture.pieces] == [data for _, data in TALK]
    _, again = run(str(kept), "--json", "--drive", "vabus:1,model=agile")
    kinds = ("request", "reply", "damaged", "unknown")
    assert [one["data"] for one in objects(again) if one["what"] in kinds] == [
        one["data"] for one in objects(live) if one["what"] in kinds
    ]


def test_lost_port_is_reported_after_the_summary(run, at_port):
    at_port(PlayedPort(TALK, ends_with=LinkDownError("port /dev/ttyUSB9 is gone")))
    code, output = run("/dev/ttyUSB9", "--json")
    assert code == 3
    assert "is gone" in output.err
    assert any(one.get("what") == "statistics" for one in objects(output))


@pytest.mark.parametrize("seconds", [(), ("--for", "2")])
def test_line_without_traffic_is_reported_as_silent(run, at_port, seconds):
    at_port(PlayedPort([] if not seconds else [(100.0, b"too late")]))
    code, output = run("/dev/ttyUSB9", *seconds)
    assert code == 1
    assert "/dev/ttyUSB9: nothing was heard; check that there is traffic on this line" in output.err
    at_port(PlayedPort([]))
    code, output = run("/dev/ttyUSB9", "--json")
    assert (code, objects(output)[-1]["exit_code"]) == (1, 1)


@pytest.mark.soak
@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells who holds a port")
def test_port_in_use_is_refused_unless_it_is_shared(run):
    near, far = os.openpty()
    name = os.ttyname(far)
    program = [sys.executable, "-m", "drivecomm", "sniff", name]
    with subprocess.Popen(program, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL) as other:
        assert b"listening" in other.stderr.readline()
        code, output = run(name, "--for", "0.1")
        assert code == 3
        assert output.err.startswith(f"drivecomm: port {name} is in use by drivecomm sniff (pid {other.pid}); stop")
        code, output = run(name, "--for", "0.01", "--shared")
        assert code == 1
        assert "shared: 9600 8N1 is not set, the other program's line settings hold" in output.err
        other.kill()
    os.close(near)
    os.close(far)


def test_detect_finds_the_line_settings(run, at_port):
    talk = [(number * 0.1 + part, data) for number in range(60) for part, data in ((0.0, ENQUIRY), (0.03, VALUE))]
    at_port(PlayedPort([(time_s + 0.5, data) for time_s, data in talk]))
    code, output = run("/dev/ttyUSB9", "--json", "--detect")
    found = objects(output)
    assert code == 0
    assert found[0]["what"] == "detected"
    assert found[0]["protocols"] == ["vabus"]
    assert found[0]["settings"] == {"baudrate": 19200, "bytesize": 7, "parity": "E", "stopbits": 1}
    assert "reply" in {one["what"] for one in found[1:]}


def test_detect_exits_with_3_if_nothing_can_be_decoded(run, at_port):
    at_port(PlayedPort([(1000.0, b"never")]))
    code, output = run("/dev/ttyUSB9", "--detect")
    assert code == 3
    assert output.err.startswith("drivecomm: /dev/ttyUSB9: nothing could be decoded with the usual line settings")


def test_detect_is_refused_at_a_port_without_line_settings(run):
    near, far = os.openpty()
    code, output = run(os.ttyname(far), "--detect")
    os.close(near)
    os.close(far)
    assert code == 2
    assert "nothing to detect" in output.err


def test_sniff_sends_nothing_to_a_serial_server(run):
    got = []

    def serve(door):
        server, _ = door.accept()
        with server:
            server.settimeout(5)
            server.sendall(ENQUIRY)
            got.append(server.recv(100))

    with socket.create_server(("127.0.0.1", 0)) as door:
        # If the command does not connect, the test fails after 5 s and does not hang.
        door.settimeout(5)
        thread = threading.Thread(target=serve, args=(door,))
        thread.start()
        code, output = run(f"socket://127.0.0.1:{door.getsockname()[1]}", "--json", "--for", "0.3")
        thread.join()
    assert code == 0
    assert objects(output)[0]["data"] == ENQUIRY.hex(" ").upper()
    assert got == [b""]


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["nothing.jsonl"], "nothing.jsonl"),
        (["/dev/ttyUSB9", "--table", "--json"], "choose one"),
        (["/dev/ttyUSB9", "--protocol", "profibus"], "profibus"),
        (["/dev/ttyUSB9", "--drive", "vabus"], "PROTOCOL:ADDRESS"),
        (["/dev/ttyUSB9", "--parity", "X"], "parity 'X'"),
        (["/dev/ttyUSB9", "--drive", "vabus:99"], "no drive at address 99"),
        (["/dev/ttyUSB9", "--drive", "vabus:1,model=none"], "no model 'none'"),
        (["/dev/ttyUSB9", "--drive", "vabus:1,colour=red"], "no option 'colour'"),
        (["rfc2217://127.0.0.1:1"], "without sending"),
        (["socket://127.0.0.1:1", "--shared"], "shared by its server"),
    ],
)
def test_sniff_refuses_wrong_arguments_in_one_sentence(run, arguments, text):
    code, output = run(*arguments)
    assert code == 2
    assert text in output.err
    assert output.err.count("\n") == 1


def test_detect_is_refused_for_a_capture(run, capture):
    code, output = run(capture, "--detect")
    assert code == 2
    assert "--detect" in output.err


FC = {"kind": "parameter", "address_format": "1-31", "address": 3, "pnu": 341, "ind": 0}
WRITE = encode("danfoss-fc", {**FC, "ak": 13, "pwe": 300, "control_word": 0, "reference": 0}, direction="request")
REFUSAL = encode("danfoss-fc", {**FC, "ak": 7, "pwe": 17, "status_word": 0x607, "main_actual": 0}, direction="reply")


@pytest.fixture
def written(tmp_path):
    """Return a function that writes a capture of several lines from triples of line, time and bytes."""

    def write(*pieces):
        path = tmp_path / "lines.jsonl"
        with CaptureWriter(path, Provenance(settings=SETTINGS)) as writer:
            for line, time_s, data in sorted(pieces, key=lambda each: each[1]):
                writer.add(Piece(time_s=time_s, data=data, line=line))
        return str(path)

    return write


def test_several_lines_of_a_capture_are_kept_apart(run, written):
    path = written(("west", 1.0, ENQUIRY), ("east", 1.01, READ), ("west", 1.03, VALUE))
    _, output = run(path)
    lines = output.out.splitlines()
    assert [line.split()[0] for line in lines[:3]] == ["west", "east", "west"]
    assert lines[2].endswith("[30.0 ms]")
    _, output = run(path, "--json")
    counted = {(one["line"], one["drive"]) for one in objects(output) if one["what"] == "statistics"}
    assert counted == {("west", "vabus:1"), ("east", "fuji:5")}


def test_refusal_is_shown_with_its_reason(run, written):
    path = written(("", 5.0, WRITE), ("", 5.02, REFUSAL))
    _, output = run(path, "--names")
    assert "3-41 ramp_1_up_time: the drive refused parameter 3-41 with code 17" in output.out
    _, output = run(path, "--names", "--json")
    assert "code 17" in objects(output)[1]["refusal"]


def test_late_and_unrequested_replies_are_marked(run, written):
    other = encode("vabus", {"kind": "value", "address": 9, "parameter": 7, "data": "0001"}, direction="reply")
    path = written(("", 0.0, ENQUIRY), ("", 0.7, READ), ("", 0.9, VALUE), ("", 5.0, other))
    _, output = run(path, "--errors")
    lines = output.out.splitlines()
    assert lines[1].endswith("[900.0 ms]  [late]")
    assert any(line.endswith("[unsolicited]") for line in lines)


def test_undecodable_bytes_are_shown_in_hexadecimal(run, written):
    path = written(("", 1.0, b"hello"), ("", 9.0, WRITE[:8] + b"\x00"), ("", 20.0, ENQUIRY), ("", 20.3, b"\x04"))
    _, output = run(path, "--errors")
    assert "~~" in output.out
    assert "68 65 6C 6C 6F" in output.out
    assert "??" in output.out
    _, output = run(path, "--json")
    ambiguous = next(one for one in objects(output) if one["what"] == "ambiguous")
    assert ambiguous["readings"] == [{"protocol": "vabus", "direction": "request", "fields": {"kind": "eot"}}]


def test_sniff_refuses_to_write_to_the_capture_that_is_read(run, capture):
    code, output = run(capture, "--write", capture)
    assert code == 2
    assert "is the capture that is read; write to another file" in output.err
    assert [piece.data for piece in read_capture(capture).pieces] == [data for _, data in TALK]
