"""Stopping all drives of a line through every bus class: broadcasts first, then each drive, silent ones last."""

import time

import pytest
from line_faces import DEAD, LIVE, LOCAL, MODELS, SERVED, SOON_S, opened, until

from drivecomm.bus import StopResult, open_bus
from drivecomm.errors import ReplyError, UsageError
from drivecomm.protocol import DriveConfig, Stop
from drivecomm.virtual import VirtualLine, virtual_drive

KINDS = [kind for kind in (*LOCAL, *SERVED) if kind != "engine"]


class All:
    """A bus as a "drive" whose `stop_all` a face calls like any verb."""

    def __init__(self, bus, on_result):
        self._bus, self._on_result = bus, on_result

    def stop_all(self):
        return self._bus.stop_all(on_result=self._on_result)


def stopped(face, on_result=None):
    return face._begin(All(face.bus, on_result), "stop_all").result(6 * SOON_S)


def name_of(kind, address):
    return f"danfoss-fc{address}" if kind in SERVED else f"danfoss-fc:{address}"


@pytest.mark.parametrize("kind", KINDS)
def test_stop_all_stops_every_motor_and_reports_each_drive(kind):
    with opened(kind) as (face, on):
        for address in LIVE[1:]:
            face.result(address, "start")
        for address in (LIVE[0], DEAD[0]):
            face.drive(address)
        assert sum(drive.motor.running for drive in on.server.drives) == len(LIVE) - 1
        heard = []
        results = stopped(face, heard.append)
        assert heard == results
        confirmed = {each.drive for each in results if each.confirmed}
        assert confirmed == {name_of(kind, address) for address in LIVE}
        (dead,) = (each for each in results if each.drive == name_of(kind, DEAD[0]))
        assert isinstance(dead.error, ReplyError)
        assert [each.how for each in results if each.protocol] == [Stop.RAMP]
        assert results[0].drive == ""
        until(lambda: not any(drive.motor.running for drive in on.server.drives))


@pytest.mark.parametrize("kind", ["threads", "tasks"])
def test_stop_all_tries_silent_drives_once_before_the_others_and_again_after(kind):
    with opened(kind) as (face, on):
        for address in (*DEAD, *LIVE):
            face.drive(address)
        before, began = len(on.requests), time.monotonic()
        results = stopped(face)
        live = LIVE[-1]
        order = [address for address in on.asked(before) if address in (*DEAD, *LIVE)]
        assert order[: len(DEAD) + len(LIVE)] == [*DEAD, *LIVE]
        assert order[len(DEAD) + len(LIVE) :] == [*DEAD]
        at = next(at for at, address in on.requests[before:] if address == live)
        assert at - began < len(DEAD) * 3 * 0.1 + 2.0, "each dead drive costs one reply time before the others"
        assert [each.drive for each in results if not each.protocol] == [name_of(kind, each) for each in (*LIVE, *DEAD)]


def test_stop_all_sends_a_broadcast_first_unless_it_would_coast():
    for protocol, sends in (("danfoss-fc", True), ("vabus", False)):
        line = VirtualLine([virtual_drive(protocol, 1, model=MODELS[protocol])])
        with open_bus(line.port) as bus:
            bus.drive(protocol, 1, model=MODELS[protocol])
            results = bus.stop_all()
            assert [bool(each.protocol) for each in results] == [True, False] if sends else [False]
            assert [each.how for each in bus.stop_all(Stop.COAST) if each.protocol] == [Stop.COAST]


def test_stop_all_uses_the_model_that_another_object_of_the_drive_has():
    line = VirtualLine([virtual_drive("modbus", 1, model="schneider-atv320")])
    with open_bus(line.port) as bus:
        drive = bus.drive("modbus", 1, model="schneider-atv320")
        bus.drive("modbus", 1)
        assert [each.confirmed for each in bus.stop_all() if each.drive] == [True], drive


def test_stop_all_of_a_closed_bus_reports_each_drive():
    line = VirtualLine([virtual_drive("vabus", 1)])
    with open_bus(line.port) as bus:
        bus.drive("vabus", 1)
    (result,) = bus.stop_all()
    assert result.drive == "vabus:1"
    assert isinstance(result.error, UsageError)


def test_stop_all_of_a_bus_without_drives_sends_nothing():
    line = VirtualLine([virtual_drive("vabus", 1)])
    with open_bus(line.port) as bus:
        assert bus.stop_all() == []


def test_stop_all_accepts_drives_of_a_plant_and_names_them():
    line = VirtualLine([virtual_drive("vabus", 1, model="agile")])
    with open_bus(line.port) as bus:
        pump = DriveConfig(protocol="vabus", address=1, name="pump", line="hall", options={"model": "agile"})
        assert bus.stop_all(drives=[pump]) == [StopResult(line="hall", drive="pump", how=Stop.RAMP)]
