"""replay and vectors from-capture: a capture is played as master or as drives, and becomes test vectors."""

import json
import os
import re
import signal
import subprocess
import sys

import pytest

from drivecomm.capture import CaptureWriter, Piece, Provenance, read_capture
from drivecomm.cli import main
from drivecomm.protocol import MotorCommand
from drivecomm.virtual import virtual_drive

posix = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals and signals are POSIX")


READ_AND_START = (["read", "danfoss-fc:3", "16-30"], ["start", "danfoss-fc:3", "--link-loss", "hold"])


@pytest.fixture
def session(shell, tmp_path):
    """Record a session with a drive, a read and ten seconds later a start; return the capture file."""
    shell.line(virtual_drive("danfoss-fc", 3))
    path = tmp_path / "session.jsonl"
    parts = []
    for number, words in enumerate(READ_AND_START):
        part = tmp_path / f"{number}.jsonl"
        assert shell(*words, "--record", str(part)) == 0
        parts += [read_capture(part)]
    with CaptureWriter(path, parts[0].provenance) as writer:
        for number, part in enumerate(parts):
            for piece in part.pieces:
                writer.add(Piece(time_s=piece.time_s + 10 * number, data=piece.data, source=piece.source))
    return path


def test_replay_to_the_same_line_finds_no_difference_and_starts_nothing(shell, session):
    line = shell.line(virtual_drive("danfoss-fc", 3))
    assert shell("replay", str(session)) == 0
    assert "0 with a different reply" in shell.out
    assert "--commands sends them, too" in shell.out
    assert line.drives[0].motor.command is MotorCommand.OFF


def test_commands_flag_also_sends_the_recorded_commands(shell, session):
    line = shell.line(virtual_drive("danfoss-fc", 3))
    assert shell("replay", str(session), "--commands", "--faster", "2") == 0
    assert "--commands" not in shell.out
    assert line.drives[0].motor.command is MotorCommand.RUN


def test_differences_are_printed_as_a_table(shell, session):
    line = shell.line(virtual_drive("danfoss-fc", 3))
    line.drives[0].poke("16-30", 321)
    assert shell("replay", str(session)) == 1
    assert "1 with a different reply" in shell.out
    assert "danfoss-fc:3 parameter" in shell.out
    assert "is 321" in shell.out


def test_differences_are_printed_as_json(shell, session):
    line = shell.line(virtual_drive("danfoss-fc", 3))
    line.drives[0].poke("16-30", 321)
    assert shell("replay", str(session), "--json") == 1
    *outcomes, end = shell.objects
    assert end == {"asked": sum(each["sent"] for each in outcomes), "different": 1, "left_out": end["left_out"]}
    assert end["left_out"] == sum(not each["sent"] for each in outcomes) > 0
    assert [bool(each["difference"]) for each in outcomes].count(True) == 1


def test_given_line_settings_override_those_of_the_capture(shell, session):
    shell.line(virtual_drive("danfoss-fc", 3, baudrate=19200))
    assert shell("replay", str(session), "--timeout", "0.1") == 1
    assert "nothing came" in shell.out
    assert shell("replay", str(session), "--baudrate", "19200") == 0


def test_cut_off_capture_is_replayed_with_a_note(shell, session):
    shell.line(virtual_drive("danfoss-fc", 3))
    content = session.read_bytes()
    session.write_bytes(content[:-10])
    assert shell("replay", str(session)) == 0
    assert "is cut off and left out" in shell.err


def test_replay_refuses_wrong_arguments(shell, session, tmp_path):
    shell.line()
    for words, what in [
        (["replay", str(tmp_path / "absent.jsonl")], "there is no such file"),
        (["replay", str(session), "--faster", "0"], "is not a valid speed factor"),
        (["replay", str(session), "--listen", "pty:x", "--commands"], "without --listen"),
        (["replay", str(session), "--listen", "pty:x"], "--port has no effect"),
        (["replay", str(session), "--record", str(tmp_path / "b.jsonl")], "does not record"),
    ]:
        assert shell(*words) == 2, words
        assert what in shell.err
        assert shell.err.count("\n") == 1
    assert shell("replay", str(session), "--listen", "nowhere", port=None) == 2
    assert "cannot listen" in shell.err
    assert shell("replay", str(session), port=None) == 2
    assert "give --port" in shell.err


def test_capture_without_senders_replays_like_any_other(shell, session, tmp_path):
    """The protocols show the sender of each telegram, so a capture without senders replays like any other."""
    recorded, path = read_capture(session), tmp_path / "tap.pcapng"
    with CaptureWriter(path, recorded.provenance) as writer:
        for piece in recorded.pieces:
            writer.add(Piece(time_s=piece.time_s, data=piece.data))
    line = shell.line(virtual_drive("danfoss-fc", 3))
    assert shell("replay", str(path)) == 0
    said = shell.out
    assert shell("replay", str(session)) == 0
    # The count of unsent telegrams may differ: a Danfoss process block is also a valid MOVILINK telegram.
    assert re.sub(r"\d+ not sent", "not sent", shell.out) == re.sub(r"\d+ not sent", "not sent", said)
    assert line.drives[0].motor.command is MotorCommand.OFF


@pytest.mark.soak
@posix
def test_replay_at_a_listening_port_answers_other_programs(session, tmp_path):
    place = tmp_path / "line"
    process = subprocess.Popen(
        [sys.executable, "-m", "drivecomm", "replay", str(session), "--listen", f"pty:{place}", "--json"],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        told = json.loads(process.stdout.readline())
        assert told["listening"] == str(place)
        assert told["requests"] > 2
        done = subprocess.run(
            [
                sys.executable,
                "-m",
                "drivecomm",
                "replay",
                str(session),
                "--port",
                str(place),
                "--commands",
                "--faster=5",
            ],
            capture_output=True,
            text=True,
            timeout=30,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        assert "0 with a different reply" in done.stdout
        read = subprocess.run(
            [sys.executable, "-m", "drivecomm", "read", "danfoss-fc:3", "16-30", "--port", str(place)],
            capture_output=True,
            text=True,
            timeout=30,
            check=False,
        )
        assert read.returncode == 0, read.stderr
        process.send_signal(signal.SIGINT)
        assert process.wait(10) == 0
    finally:
        process.kill()
        process.communicate()


def test_capture_becomes_vectors(shell, session, tmp_path):
    path = tmp_path / "captured.toml"
    assert shell("vectors", "from-capture", str(session), "--protocol", "danfoss-fc", port=None) == 0
    printed = shell.out
    output = ["--output", str(path)]
    assert shell("vectors", "from-capture", str(session), "--protocol", "danfoss-fc", *output, port=None) == 0
    assert path.read_text() == printed
    assert shell.out == f"{printed.count('[[vector]]')} vectors in {path}\n"
    assert main(["vectors", "check", str(path)]) == 0


def test_from_capture_refuses_wrong_arguments(shell, session, tmp_path):
    for words, what in [
        (["--protocol", "vabus"], "no telegram of vabus"),
        (["--protocol", "profibus"], "no installed protocol"),
        (["--protocol", "danfoss-fc", "--option", "colour=red"], "no option 'colour'"),
        (["--protocol", "danfoss-fc", "--output", str(tmp_path)], "cannot be written"),
        (["--protocol", "danfoss-fc", "--output", str(session)], "exists already"),
    ]:
        assert shell("vectors", "from-capture", str(session), *words, port=None) == 2
        assert what in shell.err


def test_cut_off_capture_becomes_vectors_with_a_note(shell, tmp_path):
    path = tmp_path / "a.pcapng"
    with CaptureWriter(path, Provenance()) as writer:
        for time_s in range(2):
            writer.add(Piece(time_s=time_s, data=bytes.fromhex("04 41 30 30 34 38 31 05")))
    path.write_bytes(path.read_bytes()[:-4])
    assert shell("vectors", "from-capture", str(path), "--protocol", "vabus", port=None) == 0
    assert "cut off" in shell.err
    assert shell.out.count("[[vector]]") == 1
