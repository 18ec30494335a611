"""SIGTERM and SIGHUP end a command as Ctrl-C does, an ignored SIGHUP stays ignored; missing streams are filled."""

import asyncio
import os
import signal
import subprocess
import sys
import time

import pytest

from drivecomm.cli import event_loop, signals
from drivecomm.virtual import virtual_drive

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals are POSIX")

CODES = {"SIGINT": 130, "SIGTERM": 143, "SIGHUP": 129}


@pytest.fixture
def interruptible(monkeypatch):
    """Install the signal handlers of a command process; restore the earlier handlers after the test."""
    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)
    before = {number: signal.getsignal(number) for number in map(signal.Signals.__getitem__, CODES)}
    signals.interrupt()
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.usefixtures("interruptible")
@pytest.mark.parametrize("name", CODES)
def test_interrupted_scan_writes_the_drives_found_so_far(shell, tmp_path, name):
    line = shell.line(virtual_drive("vabus", 1), virtual_drive("vabus", 2))
    path = tmp_path / "plant.toml"
    line.call_at(3, lambda: signal.raise_signal(signal.Signals[name]))
    given = ("--wide", "--protocol", "vabus", "-a", "1-30", "--write", str(path))
    assert shell("scan", *given) == CODES[name]
    assert shell.err.endswith("drivecomm: interrupted\n")
    assert 'drive = "vabus:1"' in path.read_text(encoding="utf-8")


@pytest.mark.usefixtures("interruptible")
@pytest.mark.parametrize("name", CODES)
def test_signal_interrupts_a_read(shell, name):
    line = shell.line()
    line.power_off(line.drives[0])
    line.call_at(0.1, lambda: signal.raise_signal(signal.Signals[name]))
    assert shell("read", "vabus:1", "481", "--json") == CODES[name]
    assert shell.err == "drivecomm: interrupted\n"
    assert shell.objects == [{"error": "interrupted", "kind": "Error", "exit_code": CODES[name]}]
    assert line.time < 0.2


@pytest.mark.usefixtures("interruptible")
def test_two_signals_in_a_row_count_as_the_first(shell):
    line = shell.line()
    line.call_at(0.001, lambda: (signal.raise_signal(signal.SIGHUP), signal.raise_signal(signal.SIGTERM)))
    assert shell("read", "vabus:1", "481") == CODES["SIGHUP"]
    assert shell.err == "drivecomm: interrupted\n"


class Finalized:
    """Object whose finaliser raises a signal; the interpreter reports an exception there and does not propagate it."""

    def __del__(self):
        signal.raise_signal(signal.SIGINT)


@pytest.mark.usefixtures("interruptible")
def test_signal_in_a_finaliser_is_not_lost(shell, tmp_path):
    line = shell.line(virtual_drive("vabus", 1))
    line.call_at(0.5, Finalized)
    # A thread repeats the signal, and on a busy machine the thread may run late.
    line.call_at(0.6, lambda: [time.sleep(0.01) for _ in range(1000)])
    given = ("--wide", "--protocol", "vabus", "-a", "1-63", "--write", str(tmp_path / "plant.toml"))
    assert shell("scan", *given) == CODES["SIGINT"]
    assert "Exception ignored" not in shell.err
    assert "Traceback" not in shell.err
    assert shell.err.endswith("drivecomm: interrupted\n")


class Broken:
    def __del__(self):
        raise OSError("this is told")


@pytest.mark.usefixtures("interruptible")
def test_other_error_in_a_finaliser_is_reported(shell):
    line = shell.line(virtual_drive("vabus", 1))
    line.call_at(0.001, Broken)
    assert shell("read", "vabus:1", "481") == 0
    assert "this is told" in shell.err


POLL = [sys.executable, "-m", "drivecomm", "poll", "vabus:1", "481", "--port", "loop://", "--period", "0"]


@pytest.mark.parametrize("name", CODES)
def test_signal_interrupts_a_process(name):
    with subprocess.Popen(POLL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as polling:
        polling.stdout.readline()
        polling.send_signal(signal.Signals[name])
        _, told = polling.communicate()
    assert (polling.returncode, told) == (CODES[name], "drivecomm: interrupted\n")


def test_process_under_nohup_survives_the_end_of_its_terminal():
    command = ["sh", "-c", 'trap "" HUP; exec "$@"', "sh", *POLL]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as polling:
        polling.stdout.readline()
        polling.send_signal(signal.SIGHUP)
        assert polling.stdout.readline()
        polling.send_signal(signal.SIGTERM)
        polling.communicate()
    assert polling.returncode == CODES["SIGTERM"]


def test_opened_file_never_takes_the_number_of_a_missing_stream():
    program = (
        "import os, sys; [os.close(number) for number in (0, 1, 2)]; sys.stdin = sys.stdout = sys.stderr = None;"
        "from drivecomm.cli import streams; streams.guard();"
        "opened = os.open(os.devnull, os.O_RDONLY); sys.stdout.write('lost'); sys.stderr.write('lost');"
        "sys.exit(opened if sys.stdin.read() == '' else 1)"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode >= 3


@pytest.mark.usefixtures("interruptible")
class TestEventLoop:
    @pytest.fixture(autouse=True)
    def _command_begins(self, interruptible):  # noqa: ARG002 - must be set up first
        signals.loaded()

    @pytest.mark.parametrize("name", CODES)
    def test_signal_cancels_a_coroutine_and_lets_it_clean_up(self, name):
        ended = []

        async def waiting():
            asyncio.get_running_loop().call_soon(signal.raise_signal, signal.Signals[name])
            try:
                await asyncio.sleep(10)
            finally:
                ended.append(name)

        with pytest.raises(KeyboardInterrupt):
            event_loop.run(waiting)
        assert ended == [name]
        assert signals.interrupted() == signal.Signals[name]

    def test_signal_while_the_loop_is_created_prevents_the_coroutine(self, monkeypatch):
        make = asyncio.new_event_loop

        def interrupted():
            signal.raise_signal(signal.SIGINT)
            return make()

        monkeypatch.setattr(asyncio.events, "new_event_loop", interrupted)
        begun = []

        async def never():
            begun.append(1)

        with pytest.raises(KeyboardInterrupt):
            event_loop.run(never)
        assert not begun

    def test_signal_after_the_coroutine_has_ended_changes_nothing(self, monkeypatch):
        async def done():
            loop = asyncio.get_running_loop()
            monkeypatch.setattr(loop, "close", lambda: (signal.raise_signal(signal.SIGINT), type(loop).close(loop)))
            return 7

        assert event_loop.run(done) == 7

    def test_coroutine_that_cancels_itself_is_not_an_interruption(self):
        async def cancelled():
            raise asyncio.CancelledError

        with pytest.raises(asyncio.CancelledError):
            event_loop.run(cancelled)
