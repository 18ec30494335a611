"""Behaviour of a kept motor common to all callers: blocking or async, on an own line or on one of a server.

In real time, which a server's leases need. tests/bus/test_keeping.py tests the details of feeding in virtual time.
tests/server/test_keep_through_a_server.py tests decisions of a server alone: the holder of the lease, a killed program.
"""

import threading
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from real_lines import running
from running_server import running_server
from two_faces import carry_out_on, keep_on, open_on, own_threads, reach_on

from drivecomm.bus import reading_watchdog
from drivecomm.errors import NotSupported, StateError, UsageError
from drivecomm.protocol import DriveState
from drivecomm.virtual import virtual_drive

LOCAL = {"threads": "threads", "tasks": "tasks"}
SERVED = {"served": "threads", "awaited-served": "tasks"}
DRIVES = {"danfoss-fc": ("fc300", "ramp"), "vabus": ("agile", "trip")}
WATCHDOG_S = 3
SOON_S = 10.0
PLANT = """
format = 1
[[line]]
name = "hall"
port = "{port}"
[[drive]]
name = "pump"
line = "hall"
drive = "{protocol}:2"
options = {{ model = "{model}" }}
armed = true
"""


class Bench:
    """A virtual drive behind a real socket, and the drive object of one face."""

    def __init__(self, kind, protocol, stack):
        self.model, self.policy = DRIVES[protocol]
        self.virtual = virtual_drive(protocol, 2, model=self.model, reply_delay_s=0.0)
        port = stack.enter_context(running([self.virtual], "tcp:127.0.0.1:0")).address
        if kind in SERVED:
            text = PLANT.format(port=port, protocol=protocol, model=self.model)
            file = Path(stack.enter_context(TemporaryDirectory())) / "plant.toml"
            file.write_text(text, encoding="utf-8")
            plant = stack.enter_context(running_server(file))
            stack.enter_context(own_threads())
            self._until(lambda: all(each.reachability == "answers" for each in plant.drives()))
        face = (LOCAL | SERVED)[kind]
        self.bus = stack.enter_context((reach_on if kind in SERVED else open_on)(face, port))
        self.drive = self.bus.drive(protocol, 2, model=self.model)

    def keep(self, policy=None, **options):
        return keep_on(self.drive, policy or self.policy, watchdog_s=WATCHDOG_S, **options)

    def watchdog(self):
        return carry_out_on(self.drive, reading_watchdog(self.drive.name, self.drive.model))

    def comes_to_rest(self):
        self._until(lambda: not self.drive.status().running)

    @staticmethod
    def _until(condition):
        over = threading.Event()
        for _ in range(int(SOON_S / 0.01)):
            if condition():
                return
            over.wait(0.01)
        pytest.fail("it does not come about")


@pytest.fixture(params=LOCAL | SERVED)
def kind(request):
    return request.param


@pytest.fixture(params=["danfoss-fc", pytest.param("vabus", marks=pytest.mark.soak)])
def bench(request, kind):
    with ExitStack() as stack:
        yield Bench(kind, request.param, stack)


@pytest.mark.soak
def test_motor_outlives_its_watchdog_time_and_stops_on_leaving_the_block(bench):
    earlier, statuses = bench.watchdog(), []
    with bench.keep(on_status=statuses.append) as kept:
        assert (kept.watchdog.policy, kept.watchdog.time_s) == (bench.policy, WATCHDOG_S)
        bench.drive.set_reference(percent=5)
        bench.drive.start()
        kept.sleep(WATCHDOG_S + 1.5)
        assert bench.virtual.motor.running
        assert not bench.virtual.motor.fault
        assert statuses[-1].state is DriveState.RUNNING
    bench.comes_to_rest()
    assert not bench.virtual.motor.fault
    assert bench.watchdog() == earlier


def test_error_in_the_block_stops_the_motor(bench):
    def program():
        with bench.keep():
            bench.drive.set_reference(percent=5)
            bench.drive.start()
            assert bench.virtual.motor.running
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        program()
    bench.comes_to_rest()


def test_tripped_drive_can_be_kept_and_refuses_the_start(bench):
    bench.virtual.trip(5, bench.virtual.motor.time)
    with pytest.raises(StateError, match="reset it first"), bench.keep():
        bench.drive.start()
    assert not bench.virtual.motor.running


def test_motor_coasts_if_on_leaving_is_coast(bench):
    with bench.keep(on_leaving="coast"):
        bench.drive.set_reference(percent=5)
        bench.drive.start()
    assert not bench.virtual.motor.running


def test_unknown_policy_is_refused_before_anything_is_sent(bench):
    with pytest.raises(UsageError, match="unknown policy 'jump'"), bench.keep("jump"):
        pytest.fail("the block was entered")
    with pytest.raises(UsageError, match="unknown policy 'fall'"), bench.keep(on_leaving="fall"):
        pytest.fail("the block was entered")


def test_on_leaving_hold_leaves_the_motor_running_only_on_an_own_line(bench, kind):
    """A server stops every motor that it releases, so it refuses `on_leaving` hold."""
    if kind in SERVED:
        with pytest.raises(NotSupported, match="leave on_leaving out"), bench.keep(on_leaving="hold"):
            pytest.fail("the block was entered")
        return
    with bench.keep(on_leaving="hold"):
        bench.drive.set_reference(percent=5)
        bench.drive.start()
    assert bench.virtual.motor.running


def test_motor_is_stopped_and_started_again_within_the_block(bench):
    with bench.keep():
        bench.drive.set_reference(percent=5)
        bench.drive.start()
        bench.drive.stop("coast")
        assert not bench.virtual.motor.running
        bench.drive.start()
        assert bench.virtual.motor.running
    bench.comes_to_rest()


def test_entering_keep_does_not_stop_a_running_motor(bench):
    bench.drive.set_reference(percent=5)
    bench.drive.start()
    with bench.keep():
        assert bench.virtual.motor.running
    bench.comes_to_rest()


def test_second_block_keeps_the_motor_after_the_first(bench):
    for _ in range(2):
        with bench.keep():
            bench.drive.set_reference(percent=5)
            bench.drive.start()
            assert bench.virtual.motor.running
        bench.comes_to_rest()
