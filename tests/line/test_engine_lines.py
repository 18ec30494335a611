"""Poll plans on many real lines, which one thread serves: values, errors, other callers, lost lines, and the end."""

from __future__ import annotations

import threading
import time
from contextlib import ExitStack, contextmanager

import pytest

import drivecomm
from drivecomm.errors import LinkDownError, NoReplyError, OvertakenError
from drivecomm.line import PollItem
from drivecomm.transport import SerialPort
from drivecomm.virtual import Server, parse_listen, virtual_drive

KINDS = ("pty", "tcp")
LONG = {"type": "long"}


@contextmanager
def lines(tmp_path, number, kind="pty", protocol="vabus", **options):
    """Serve so many lines with one drive each, and give their virtual drives and buses."""
    stop = threading.Event()
    with ExitStack() as stack:
        servers, drives, buses, threads = [], [], [], []
        for each in range(number):
            drive = virtual_drive(protocol, 1)
            listen = f"pty:{tmp_path / f'line{each}'}" if kind == "pty" else f"{kind}:127.0.0.1:0"
            server = stack.enter_context(Server([drive], parse_listen(listen)))
            threads.append(threading.Thread(target=server.run, args=(stop,)))
            threads[-1].start()
            servers.append(server)
            drives.append(drive)
        try:
            buses += [stack.enter_context(drivecomm.open_bus(server.address, **options)) for server in servers]
            yield drives, buses
        finally:
            for bus in buses:
                bus.close()
            stop.set()
            for thread in threads:
                thread.join()


def items(buses, **options):
    return [
        PollItem(drive=bus.drive("vabus", 1), parameter="481", options=LONG, name=f"line {number}", **options)
        for number, bus in enumerate(buses)
    ]


def working_threads():
    return [thread for thread in threading.enumerate() if thread.name.startswith("drivecomm")]


@pytest.mark.soak
@pytest.mark.parametrize("kind", KINDS)
def test_one_thread_serves_all_lines(tmp_path, kind):
    with lines(tmp_path, 8, kind) as (drives, buses):
        for number, drive in enumerate(drives):
            drive.poke("481", 1000 + number)
        results = drivecomm.poll(items(buses, period_s=0), cycles=20)
        first = next(results)
        assert len(working_threads()) == 1
        came = [first, *results]
        assert len(came) == 160
        assert not working_threads()
        for result in came:
            assert result.error is None
            assert result.reading.value == 1000 + int(result.drive.removeprefix("line "))
        for bus in buses:
            assert bus.counters["vabus:1"]["replies"] == 20
            assert bus.statistics["vabus:1"].reply_times.count == 20


@pytest.mark.soak
def test_periods_are_kept(tmp_path):
    with lines(tmp_path, 3) as (_, buses):
        results = list(drivecomm.poll(items(buses, period_s=0.05), cycles=11))
        assert len(results) == 33
        for line in {result.drive for result in results}:
            its = [result for result in results if result.drive == line]
            # However busy the machine is: what was not asked in time is missed, and nothing drifts.
            periods = 10 + sum(result.missed for result in its[1:])
            assert its[-1].due_s - its[0].due_s == pytest.approx(0.05 * periods)


@pytest.mark.soak
def test_a_dead_drive_delays_no_other_line(tmp_path):
    with lines(tmp_path, 3, reply_timeout_s=0.5, attempts=1) as (_, buses):
        plan = items(buses[:2], period_s=0)
        plan.append(PollItem(drive=buses[2].drive("vabus", 9), parameter="481", period_s=0, name="dead"))
        results = list(drivecomm.poll(plan, duration_s=1.0))
        dead = [result for result in results if result.drive == "dead"]
        assert dead
        assert isinstance(dead[0].error, NoReplyError)
        assert 1 <= len(dead) <= 4
        for name in ("line 0", "line 1"):
            mine = [result for result in results if result.drive == name]
            assert len(mine) > 20
            assert max(result.took_s for result in mine) < 0.3


@pytest.mark.soak
def test_others_use_a_line_meanwhile_and_go_first(tmp_path):
    with lines(tmp_path, 2) as (_, buses):
        results, errors = drivecomm.poll(items(buses, period_s=0)), []
        next(results)
        enough = threading.Event()

        def read_on():
            for result in results:
                errors.append(result.error)
                if enough.is_set():
                    break

        reader = threading.Thread(target=read_on)
        reader.start()
        drive = buses[0].drive("vabus", 1, deadline_s=3.0)
        for _ in range(30):
            assert drive.read("481", type="long").raw is not None
        drive.start()
        assert drive.status().running
        drive.stop()
        enough.set()
        reader.join()
        results.close()
        assert not working_threads()
        assert {type(error) for error in errors} <= {type(None), OvertakenError}
        # What was polled and what others asked for is counted by one link.
        assert buses[0].counters["vabus:1"]["replies"] > 30


def test_others_need_not_wait_for_a_line_on_which_nothing_is_due(tmp_path):
    with lines(tmp_path, 2) as (_, buses):
        results = drivecomm.poll(items(buses, period_s=60))
        next(results)
        next(results)
        drive = buses[0].drive("vabus", 1, deadline_s=2.0)
        for _ in range(10):
            drive.status()
        results.close()


@pytest.mark.soak
def test_a_plan_that_is_given_up_ends_at_once(tmp_path):
    with lines(tmp_path, 2, reply_timeout_s=0.2) as (_, buses):
        results = drivecomm.poll(items(buses, period_s=60))
        next(results)
        next(results)
        # Until nothing but this can wake who serves the lines.
        time.sleep(0.5)
        began = time.monotonic()
        results.close()
        assert time.monotonic() - began < 2.0


@pytest.mark.soak
def test_a_port_that_takes_long_to_open_delays_no_other_line(tmp_path):
    opened = []

    def open_slowly():
        opened.append(time.monotonic())
        if len(opened) > 1:
            time.sleep(1.5)
        return SerialPort(slow_place)

    with lines(tmp_path, 2) as (_, buses):
        slow_place = str(tmp_path / "line1")
        buses[1].close()
        with drivecomm.open_bus(open_slowly) as slow:
            slow.line.port.close()
            slow.line.port = None
            results = list(drivecomm.poll(items([buses[0], slow], period_s=0.02), duration_s=2.5))
    assert len(opened) == 2
    quick = [result for result in results if result.drive == "line 0"]
    assert max(result.took_s for result in quick) < 1.0
    assert any(result.drive == "line 1" and result.error is None for result in results)


@pytest.mark.soak
def test_a_lost_line_is_opened_again_and_the_others_go_on(tmp_path):
    with lines(tmp_path, 2) as (_, buses):
        stop = threading.Event()
        place = tmp_path / "unplugged"
        seen = {"good": 0, "lost": 0}

        def serve():
            with Server([virtual_drive("vabus", 1)], parse_listen(f"pty:{place}")) as server:
                opened.set()
                server.run(stop)

        opened = threading.Event()
        thread = threading.Thread(target=serve)
        thread.start()
        opened.wait()
        with drivecomm.open_bus(str(place)) as bus:
            plan = [*items(buses, period_s=0.02), PollItem(drive=bus.drive("vabus", 1), parameter="481", period_s=0.02)]
            phase, until = "before", time.monotonic() + 20
            for result in drivecomm.poll(plan):
                assert time.monotonic() < until, (phase, seen)
                if result.drive.startswith("line"):
                    assert result.error is None
                    continue
                if phase == "before" and result.error is None:
                    stop.set()
                    thread.join()
                    phase = "lost"
                elif phase == "lost" and result.error is not None:
                    assert isinstance(result.error, LinkDownError | drivecomm.PortError)
                    stop.clear()
                    opened.clear()
                    thread = threading.Thread(target=serve)
                    thread.start()
                    opened.wait()
                    phase = "back"
                elif phase == "back" and result.error is None:
                    break
        stop.set()
        thread.join()
    assert phase == "back"


@pytest.mark.soak
def test_many_that_fail_at_once_go_no_deeper(tmp_path):
    with lines(tmp_path, 2) as (_, buses):
        dead = [buses[0].drive("vabus", address, reply_timeout_s=0.01, attempts=1) for address in range(2, 30)]
        for drive in dead:
            for _ in range(3):
                with pytest.raises(drivecomm.DriveCommError):
                    drive.probe()
        plan = [PollItem(drive=drive, parameter=str(400 + n), period_s=0.5) for drive in dead for n in range(40)]
        results = list(drivecomm.poll([*plan, *items(buses, period_s=0)], duration_s=1.5))
        assert len([result for result in results if result.drive == "line 1"]) > 3
        assert len([result for result in results if result.error is not None]) > len(plan)


def test_what_goes_over_the_lines_is_recorded(tmp_path):
    class Record:
        def __init__(self):
            self.said = {True: b"", False: b""}

        def add(self, piece):
            self.said[piece.source == "master"] += piece.data

    record, sent, came = Record(), [], []

    def trace(event):
        if event.what in ("sent", "received"):
            (sent if event.what == "sent" else came).append(event.data)

    with lines(tmp_path, 2, record=record, trace=trace) as (_, buses):
        results = list(drivecomm.poll(items(buses, period_s=0), cycles=10))
    assert len(results) == 20
    assert sorted(record.said[True]) == sorted(b"".join(sent))
    assert sorted(record.said[False]) == sorted(b"".join(came))


@pytest.mark.soak
def test_lines_without_a_descriptor_have_threads_of_their_own(tmp_path):
    with lines(tmp_path, 1) as (_, pty), lines(tmp_path, 1, "rfc2217") as (_, remote):
        results = drivecomm.poll(items([*pty, *remote], period_s=0), cycles=5)
        came = [next(results), next(results)]
        assert len([each for each in working_threads() if each.name == "drivecomm poll"]) == 2
        came += results
        assert {result.drive for result in came} == {"line 0", "line 1"}
        assert len(came) == 10
        assert {result.error for result in came} == {None}
