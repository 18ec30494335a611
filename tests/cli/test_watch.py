"""The watch and plot commands, and poll --log: their results, and refused arguments."""

import contextlib
import os
import re
import select
import struct
import subprocess
import sys
import time

import pytest

import drivecomm.cli.poll
import drivecomm.cli.watch.command as watching
from drivecomm.cli.line_options import LineArguments
from drivecomm.errors import UsageError
from drivecomm.plant.value_log import read_rows
from drivecomm.virtual import virtual_drive

if sys.platform != "win32":
    import fcntl
    import termios

PLANT = """
format = 1
[[line]]
name = "hall"
port = "/dev/ttyUSB0"
baudrate = 9600
[[drive]]
name = "pump"
drive = "vabus:1"
options = { model = "agile" }
"""


@pytest.fixture
def plant_file(tmp_path):
    path = tmp_path / "plant.toml"
    path.write_text(PLANT, encoding="utf-8")
    return str(path)


def test_watched_lines_come_from_the_plant_file(plant_file):
    (line,) = watching.watched_lines([plant_file], LineArguments(attempts=2))
    assert (line.name, line.port, line.options) == ("hall", "/dev/ttyUSB0", {"attempts": 2, "baudrate": 9600})
    assert [drive.name for drive in line.drives] == ["pump"]


@pytest.mark.usefixtures("plant_file")
def test_watched_lines_come_from_the_default_plant(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DRIVECOMM_PLANT", raising=False)
    (line,) = watching.watched_lines([], LineArguments())
    assert line.name == "hall"
    (tmp_path / "plant.toml").rename(tmp_path / "works.toml")
    with pytest.raises(UsageError, match="nothing to watch"):
        watching.watched_lines([], LineArguments())
    monkeypatch.setenv("DRIVECOMM_PLANT", "works.toml")
    assert [line.name for line in watching.watched_lines([], LineArguments())] == ["hall"]
    with pytest.raises(UsageError, match="nothing to watch"):
        watching.watched_lines([], LineArguments(port="/dev/ttyUSB0", given=frozenset({"port"})))
    assert [line.name for line in watching.watched_lines([], LineArguments(port="/dev/ttyUSB0"))] == ["hall"]


def test_watched_line_of_a_port_holds_the_named_drives():
    options = LineArguments(port="/dev/ttyUSB0", parity="e", echo="expect", rs485=True)
    (line,) = watching.watched_lines(["vabus:1,model=agile", "danfoss-fc:3"], options)
    assert (line.name, line.options) == ("/dev/ttyUSB0", {"parity": "E", "echo": "expect", "rs485": True})
    assert [(drive.name, drive.options) for drive in line.drives] == [
        ("vabus:1", {"parity": "E", "model": "agile"}),
        ("danfoss-fc:3", {"parity": "E"}),
    ]


def test_watch_refuses_wrong_arguments(shell, plant_file, tmp_path, monkeypatch):
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    for arguments, port, code, message in (
        ([], None, 2, "nothing to watch; name a plant file, or drives"),
        (["vabus:1"], None, 2, "no port: give --port"),
        ([plant_file, "vabus:1"], None, 2, "give one plant file or drives, not both"),
        ([plant_file], "line", 2, "so --port has no effect; leave it out"),
        ([str(tmp_path / "none.toml")], None, 2, "there is no such file"),
        ([plant_file, "--json"], None, 2, "use drivecomm poll for --json"),
        ([plant_file, "--for", "0"], None, 2, "--for 0 s is not a valid time"),
        ([plant_file], None, 2, "watch needs a terminal; without one, use drivecomm poll"),
    ):
        assert shell("watch", *arguments, port=port) == code
        assert message in shell.err, arguments
        assert shell.err.count("\n") == 1


def in_a_terminal(monkeypatch, *but):
    for name in {"stdin", "stdout", "stderr"} - set(but):
        monkeypatch.setattr(getattr(sys, name), "isatty", lambda: True, raising=False)


def test_watch_names_the_stream_that_is_not_a_terminal(shell, plant_file, monkeypatch):
    in_a_terminal(monkeypatch, "stderr")
    assert shell("watch", plant_file, port=None) == 2
    assert shell.err == (
        "drivecomm: watch needs the terminal for standard error, too; do not redirect it, or use drivecomm poll\n"
    )


def test_watch_refuses_a_name_that_no_drive_has(shell, plant_file, monkeypatch):
    in_a_terminal(monkeypatch)
    names = ("--name", "output_frequency", "--name", "torque", "--name", "inside_temperature")
    assert shell("watch", plant_file, *names, port=None) == 2
    assert "no drive here has " in shell.err
    assert "output_frequency" not in shell.err


def test_watch_refuses_an_unknown_common_name_and_log_format(shell, plant_file, monkeypatch):
    in_a_terminal(monkeypatch)
    assert shell("watch", plant_file, "--name", "colour", port=None) == 2
    assert "unknown common name 'colour'" in shell.err
    assert shell("watch", plant_file, "--log", "log.txt", port=None) == 2
    assert "a log is .csv or .parquet" in shell.err


def test_watch_without_textual_names_the_extra(shell, plant_file, monkeypatch):
    in_a_terminal(monkeypatch)
    for name in [name for name in sys.modules if name.startswith("drivecomm.cli.watch.screen")]:
        monkeypatch.delitem(sys.modules, name)
    for name in ("textual", "textual.app"):
        monkeypatch.setitem(sys.modules, name, None)
    assert shell("watch", plant_file, port=None) == 2
    assert shell.err == "drivecomm: watch needs textual, which is not installed; install drivecomm[watch]\n"


class Terminal:
    """Command in a terminal of 80 columns and 24 lines."""

    def __init__(self, *arguments):
        self._own, theirs = os.openpty()
        fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
        self.process = subprocess.Popen(
            [sys.executable, "-m", "drivecomm", *arguments],
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            env={**os.environ, "TERM": "xterm-256color"},
            start_new_session=True,
        )
        os.close(theirs)
        self.shown = ""

    def read_until(self, text, seconds=40):
        ends = time.monotonic() + seconds
        while text not in self.shown:
            assert time.monotonic() < ends, f"no {text!r} in {self.shown[-2000:]!r}"
            if select.select([self._own], [], [], 0.2)[0]:
                self.shown += re.sub(r"\x1b\[[0-9;]*[mH]", "", self._read().decode("utf-8", "replace"))

    def _read(self):
        try:
            return os.read(self._own, 65536)
        except OSError:
            # On Linux, reading a terminal whose program has ended raises OSError.
            raise AssertionError(f"it has ended after {self.shown[-2000:]!r}") from None

    def press(self, key):
        os.write(self._own, key)

    def left(self):
        """Read the remaining output, wait until the command ends, and return its exit code."""
        with contextlib.suppress(OSError):
            while select.select([self._own], [], [], 20)[0] and (more := os.read(self._own, 65536)):
                self.shown += more.decode("utf-8", "replace")
        os.close(self._own)
        return self.process.wait(timeout=20)


@pytest.mark.soak
@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals there")
def test_watch_shows_values_and_writes_a_log_in_a_terminal(tmp_path):
    link = tmp_path / "line"
    simulator = subprocess.Popen(
        [sys.executable, "-m", "drivecomm", "simulate", "-d", "vabus:1", "-l", f"pty:{link}"],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert "vabus:1 on" in simulator.stdout.readline()
        log = tmp_path / "log.parquet"
        terminal = Terminal("watch", "vabus:1,model=agile", "-p", str(link), "--period", "0.2", "--log", str(log))
        terminal.read_until("not ready")
        terminal.read_until("0.00")
        terminal.press(b"q")
        assert terminal.left() == 0
        assert "Traceback" not in terminal.shown
        none = Terminal("watch", "vabus:1", "-p", str(tmp_path / "none"))
        assert none.left() == 3
        assert "none does not exist" in none.shown
    finally:
        simulator.terminate()
        simulator.communicate(timeout=20)
    rows = list(read_rows(log))
    assert {row.quality for row in rows} == {"good"}
    assert {row.name for row in rows} >= {"status", "output_frequency"}
    assert list(tmp_path.glob("log*")) == [log]


def test_application_loads_no_slow_module():
    code = (
        "import sys, drivecomm.cli.app\n"
        "slow = {'textual', 'pyarrow', 'matplotlib', 'numpy', 'asyncio', 'csv', 'drivecomm.plant.watching', "
        "'drivecomm.plant.value_log', 'drivecomm.plant.value_plots'}\n"
        "print(sorted(slow & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout == "[]\n"


@pytest.mark.soak
@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_poll_writes_a_log_and_plot_draws_it(shell, tmp_path, ending):
    line = shell.line(virtual_drive("vabus", 1), virtual_drive("danfoss-fc", 3))
    log = tmp_path / f"log.{ending}"
    words = ["vabus:1,model=agile", "481", "output_frequency", "danfoss-fc:3,model=fc300", "16-30"]
    assert shell("poll", *words, "999", "--cycles", "3", "--log", str(log)) == 5
    assert len(shell.out.splitlines()) == 12
    rows = list(read_rows(log))
    assert len(rows) == 12
    assert {(row.drive, row.name, row.unit) for row in rows} == {
        ("vabus:1", "481", "Hz"),
        ("vabus:1", "output_frequency", "Hz"),
        ("danfoss-fc:3", "16-30", "V"),
        ("danfoss-fc:3", "999", ""),
    }
    assert line.time > 0
    page = tmp_path / "plot.html"
    assert shell("plot", str(log), "-o", str(page), port=None) == 0
    assert shell.out == f"{page}: 3 curves\n"
    assert "16-30" in page.read_text(encoding="utf-8")
    drawing = tmp_path / "one.svg"
    chosen = ["--drive", "vabus:1", "--name", "481", "--json"]
    assert shell("plot", str(log), "-o", str(drawing), *chosen, port=None) == 0
    assert shell.objects == [{"output": str(drawing), "curves": 1, "drives": 0, "faults": 0}]


def test_ctrl_c_completes_the_log_file(shell, tmp_path, monkeypatch):
    shell.line()
    results = drivecomm.cli.poll.carry_out

    def interrupted(items, **how):
        for number, result in enumerate(results(items, **how)):
            if number == 3:
                raise KeyboardInterrupt
            yield result

    monkeypatch.setattr(drivecomm.cli.poll, "carry_out", interrupted)
    log = tmp_path / "log.parquet"
    assert shell("poll", "vabus:1,model=agile", "481", "--log", str(log)) == 130
    assert len(list(read_rows(log))) == 3
    assert list(tmp_path.iterdir()) == [log]


def test_plot_refuses_wrong_arguments(shell, tmp_path):
    shell.line()
    log = tmp_path / "log.csv"
    assert shell("poll", "vabus:1,model=agile", "481", "--cycles", "1", "--log", str(log)) == 0
    for arguments, message in (
        ([str(log), "-o", "plot.pdf"], "a plot is .png, .svg or .html"),
        ([str(tmp_path / "none.csv"), "-o", "plot.png"], "cannot be read as a log"),
        ([str(log), "-o", "plot.png", "--drive", "pump"], "the log has no drive 'pump'; it has vabus:1"),
        ([str(log)], "--output"),
    ):
        assert shell("plot", *arguments, port=None) == 2
        assert message in shell.err


def test_wrong_log_format_is_refused_before_anything_is_read(shell, tmp_path):
    line = shell.line()
    assert shell("poll", "vabus:1", "481", "--cycles", "1", "--log", str(tmp_path / "log.txt")) == 2
    assert "a log is .csv or .parquet" in shell.err
    assert line.time == 0


def test_wrong_log_format_is_reported_before_a_missing_port(shell, tmp_path):
    shell.line()
    log = tmp_path / "log.xlsx"
    for option, message in (
        ("--log", f"drivecomm: {log}: a log is .csv or .parquet; give it one of these endings\n"),
        ("--record", f"drivecomm: {log} is not a capture file; name it .jsonl, or .pcapng for Wireshark\n"),
    ):
        assert shell("poll", "vabus:1", "481", option, str(log), port="nowhere") == 2
        assert shell.err == message


def test_no_log_is_created_if_the_port_cannot_be_opened(shell, tmp_path):
    for name in ("log.csv", "log.parquet"):
        assert shell("poll", "vabus:1", "481", "--log", str(tmp_path / name), port="nowhere") == 3
    assert not list(tmp_path.iterdir())


def test_unreadable_parameters_are_refused_before_a_log_is_created(shell, tmp_path):
    line = shell.line()
    log = tmp_path / "log.csv"
    words = ["vabus:1,model=agile", "481", "output_colour", "fuji:7,model=g11s", "output_current"]
    assert shell("poll", *words, "--log", str(log)) == 2
    assert shell.err.startswith("drivecomm: the plan has what can never be read, take it out: vabus:1 ")
    assert "vabus:1 output_colour (" in shell.err
    assert "fuji:7 output_current (model g11s does not say which parameter is the output_current" in shell.err
    assert shell.err.count("\n") == 1
    assert line.time == 0
    assert not log.exists()


def test_log_agrees_with_the_screen(shell, tmp_path):
    shell.line(virtual_drive("vabus", 1))
    log = tmp_path / "log.csv"
    words = ["vabus:1,model=agile", "output_frequency", "481", "999"]
    shell("poll", *words, "--cycles", "1", "--log", str(log), "--json")
    (frequency, fixed, nothing) = shell.objects
    assert [one["quality"] for one in (frequency, fixed, nothing)] == ["good", "good", "bad"]
    assert [(row.name, row.quality) for row in read_rows(log)] == [
        (one["parameter"], one["quality"]) for one in shell.objects
    ]
