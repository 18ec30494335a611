"""Values that a bus commanded or wrote to RAM are not settings: no backup holds them, and no restore stores them."""

from contextlib import suppress
from dataclasses import replace

import pytest
from addresses import address_of

import drivecomm
from drivecomm.commissioning.parameter_sets import RestoreOptions, back_up, carry_out_plan, plan_restore
from drivecomm.errors import DriveCommError
from drivecomm.models import load_model, model_names
from drivecomm.protocol import installed
from drivecomm.virtual import VirtualLine, virtual_drive

ALL = [
    (protocol, model) for protocol in sorted(installed) for model in model_names(installed[protocol].package, protocol)
]


@pytest.mark.parametrize(("protocol", "model"), ALL)
def test_backup_is_the_same_before_and_after_the_motor_was_commanded(protocol, model):
    known = load_model(installed[protocol].package, protocol, model)
    line = VirtualLine([virtual_drive(protocol, address_of(protocol), model=known)])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive(protocol, address_of(protocol), model=model)
        before = back_up(drive).entries
        for command in (
            lambda: drive.set_reference(hz=12),
            lambda: drive.set_reference(percent=33),
            drive.start,
            lambda: line.advance(5),
            lambda: drive.set_reference(hz=13),
            drive.stop,
            lambda: line.advance(30),
        ):
            with suppress(DriveCommError):
                command()
        after = back_up(bus.drive(protocol, address_of(protocol), model=model)).entries
    assert {address: str(each) for address, each in after.items()} == {
        address: str(before[address]) for address in after
    }


def pump(bus, address=1):
    return bus.drive("vabus", address, model="agile")


def test_reference_of_the_bus_is_not_in_a_vabus_backup():
    line = VirtualLine([virtual_drive("vabus", 1)])
    with drivecomm.open_bus(line.port) as bus:
        pump(bus).set_reference(hz=12)
        saved = back_up(pump(bus))
        assert not [each for each in saved.entries if each.startswith(("480", "520"))]
        assert "480[1]" in back_up(pump(bus), ["measured"]).entries, "it is among what is shown, with --all"


def test_restore_does_not_store_a_reference_from_an_older_backup():
    line = VirtualLine([virtual_drive("vabus", 1)])
    with drivecomm.open_bus(line.port) as bus:
        drive = pump(bus)
        saved = back_up(drive)
        old = back_up(drive, ["measured"]).entries["480[1]"]
        entries = {**saved.entries, "480[1]": replace(old, value=12, raw=None, part="settings")}
        for options in (RestoreOptions(), RestoreOptions(only=frozenset({"480[1]"}))):
            plan = plan_restore(drive, replace(saved, entries=entries), options)
            assert [(each.address, each.reason) for each in plan.to("skip") if each.address == "480[1]"] == [
                ("480[1]", "a bus commands the motor's speed with it")
            ]
            carry_out_plan(drive, plan)
    assert line.drives[0].peek("480[1]", 0.0) == "00000BB8"


def test_value_written_to_ram_is_left_out_with_the_reason_until_it_is_stored():
    line = VirtualLine([virtual_drive("vabus", 1)])
    with drivecomm.open_bus(line.port) as bus:
        drive = pump(bus)
        drive.write("481", 7)
        assert drive.in_ram_only == {"481"}
        saved = back_up(pump(bus))
        assert not [each for each in saved.entries if each.startswith("481")]
        assert saved.not_read["481[1]"] == "it was written to RAM, so what the drive stores is not known"
        drive.write("481", 7, store=True)
        assert str(back_up(drive).entries["481[1]"]) == "7.00 Hz"


def test_watchdog_that_a_bus_switched_on_is_restored_only_if_named():
    line = VirtualLine([virtual_drive("vabus", 1), virtual_drive("vabus", 2)])
    with drivecomm.open_bus(line.port) as bus:
        pump(bus).write("413", 5)
        assert "413" in back_up(pump(bus)).not_read
        # The state after a bus was killed: the next program does not know of its write.
        line.drives[0].poke("413", "0005")
        with drivecomm.open_bus(line.port) as later:
            saved = back_up(pump(later))
            other = pump(later, 2)
            plan = plan_restore(other, saved, RestoreOptions(another_drive=True))
            assert "413" in [each.address for each in plan.to("skip")]
            assert plan.missed == []
            named = plan_restore(other, saved, RestoreOptions(another_drive=True, only=frozenset({"413"})))
            assert [each.address for each in named.to("write")] == ["413"]
