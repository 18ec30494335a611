"""The doctor command on virtual lines, and in real time over pseudo-terminals and the network."""

import json
import os
import threading
import time
import tty
from contextlib import contextmanager

import pytest
from serving_threads import served_in_thread

from drivecomm.cli import main
from drivecomm.virtual import Server, VirtualLine, parse_listen, virtual_drive

posix = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals are POSIX")
# One protocol with short reply times and one address: a silent line then costs only 0.1 s.
FEW = ("--protocol", "fuji", "--addresses", "1", "--quick")


def test_sound_line_has_no_problems(shell):
    shell.line(virtual_drive("vabus", 1), virtual_drive("fuji", 3))
    assert shell("doctor", "line", "--quick", port=None) == 0
    assert "PROBLEM" not in shell.out
    assert shell.out.endswith("no problems found\n")
    for part in (
        "the line is quiet",
        "does not echo what it sends",
        "vabus:1 answers",
        "fuji:3 answers",
        "vabus:1 is done",
    ):
        assert part in shell.out


def test_problem_is_printed_with_its_remedy_and_exits_with_1(shell):
    shell.line(echo=True)
    assert shell("doctor", "line", "--protocol", "vabus", "--quick", port=None) == 1
    assert "PROBLEM  echo    the adapter echoes what it sends\n" in shell.out
    assert "> use --echo expect" in shell.out
    assert shell.out.endswith("1 problem found\n")
    assert shell("doctor", "line", "--protocol", "vabus", "--quick", "--echo", port=None) == 0


def test_port_may_come_from_an_option_or_the_environment(shell, monkeypatch):
    shell.line()
    assert shell("doctor", "--protocol", "vabus", "--quick") == 0
    monkeypatch.setenv("DRIVECOMM_PORT", "line")
    assert shell("doctor", "--protocol", "vabus", "--quick", port=None) == 0
    assert shell("doctor", "line", "--protocol", "vabus", "--quick", port="elsewhere") == 2
    assert "line is the port, so --port has no effect" in shell.err
    monkeypatch.setenv("DRIVECOMM_PORT", "elsewhere")
    assert shell("doctor", "line", "--protocol", "vabus", "--quick", port=None) == 0, "the argument counts"


def test_doctor_prints_json(shell):
    shell.line(echo=True)
    assert shell("doctor", "line", "--protocol", "vabus", "--quick", "--json", port=None) == 1
    *findings, measured = shell.objects
    assert {each["finding"] for each in findings} == {"port", "noise", "echo", "drives", "time"}
    assert [each["finding"] for each in findings if each["weight"] == "problem"] == ["echo"]
    assert measured["port"] == "line"
    assert measured["report"] is None
    assert [each["kind"] for each in measured["echo"]] == ["whole"] * 3
    assert measured["drives"][0]["drive"] == "vabus:1"
    assert len(measured["replies"][0]["times_ms"]) == measured["replies"][0]["answered"] == 10
    assert shell.err == ""


def test_line_settings_of_the_command_line_are_used(shell):
    shell.line(virtual_drive("vabus", 1, baudrate=9600))
    assert shell("doctor", "line", "--protocol", "vabus", "--addresses", "1", port=None) == 1
    assert "vabus:1 answers at 9600 7E1, not at 19200 7E1" in shell.out
    assert shell("doctor", "line", "--protocol", "vabus", "--addresses", "1", "--baudrate", "9600", port=None) == 0


def test_trace_shows_the_telegrams_of_the_examination(shell):
    shell.line()
    assert shell("doctor", "line", "--protocol", "vabus", "--quick", "--trace", port=None) == 0
    assert "->  vabus:1" in shell.err


@pytest.mark.parametrize(
    ("arguments", "code", "sentence"),
    [
        ([], 2, "no port"),
        (["nowhere"], 3, "does not exist"),
        (["line", "--addresses", "a-b"], 2, "1-31"),
        (["line", "--protocol", "profibus"], 2, "profibus"),
        (["line", "--baudrate", "1"], 2, "baud rate"),
        (["line", "--echo=perhaps"], 2, "expect"),
    ],
)
def test_wrong_call_is_refused_in_one_sentence(shell, arguments, code, sentence):
    shell.line()
    assert shell("doctor", *arguments, port=None) == code
    assert sentence in shell.err
    assert shell.err.count("\n") == 1
    assert "Traceback" not in shell.err


def test_broken_line_exits_with_3(shell):
    class Failing(VirtualLine):
        def transmit(self, data):
            self.broken = True
            super().transmit(data)

    shell.lines["line"] = Failing([virtual_drive("vabus", 1)])
    assert shell("doctor", "line", port=None) == 3
    assert "the virtual line is broken" in shell.err
    assert shell.err.count("\n") == 1


@contextmanager
def served(listen, *drives, **options):
    with served_in_thread(Server(drives, parse_listen(listen), **options)) as server:
        yield server.address


def examined(capsys, port, *more):
    code = main(["doctor", port, *FEW, "--json", *more])
    captured = capsys.readouterr()
    *findings, measured = [json.loads(text) for text in captured.out.splitlines()]
    return code, {each["finding"]: each for each in findings if each["weight"] == "problem"}, measured


@pytest.mark.soak
@posix
def test_pseudo_terminal_has_no_problems(capsys, tmp_path):
    with served(f"pty:{tmp_path / 'line'}", virtual_drive("fuji", 1), paced=True) as port:
        code, problems, measured = examined(capsys, port)
    assert (code, problems) == (0, {})
    assert measured["report"]["kind"] == "pseudo-terminal"
    assert [each["drive"] for each in measured["drives"]] == ["fuji:1"]
    (replies,) = measured["replies"]
    assert all(took > wire for took, wire in zip(replies["times_ms"], replies["wire_ms"], strict=True))


@pytest.mark.soak
@posix
def test_echo_of_a_pseudo_terminal_is_found(capsys, tmp_path):
    with served(f"pty:{tmp_path / 'line'}", virtual_drive("fuji", 1), echo=True) as port:
        code, problems, measured = examined(capsys, port)
    assert (code, set(problems)) == (1, {"echo"})
    assert [each["drive"] for each in measured["drives"]] == ["fuji:1"]


@pytest.mark.soak
@posix
def test_pseudo_terminal_without_drives_is_a_problem(capsys, tmp_path):
    with served(f"pty:{tmp_path / 'line'}") as port:
        code, problems, _ = examined(capsys, port)
    assert (code, set(problems)) == (1, {"drives"})
    assert "no drive answers" in problems["drives"]["text"]


@pytest.mark.soak
@posix
def test_noise_on_a_pseudo_terminal_is_found(capsys):
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    done = threading.Event()

    def rustle():
        while not done.wait(0.02):
            os.write(ours, b"\xfe\x91")

    thread = threading.Thread(target=rustle)
    thread.start()
    try:
        code, problems, measured = examined(capsys, os.ttyname(theirs))
    finally:
        done.set()
        thread.join()
        os.close(ours)
        os.close(theirs)
    assert code == 1
    assert "came unrequested" in problems["noise"]["text"]
    assert measured["unclear_bytes"] > 0


@pytest.mark.soak
def test_wrong_baud_rate_over_rfc_2217_is_found(capsys):
    with served("rfc2217:127.0.0.1:0", virtual_drive("fuji", 1, baudrate=19200), paced=True) as port:
        code, problems, measured = examined(capsys, port)
        assert (code, set(problems)) == (1, {"drives"})
        assert measured["report"]["kind"] == "RFC 2217"
        time.sleep(0.2)
        code, problems, _ = examined(capsys, port, "--baudrate", "19200")
    assert (code, problems) == (0, {})


@pytest.mark.soak
def test_doctor_reports_the_facts_that_a_tcp_port_hides(capsys):
    with served("tcp:127.0.0.1:0", virtual_drive("fuji", 1)) as address:
        port = f"socket://{address.rpartition('//')[2].removeprefix('tcp:')}"
        assert main(["doctor", port, *FEW]) == 0
    text = capsys.readouterr().out
    assert "the server sets the line settings" in text
    assert "cannot be known from here" in text
