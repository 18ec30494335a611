"""Options of every command on a line: the spellings of --echo, and the options with which the port is opened."""

import pytest

import drivecomm.bus.opening
from drivecomm.virtual import VirtualLine, virtual_drive


@pytest.mark.parametrize(
    ("arguments", "echoed"),
    [
        (["vabus:1", "481", "--echo"], 8),
        (["--echo", "vabus:1", "481"], 8),
        (["vabus:1", "--echo", "481", "--attempts", "1"], 8),
        (["vabus:1", "481", "--echo", "expect"], 8),
        (["--echo=expect", "vabus:1", "481"], 8),
        (["--echo", "auto", "vabus:1", "481"], 8),
        (["vabus:1", "481", "--echo=auto"], 8),
    ],
)
def test_echo_flag_works_in_every_spelling(shell, arguments, echoed):
    shell.line(echo=True)
    assert shell("read", *arguments, "--trace") == 0
    (line,) = [text for text in shell.err.splitlines() if "=>" in text and "enquiry" not in text][:1]
    assert len(bytes.fromhex(line.partition("vabus:1")[2].partition("[")[0])) == echoed


@pytest.mark.parametrize("arguments", [[], ["--echo", "off"], ["--echo=off"]])
def test_unexpected_echo_is_explained(shell, arguments):
    shell.lines["line"] = VirtualLine([virtual_drive("vabus", 2)], echo=True)
    assert shell("read", "vabus:1", "481", "--attempts", "1", *arguments) == 4
    assert "the adapter echoes what it sends" in shell.err


def test_unknown_echo_mode_is_refused(shell):
    shell.line()
    assert shell("read", "vabus:1", "481", "--echo=perhaps") == 2
    assert all(mode in shell.err for mode in ("off", "expect", "auto"))
    assert shell.err.count("\n") == 1


def test_echo_after_two_dashes_is_an_argument(shell):
    shell.line()
    assert shell("read", "vabus:1", "--port", "line", "--", "--echo", port=None) == 2
    assert "--echo" in shell.err


@pytest.mark.parametrize(
    ("arguments", "opened"),
    [
        ([], {"rs485": False, "low_latency": None}),
        (["--rs485"], {"rs485": True, "low_latency": None}),
        (["--low-latency"], {"rs485": False, "low_latency": True}),
        (["--no-low-latency", "--rs485"], {"rs485": True, "low_latency": False}),
    ],
)
@pytest.mark.parametrize("command", [["read", "vabus:1", "481"], ["doctor", "--protocol", "vabus", "--quick"]])
def test_port_is_opened_with_the_given_options(shell, monkeypatch, command, arguments, opened):
    line, seen = shell.line(), []

    def opener(port, **options):
        if callable(port):
            return port
        seen.append((port, options))
        return line.port

    for place in (drivecomm.bus, drivecomm.bus.opening):
        monkeypatch.setattr(place, "port_opener", opener)
    assert shell(*command, *arguments, port="/dev/ttyUSB0") == 0
    assert seen == [("/dev/ttyUSB0", opened)]
