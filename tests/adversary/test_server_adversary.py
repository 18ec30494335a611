"""Search over the server: a sample at each change, two thousand scripts in a long run."""

import subprocess
import sys
import threading
from pathlib import Path

import forked_scripts as forked
import planted_mistakes
import pytest
from clocked_lines import Seen
from extents import LONG
from orders import Book, Start, Stop, Trouble
from server_judge import Judge

FOLDER = Path(__file__).parent
SCRIPTS, REAL_SCRIPTS = (2000, 80) if LONG else (30, 3)
PLANTED_SCRIPTS = 100
PATIENCE_S = 1800 if LONG else 300
SOON = ("leases_never_expire", "a_stop_goes_to_the_first_drive_of_the_line")
"""Mistakes that a few scripts find; the others are planted only in a long run."""

linux = pytest.mark.skipif(sys.platform != "linux", reason="it needs forks, signals and limits of processes")


def campaign(program, *words):
    done = subprocess.run(
        [sys.executable, str(FOLDER / program), *words],
        capture_output=True, text=True, timeout=PATIENCE_S, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr


@linux
@pytest.mark.soak
@pytest.mark.timeout(PATIENCE_S + 30)
def test_motors_stop_in_time_with_a_disturbed_server():
    campaign("server_campaign.py", "--scripts", str(SCRIPTS), "--seed", "night" if LONG else "short")


@linux
@pytest.mark.soak
@pytest.mark.timeout(PATIENCE_S + 30)
def test_motors_stop_in_time_with_a_disturbed_server_process():
    campaign(
        "real_servers.py", "--scripts", str(REAL_SCRIPTS), "--seed", "night" if LONG else "short", "--at-once", "8"
    )


@linux
@pytest.mark.soak
@pytest.mark.timeout(PATIENCE_S)
@pytest.mark.parametrize("name", planted_mistakes.MISTAKES if LONG else SOON)
def test_planted_mistake_is_found(name):
    assert planted_mistakes.found_after(name, "planted", PLANTED_SCRIPTS)


def test_hanging_script_is_ended_with_a_stack_trace():
    with pytest.raises(RuntimeError, match=r"(?s)Timeout.*in stuck_here"):
        forked.result_of(stuck_here, 0.2)


def stuck_here():
    threading.Event().wait(60)


# Tests of the judge itself, with invented data.


def seen(*changes):
    return {drive: [Seen(0.0, False, 0.0, True, 0)] for drive in ("pump", "fan", "saw", "mill")} | {
        "fan": [Seen(at, running, 0.0, True, 0) for at, running in ((0.0, False), *changes)]
    }


def told(truth, starts=(), stops=(), troubles=(), deaths=()):
    book = Book(starts=list(starts), stops=list(stops), troubles=list(troubles), deaths=list(deaths))
    return list(Judge(book, truth, 100.0).failures())


START = {"at": 10.0, "door": "http", "drive": "fan", "answered": 10.2, "outcome": "done"}


def test_motor_running_without_a_start_is_found():
    assert any("began to run" in each for each in told(seen((10.0, True), (11.0, False))))


def test_started_motor_may_run_until_it_is_stopped():
    start, stop = Start(**START), Stop(20.0, "http", "fan", 20.1, "done")
    assert told(seen((10.1, True), (20.5, False)), [start], [stop]) == []
    assert any("stopped over http" in each for each in told(seen((10.1, True), (30.0, False)), [start], [stop]))


def test_stop_of_a_silent_drive_counts_from_its_return():
    start, stop = Start(**START), Stop(20.0, "http", "fan", 21.0, "open")
    silent = Trouble(19.0, 29.0, "requests lost", line="hall", dead=False)
    assert told(seen((10.1, True), (40.0, False)), [start], [stop], [silent]) == []
    assert told(seen((10.1, True), (50.0, False)), [start], [stop], [silent])


def test_motor_running_without_its_commander_is_found():
    start = Start(**START, present_until=15.0)
    assert told(seen((10.1, True), (17.0, False)), [start]) == []
    assert any("its commander was gone" in each for each in told(seen((10.1, True), (19.0, False)), [start]))


def test_stop_without_a_server_is_not_required():
    start, death = Start(**{**START, "local": True}), [15.0, "killed", 18.0]
    for at, failures in ((16.0, 0), (20.0, 1)):
        stop = Stop(at, "sparkplug", "fan", at + 0.1)
        assert len(told(seen((10.1, True), (30.0, False)), [start], [stop], deaths=[death])) == failures


def test_motor_running_after_the_server_died_is_found():
    start, death = Start(**START), [15.0, "killed", 15.0]
    assert told(seen((10.1, True), (18.5, False)), [start], deaths=[death]) == []
    assert any(
        "the server was killed" in each for each in told(seen((10.1, True), (21.0, False)), [start], deaths=[death])
    )


def test_motor_started_under_a_standing_stop_is_found():
    stands = Stop(5.0, "modbus-tcp", "fan", 5.0, "open", stands_until=90.0)
    assert told(seen((10.1, True), (12.0, False)), [Start(**START)], [stands])


def test_motor_running_after_a_refused_start_is_found():
    refused = Start(**{**START, "outcome": "refused"})
    assert told(seen((10.1, True), (11.0, False)), [refused])
