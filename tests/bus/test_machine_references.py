"""A reference in the unit of the machine equals one in hertz, with all the limits of hertz."""

import asyncio
from decimal import Decimal

import pytest

import drivecomm
from drivecomm import MachineUnit
from drivecomm.errors import NotSupported, ReadOnlyError, UsageError, ValueRefusedError
from drivecomm.protocol import DriveConfig, installed
from drivecomm.virtual import VirtualLine, virtual_drive

BELT = MachineUnit(unit="m/min", per_hz="1.25")
SHAFT = MachineUnit(unit="rpm", poles=4, gear="5.2")


class Bench:
    """A drive on a virtual line, and the telegrams sent by its master."""

    def __init__(self, name="vabus", model="agile", machine=BELT, **options):
        self.line = VirtualLine([virtual_drive(name, 1, model=model)])
        self.bus = drivecomm.open_bus(self.line.port)
        self.drive = self.bus.drive(name, 1, model=model, machine=machine, **options)
        self.sent = []
        self.line.monitors.append(lambda sent: self.sent.append(sent.data) if sent.sender is None else None)

    def after(self, **reference):
        """Set a reference and return all telegrams sent so far."""
        self.drive.set_reference(**reference)
        return self.sent


@pytest.mark.parametrize("value", [12.5, "12.5", "12.5 m/min", Decimal("12.50")])
def test_machine_reference_sends_what_its_hertz_would_send(value):
    assert Bench().after(machine=value) == Bench().after(hz=10)


def test_reference_of_a_geared_shaft_is_rounded_to_a_hundredth_of_a_hertz():
    # 100 rpm behind a gear of 5.2 is 520 rpm of a motor with 4 poles: 17.333 Hz.
    assert Bench(machine=SHAFT).after(machine=100) == Bench().after(hz="17.33")


@pytest.mark.parametrize("value", ["62.51", -62.6, 1_000_000, "1e30 m/min"])
def test_machine_reference_above_the_maximum_commands_nothing(value):
    bench = Bench()
    bench.drive.set_reference(hz=10)
    bench.sent.clear()
    with pytest.raises(ValueRefusedError):
        bench.drive.set_reference(machine=value)
    codec = bench.line.drives[0].codec
    requests = [codec.decode(telegram, "request") for telegram in bench.sent]
    assert all(installed["vabus"].intent(each).moves_nothing for each in requests)
    assert bench.drive.read("480").value == 10


@pytest.mark.parametrize("value", ["12.5 m/s", "12.5 Hz", "50%", "fast", float("nan"), True])
def test_machine_reference_in_another_unit_sends_nothing(value):
    bench = Bench()
    with pytest.raises(ValueRefusedError):
        bench.drive.set_reference(machine=value)
    assert bench.sent == []


def test_drive_without_a_machine_unit_refuses_with_a_hint_to_the_plant_file():
    bench = Bench(machine=None)
    with pytest.raises(NotSupported, match=r'write machine = \{ unit = "m/min", .* in its \[\[drive\]\]'):
        bench.drive.set_reference(machine=10)
    assert bench.sent == []
    assert bench.drive.machine is None


def test_machine_and_hz_references_exclude_each_other():
    with pytest.raises(UsageError, match="one of percent, hz, rpm and machine"):
        Bench().drive.set_reference(machine=10, hz=10)


def test_drive_in_percent_converts_machine_references_by_reference_maximum_hz():
    assert Bench("danfoss-fc", "fc300", reference_maximum_hz=50).after(machine=12.5) == Bench(
        "danfoss-fc", "fc300", reference_maximum_hz=50
    ).after(hz=10)
    bench = Bench("danfoss-fc", "fc300")
    with pytest.raises(NotSupported, match="reference_maximum_hz=50"):
        bench.drive.set_reference(machine=12.5)
    assert bench.sent == []


def test_negative_machine_reference_is_treated_as_negative_hertz():
    def refused(**reference):
        with pytest.raises(ValueRefusedError) as caught:
            Bench("fuji", "frenic").drive.set_reference(**reference)
        return str(caught.value)

    assert refused(machine=-12.5) == refused(hz="-10.00")


def test_read_only_drive_takes_no_machine_reference():
    with pytest.raises(ReadOnlyError):
        Bench(read_only=True).drive.set_reference(machine=10)


@pytest.mark.parametrize("machine", ["1.25", {"unit": "m/min", "per_hz": 1}, 1.25])
def test_invalid_machine_unit_is_refused(machine):
    with pytest.raises(UsageError, match=r"invalid machine of vabus:1: .*; give a drivecomm.MachineUnit"):
        Bench(machine=machine)


def test_async_drive_takes_a_machine_reference():
    async def sent(**reference):
        line = VirtualLine([virtual_drive("vabus", 1, model="agile")])
        telegrams = []
        line.monitors.append(lambda sent: telegrams.append(sent.data) if sent.sender is None else None)
        async with drivecomm.open_bus_async(line.port) as bus:
            await bus.drive("vabus", 1, model="agile", machine=BELT).set_reference(**reference)
        return telegrams

    assert asyncio.run(sent(machine=12.5)) == asyncio.run(sent(hz=10))


def test_drive_of_a_plant_has_the_machine_unit_of_its_table():
    line = VirtualLine([virtual_drive("vabus", 1, model="agile")])
    config = DriveConfig(protocol="vabus", address=1, options={"model": "agile"}, machine=BELT)
    with drivecomm.open_bus(line.port) as bus:
        assert config.build(bus.drive).machine == BELT
