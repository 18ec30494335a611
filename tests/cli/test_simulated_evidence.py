"""Evidence that simulate gives about a master in any language: trace, recording, violations, faults, listeners."""

import json
import os
import signal
import socket
import subprocess
import sys
from contextlib import ExitStack

import pytest
import serial

from drivecomm.capture import read_capture

posix = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals and signals are POSIX")

ENQUIRY = b"\x04A00481\x05"


@pytest.fixture
def simulate(tmp_path):
    """Yield a function that starts simulate and returns its process and the first object that it prints."""
    with ExitStack() as opened:

        def start(*arguments):
            process = subprocess.Popen(
                [sys.executable, "-m", "drivecomm", "simulate", "--drive", "vabus:1,model=agile", *arguments, "--json"],
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                cwd=tmp_path,
            )
            opened.callback(process.communicate)
            opened.callback(process.kill)
            line = process.stdout.readline()
            return process, json.loads(line or process.communicate()[1])

        yield start


def command(*arguments, cwd):
    return subprocess.run(
        [sys.executable, "-m", "drivecomm", *arguments],
        check=False,
        capture_output=True,
        text=True,
        timeout=60,
        cwd=cwd,
    )


def opened(port, timeout=2):
    return serial.serial_for_url(port, baudrate=19200, bytesize=7, parity="E", timeout=timeout)


def ended(process):
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=20)
    assert process.returncode == 0, (out, err)
    return [json.loads(line) for line in err.splitlines()]


@posix
@pytest.mark.parametrize("suffix", ["jsonl", "pcapng"])
def test_record_is_read_by_sniff_and_played_by_replay(simulate, tmp_path, suffix):
    process, _ = simulate("--listen", "pty:line", "--record", f"rec.{suffix}", "--trace")
    with opened(str(tmp_path / "line")) as port:
        for _ in range(3):
            port.write(ENQUIRY)
            assert len(port.read(19)) == 19
    trace = ended(process)
    assert [each["telegram"].split()[0] for each in trace] == ["enquiry", "value"] * 3
    capture = read_capture(tmp_path / f"rec.{suffix}")
    assert [each.source for each in capture.pieces] == ["master", "drive"] * 3
    assert capture.provenance.drives == ("vabus:1",)
    assert str(capture.provenance.settings) == "19200 7E1"
    heard = command("sniff", f"rec.{suffix}", cwd=tmp_path)
    assert heard.returncode == 0
    assert heard.stdout.count("enquiry address=1 sys=0 dataset=0 parameter=481") == 3
    replaying = subprocess.Popen(
        [sys.executable, "-m", "drivecomm", "replay", f"rec.{suffix}", "--listen", "pty:again"],
        stdout=subprocess.PIPE,
        text=True,
        cwd=tmp_path,
    )
    try:
        assert "the drives of the capture on again" in replaying.stdout.readline()
        with opened(str(tmp_path / "again")) as port:
            port.write(ENQUIRY)
            assert port.read(19) == capture.pieces[1].data
    finally:
        replaying.send_signal(signal.SIGINT)
        replaying.communicate(timeout=20)


@posix
def test_faults_violations_and_counters_over_the_control_socket(simulate, tmp_path):
    fault = 'kind = "drop", of = "reply to a read", every = 3'
    control = "unix:control"
    process, _ = simulate("--listen", "pty:line", "--fault", fault, "--control", control)
    answers = []
    with opened(str(tmp_path / "line"), timeout=0.6) as port:
        for _ in range(3):
            port.write(ENQUIRY)
            answers.append(len(port.read(19)))
    with serial.Serial(str(tmp_path / "line"), 1200, timeout=2) as port:
        port.write(ENQUIRY)
        answers.append(len(port.read(19)))
    assert answers == [19, 19, 0, 19]
    found = command("plant", "violations", "--control", control, cwd=tmp_path)
    assert found.returncode == 1
    assert "the master sent with 1200 baud and one stop bit, but the drive uses 19200 7E1" in found.stdout
    counted = command("plant", "counters", "--control", control, cwd=tmp_path).stdout
    assert "fault: drop of reply to a read, every 3; happened: 1 of 4" in counted
    assert "enquiry 4" in counted
    told = command("plant", "telegrams", "--control", control, "--since", "2", cwd=tmp_path).stdout
    assert told.splitlines()[0].split()[0] == "3"
    assert "19200 7E1" in command("plant", "state", "--control", control, cwd=tmp_path).stdout
    ended(process)


def test_second_client_listens_while_the_master_is_served(simulate):
    _, told = simulate("--listen", "tcp:127.0.0.1:0", "--listeners")
    place = told["listening"].removeprefix("socket://").split(":")
    with (
        socket.create_connection((place[0], int(place[1])), timeout=5) as listener,
        opened(told["listening"]) as port,
    ):
        port.write(ENQUIRY)
        assert len(port.read(19)) == 19
        heard = b""
        while len(heard) < 27:
            heard += listener.recv(100)
    assert heard.startswith(ENQUIRY)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--record", "rec.txt"], "not a capture file"),
        (["--record", "there.jsonl"], "there.jsonl exists already"),
        (["--fault", 'kind = "dropp"'], "unknown kind of fault 'dropp'"),
        (["--fault", "every third"], "cannot be read as a fault"),
        (["--listeners"], "can have no listeners"),
    ],
)
def test_simulate_refuses_wrong_options_in_one_sentence(tmp_path, arguments, says):
    (tmp_path / "there.jsonl").touch()
    listen = "rfc2217:127.0.0.1:0" if arguments == ["--listeners"] else "tcp:127.0.0.1:0"
    done = command("simulate", "--drive", "vabus:1", "--listen", listen, *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert says in done.stderr


def test_keys_of_virtual_drives_are_accepted_as_options(simulate):
    process, told = simulate("--drive", "vabus:2,needs_pause_s=0.5", "--listen", "tcp:127.0.0.1:0")
    second = b"\x04B00481\x05"
    with opened(told["listening"]) as port:
        port.write(second)
        assert len(port.read(19)) == 19
        port.timeout = 0.3
        port.write(second)
        assert not port.read(19)
    process.kill()
