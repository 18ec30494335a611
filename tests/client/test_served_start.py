"""Motors kept by a server: they run while the lease is renewed, and stop when it is released or expires."""

import threading
import time

import pytest
from fake_server import serving
from running_server import running_server

import drivecomm
from drivecomm.client import ServedStart
from drivecomm.errors import LeaseError, NotSupported
from drivecomm.protocol import DriveState


@pytest.fixture
def pump(plant):
    """Yield the pump as a drive of a running server."""
    with running_server(plant), drivecomm.open_plant(plant) as opened:
        yield opened.drive("pump")


@pytest.mark.soak
def test_kept_motor_runs_for_longer_than_one_lease(pump):
    with ServedStart(pump, 2.0) as kept:
        kept.start("trip", watchdog_s=3, percent=40)
        until = time.monotonic() + 3.0
        while time.monotonic() < until:
            assert pump.status().running
            time.sleep(0.2)


def test_leaving_the_block_releases_the_lease_and_stops_the_motor(pump):
    stop = threading.Event()
    with ServedStart(pump, 20.0) as kept:
        kept.start("trip", watchdog_s=3, percent=5)
        told = []
        for event in kept.events(stop):
            told.append(event["done"])
            if told[-1] == "started":
                stop.set()
    assert told == ["watchdog set", "started", "stop commanded"]
    assert pump.wait_for(DriveState.READY, 5.0).state is DriveState.READY


def test_error_inside_the_block_stops_the_motor_and_is_raised(pump):
    def fail():
        with ServedStart(pump, 20.0) as kept:
            kept.start("trip", watchdog_s=3, percent=5)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert pump.wait_for(DriveState.READY, 5.0).state is DriveState.READY


def test_impossible_policy_is_refused_and_the_motor_stays_off(pump):
    with pytest.raises(NotSupported, match="it can hold or trip"), ServedStart(pump, 5.0) as kept:
        kept.start("ramp", watchdog_s=3)
    assert not pump.status().running


def test_other_callers_cannot_acquire_the_lease_but_may_stop_the_motor(pump, plant):
    with ServedStart(pump, 20.0) as kept, drivecomm.open_plant(plant) as others:
        kept.start("trip", watchdog_s=3)
        with pytest.raises(LeaseError):
            ServedStart(others.drive("pump"), 5.0).__enter__()
        others.drive("pump").stop()
        assert [event["done"] for event in kept.events(threading.Event())][-1] == "stop commanded"


def test_lost_renewal_is_repeated_and_the_motor_keeps_its_lease(plant, monkeypatch):
    monkeypatch.setattr("drivecomm.bus.keep_policy.SHORTEST_LEASE_S", 0.06)
    with serving(plant) as server, drivecomm.open_plant(plant) as opened:
        renewed, request = threading.Semaphore(0), server.requests.append

        class Requests(list):
            def append(self, one):
                request(one)
                if one[0] == "PUT":
                    renewed.release()

        server.requests = Requests()
        with ServedStart(opened.drive("pump"), 0.0):
            server.drops = 1
            # The first renewal gets no answer, and the lease is renewed all the same.
            assert renewed.acquire(timeout=10)
            assert renewed.acquire(timeout=10)
            assert renewed.acquire(timeout=10)
        assert server.drops == 0
