"""Poll plans on many real lines in one thread: other callers, dead drives, lost lines, and the end of a plan."""

import threading
import time
from contextlib import ExitStack

import pytest
from polled_lines import Site

import drivecomm
from drivecomm.errors import LinkDownError, NoReplyError, OvertakenError
from drivecomm.line import PollItem
from drivecomm.virtual import virtual_drive


@pytest.fixture
def site_with():
    with ExitStack() as stack:
        yield lambda **options: Site("many lines in one thread", stack, **options)


@pytest.fixture
def site(site_with):
    return site_with()


def working_threads():
    return [thread for thread in threading.enumerate() if thread.name.startswith("drivecomm")]


def of_line(results, number):
    return [result for result in results if result.drive == f"line {number}"]


def test_one_thread_serves_all_lines(site):
    results = site.poll("481", period_s=0, cycles=20)
    first = next(results)
    assert len(working_threads()) == 1
    assert len([first, *results]) == 60
    assert not working_threads()
    for bus in site.buses:
        assert bus.counters["vabus:1"]["replies"] == 20
        assert bus.statistics["vabus:1"].reply_times.count == 20


@pytest.mark.soak
def test_poll_periods_are_kept_without_drift(site):
    results = list(site.poll("481", period_s=0.05, cycles=11))
    for number in range(3):
        its = of_line(results, number)
        # On a busy machine, reads that come too late are counted as missed, and the due times do not drift.
        periods = 10 + sum(result.missed for result in its[1:])
        assert its[-1].due_s - its[0].due_s == pytest.approx(0.05 * periods)


@pytest.mark.soak
def test_dead_drive_delays_no_other_line(site):
    dead = site.buses[2].drive("vabus", 9, reply_timeout_s=0.5, attempts=1)
    more = [PollItem(drive=dead, parameter="481", period_s=0, name="dead", options={"type": "long"})]
    results = list(site.poll("481", more=more, period_s=0, duration_s=1.0))
    failed = [result for result in results if result.drive == "dead"]
    assert isinstance(failed[0].error, NoReplyError)
    assert len(failed) <= 4
    for number in (0, 1):
        assert len(of_line(results, number)) > 20
        assert max(result.took_s for result in of_line(results, number)) < 0.3


@pytest.mark.soak
def test_other_callers_use_a_polled_line_and_go_first(site):
    results, errors, enough = site.poll("481", period_s=0), [], threading.Event()
    next(results)

    def read_on():
        for result in results:
            errors.append(result.error)
            if enough.is_set():
                break

    reader = threading.Thread(target=read_on)
    reader.start()
    drive = site.buses[0].drive("vabus", 1, model="agile", deadline_s=3.0)
    for _ in range(30):
        assert drive.read("481").raw is not None
    drive.start()
    assert drive.status().running
    drive.stop()
    enough.set()
    reader.join()
    results.close()
    site.assert_free()
    assert {type(error) for error in errors} <= {type(None), OvertakenError}
    # One link counts both the polls and the calls of others.
    assert site.buses[0].counters["vabus:1"]["replies"] > 30


@pytest.mark.soak
def test_idle_line_is_free_and_its_plan_ends_immediately(site):
    results = site.poll("481", period_s=60)
    for _ in site.buses:
        next(results)
    drive = site.buses[0].drive("vabus", 1, deadline_s=2.0)
    for _ in range(10):
        drive.status()
    # After this time, only the end of the plan can wake the thread of the lines.
    time.sleep(0.5)
    began = time.monotonic()
    results.close()
    assert time.monotonic() - began < 2.0


@pytest.mark.soak
def test_port_that_is_slow_to_open_delays_no_other_line(site):
    line, opened = site.buses[1].line, []
    opens = line.open_port

    def open_slowly():
        opened.append(time.monotonic())
        time.sleep(1.5)
        return opens()

    line.let_go()
    line.open_port = open_slowly
    results = list(site.poll("481", period_s=0.02, duration_s=2.5))
    assert len(opened) == 1
    assert max(result.took_s for result in of_line(results, 0)) < 1.0
    assert any(result.error is None for result in of_line(results, 1))


@pytest.mark.soak
@pytest.mark.parametrize("kind", ["pty", "tcp"])
def test_lost_line_is_reopened_while_the_others_continue(site, kind, host_of):
    host, phase, end = host_of(kind, virtual_drive("vabus", 1)), "before", time.monotonic() + 20
    with drivecomm.open_bus(host.address) as bus:
        more = [PollItem(drive=bus.drive("vabus", 1, model="agile"), parameter="481", period_s=0.02)]
        for result in site.poll("481", more=more, period_s=0.02):
            assert time.monotonic() < end, phase
            if result.drive.startswith("line"):
                assert result.error is None
            elif phase == "before" and result.error is None:
                host.end()
                phase = "lost"
            elif phase == "lost" and result.error is not None:
                assert isinstance(result.error, LinkDownError | drivecomm.PortError)
                host.begin(virtual_drive("vabus", 1))
                phase = "back"
            elif phase == "back" and result.error is None:
                break
    assert phase == "back"


@pytest.mark.soak
def test_many_failures_in_a_row_do_not_deepen_the_stack(site):
    dead = [site.buses[0].drive("vabus", address, reply_timeout_s=0.01, attempts=1) for address in range(2, 30)]
    for drive in dead:
        for _ in range(3):
            with pytest.raises(drivecomm.DriveCommError):
                drive.probe()
    more = [PollItem(drive=drive, parameter=str(400 + n), period_s=0.5) for drive in dead for n in range(40)]
    results = list(site.poll("481", more=more, period_s=0, duration_s=1.5))
    assert len(of_line(results, 1)) > 3
    assert len([result for result in results if result.error is not None]) > len(more)


def test_recorder_and_trace_get_all_bytes_of_the_lines(site_with):
    class Record:
        def __init__(self):
            self.said = {True: b"", False: b""}

        def add(self, piece):
            self.said[piece.source == "master"] += piece.data

    record, told = Record(), {"sent": b"", "received": b""}

    def trace(event):
        if event.what in told:
            told[event.what] += event.data

    assert len(list(site_with(record=record, trace=trace).poll("481", period_s=0, cycles=10))) == 30
    assert sorted(record.said[True]) == sorted(told["sent"])
    assert sorted(record.said[False]) == sorted(told["received"])


@pytest.mark.soak
def test_lines_without_a_descriptor_have_their_own_threads(site, serving):
    with serving([virtual_drive("vabus", 1)], "rfc2217") as server, drivecomm.open_bus(server.address) as bus:
        more = [PollItem(drive=bus.drive("vabus", 1, model="agile"), parameter="481", period_s=0, name="remote")]
        results = site.poll("481", more=more, period_s=0, cycles=5)
        came = [next(results), next(results)]
        assert len([each for each in working_threads() if each.name == "drivecomm poll"]) == 2
        came += results
        assert {result.drive for result in came} == {"line 0", "line 1", "line 2", "remote"}
        assert {result.error for result in came} == {None}
