"""Nodes of the address space: names, units, limits, status, times, and changes of the plant."""

import asyncio
import threading
import time
from decimal import Decimal

import pytest
from asyncua import ua
from served_core import OPERATOR
from served_opcua import PLANT, call, data, lock, node, opened, until

from drivecomm.models import quantities
from drivecomm.plant import read_plant
from drivecomm.protocol import Reading
from drivecomm.server import CurrentValue, DriveDrift, LineSnapshot
from drivecomm.server.opcua.naming import engineering_unit, part, place_of, places
from drivecomm.server.opcua.states import REACHABILITIES, STATES
from drivecomm.server.opcua.values import data_value, past_value


def reading(value, *, time_s=1_700_000_000.25, **more):
    return Reading(parameter="481", value=value, raw=1, time_s=time_s, **more)


def current(quality, value=None, **more):
    return CurrentValue(drive="pump", name="x", reading=value, quality=quality, time_s=1_700_000_001.0, **more)


@pytest.mark.parametrize(
    ("value", "kind", "told", "status"),
    [
        (current("good", reading(Decimal("12.5"))), ua.VariantType.Double, 12.5, "Good"),
        (current("uncertain", reading(Decimal("12.5"), doubt="two replies")), None, 12.5, "Uncertain"),
        (current("good", reading(Decimal("12.5"), note="derived")), None, 12.5, "Good"),
        (current("stale", reading(3)), ua.VariantType.Double, 3.0, "UncertainLastUsableValue"),
        (current("bad"), ua.VariantType.Double, None, "BadNoCommunication"),
        (current("stale"), ua.VariantType.Double, None, "BadNoCommunication"),
        (current("bad", unreadable=True), ua.VariantType.Double, None, "BadConfigurationError"),
        (current("good", reading("3.71")), ua.VariantType.String, "3.71", "Good"),
        (current("good", reading(Decimal("3.71"))), ua.VariantType.String, "3.71", "Good"),
        (current("good", reading("text")), None, "text", "Good"),
        (current("good", reading("text")), ua.VariantType.Double, None, "BadTypeMismatch"),
    ],
)  # fmt: skip
def test_quality_of_a_value_becomes_its_status(value, kind, told, status):
    found = data_value(value, kind, 1_700_000_002.0)
    assert (found.Value.Value, found.StatusCode.name) == (told, status)
    expected = 1_700_000_001.0 if value.reading is None else 1_700_000_000.25
    assert found.SourceTimestamp.timestamp() == expected
    assert found.ServerTimestamp.timestamp() == 1_700_000_002.0


@pytest.mark.parametrize(
    ("value", "quality", "status"),
    [(Decimal(1), "good", "Good"), (None, "bad", "BadNoCommunication"), (2, "stale", "UncertainLastUsableValue")],
)
def test_quality_of_a_history_value_becomes_its_status(value, quality, status):
    assert past_value(value, quality, 5.0).StatusCode.name == status


def test_every_common_name_has_a_node_path():
    assert set(places()) == set(quantities()) - {"link_timeout"}
    assert (place_of("reference_frequency").folder, place_of("reference_frequency").name) == (
        "Monitoring", "FrequencyCommandValue",
    )  # fmt: skip
    assert (place_of("16-13").folder, place_of("16-13").name) == ("Parameters", "16-13")
    shown = [(each.folder, each.name) for each in places().values()]
    assert len(set(shown)) == len(shown)


@pytest.mark.parametrize(
    ("unit", "number"),
    # Numbers from the table of the OPC Foundation.
    [("Hz", 4740186), ("A", 4279632), ("V", 5655636), ("kW", 4937556), ("Nm", 20053), ("%", 20529), ("rpm", 5394509),
     ("degC", 4408652), ("h", 4740434), ("kWh", 4937544), ("s", 5457219), ("kHz", 4933722), ("Hz/s", -1)],
)  # fmt: skip
def test_units_have_unece_codes(unit, number):
    found = engineering_unit(unit)
    assert (found.UnitId, found.DisplayName.Text) == (number, unit)
    assert bool(found.NamespaceUri) == (number != -1)


def test_every_unit_of_a_common_name_has_a_code():
    for quantity in quantities().values():
        assert engineering_unit(quantity.unit).UnitId != -1 or quantity.unit in ("", "Hz/s")


def test_name_is_escaped_as_one_part_of_a_node_id():
    assert part("a/b%") == "a%2Fb%25"


@pytest.mark.soak
def test_value_node_has_unit_limits_status_and_time(door):
    async def test(one):
        async with one.client("vera") as vera:
            where = "drives/pump/Monitoring/ConverterOutputFrequency"

            async def as_it_is():
                return (await data(vera, where)).StatusCode.name == "Good"

            await until(as_it_is)
            found = await data(vera, where)
            assert found.Value.VariantType == ua.VariantType.Double
            (value,) = [each for each in one.plant.values() if (each.drive, each.name) == ("pump", "output_frequency")]
            assert abs(found.SourceTimestamp.timestamp() - value.source_s) < 30
            shown = node(vera, "drives/pump/Monitoring/ConverterOutputFrequency")
            assert (await shown.read_type_definition()).Identifier == ua.ObjectIds.AnalogUnitType
            # The certainty of the model is in the note, not in the status.
            assert (await (await shown.get_child("2:Note")).read_value()).startswith("type and unit are ")
            unit = await (await shown.get_child("0:EngineeringUnits")).read_value()
            assert (unit.UnitId, unit.DisplayName.Text) == (4740186, "Hz")
            limits = await (
                await node(vera, "drives/fan/VelocityProfile/MaximumFrequency").get_child("0:EURange")
            ).read_value()
            assert (limits.Low, limits.High) == (0.0, 999.99)
            assert (await data(vera, "drives/pump/Status/State")).StatusCode.name in (
                "Good",
                "UncertainLastUsableValue",
            )
            assert (await data(vera, "drives/pump/Status/StatusWord")).Value.VariantType == ua.VariantType.UInt32
            assert (await data(vera, "drives/pump/Identification/Model")).Value.Value == "fc302"

            async def line_is_up():
                return (await data(vera, "lines/yard/Up")).Value.Value is True

            # The states of lines are updated at intervals.
            await until(line_is_up)
            path = ["2:Plant", "2:Drives", "2:pump", "2:Status", "2:Running"]
            running = await vera.nodes.objects.get_child(path)
            assert (await running.read_data_value(raise_on_bad_status=False)).Value.Value is False

    door.run(test)


@pytest.mark.soak
def test_value_not_read_yet_is_waiting_or_without_communication(tmp_path):
    async def test():
        async with opened(tmp_path, reached=False) as one, one.client("vera") as vera:
            for what in ("Monitoring/ConverterOutputFrequency", "Status/Running"):
                found = await data(vera, f"drives/fan/{what}")
                # The status depends on whether the line was already tried.
                assert found.StatusCode.name in ("BadWaitingForInitialData", "BadNoCommunication")
                assert found.Value.Value is None

    asyncio.run(test())


def test_drift_node_shows_the_drift_of_a_drive(door):
    async def test(one):
        async with one.client("vera") as vera:

            async def shows(text):
                return (await data(vera, "drives/fan/Status/Drift")).Value.Value == text

            await until(lambda: shows("not compared with the baseline: the server has not compared it yet"))
            one.core.drift["fan"] = DriveDrift(state="as approved")
            await until(lambda: shows("set as approved"))

    door.run(test)


def test_standing_stop_node_shows_the_stop(door):
    async def test(one):
        async with one.client("vera") as vera:

            async def shows(text):
                return (await data(vera, "drives/fan/Status/StandingStop")).Value.Value == text

            await until(lambda: shows(""))
            release = one.plant.hold_stop(OPERATOR, "fan", "ramp")
            await until(lambda: shows("stop (ramp) demanded by otto (http 127.0.0.1:1)"))
            release()
            await until(lambda: shows(""))

    door.run(test)


@pytest.mark.soak
def test_status_on_a_late_line_is_last_usable_value(door):
    async def test(one):
        done = threading.Event()
        lent = asyncio.create_task(one.core.lines["hall"].bus.lend(lambda *_: done.wait(20)))
        try:
            one.core.lines["hall"].status_is_late("fan", "was not asked", time.monotonic())
            async with one.client("vera") as vera:

                async def is_late():
                    state = await data(vera, "drives/fan/Status/State")
                    late = await data(vera, "lines/hall/LateStatuses")
                    return state.StatusCode.name == "UncertainLastUsableValue" and late.Value.Value

                await until(is_late)
                assert (await data(vera, "drives/fan/Status/State")).Value.Value in range(len(STATES))
                reachability = (await data(vera, "drives/fan/Status/Reachability")).Value.Value
                assert reachability == REACHABILITIES.index("answers")
        finally:
            done.set()
            await lent

    door.run(test)


@pytest.mark.soak
def test_silent_drive_has_no_values(door):
    async def test(one):
        async with one.client("vera") as vera:
            one.control.order("power", drive="fan", state="off")

            async def gone():
                found = await data(vera, "drives/fan/Monitoring/ConverterOutputFrequency")
                return (found.StatusCode.name, found.Value.Value) == ("BadNoCommunication", None)

            try:
                await until(gone, 15)

                async def all_gone():
                    return (await data(vera, "drives/fan/Status/Running")).StatusCode.name == "BadNoCommunication"

                # The status is polled at its own interval.
                await until(all_gone, 15)
                assert (await data(vera, "drives/fan/Status/Reachability")).Value.Value == REACHABILITIES.index(
                    "silent"
                )
            finally:
                one.control.order("power", drive="fan", state="on")

    door.run(test)


@pytest.mark.soak
def test_value_without_updates_becomes_last_usable_value(door):
    async def test(one):
        async with one.client("vera") as vera:
            where = "drives/pump/Monitoring/ConverterOutputFrequency"
            before = await data(vera, where)
            # Simulates polling that has stopped without a report.
            await one.core.lines["yard"].pause()
            try:

                async def aged():
                    return (await data(vera, where)).StatusCode.name == "UncertainLastUsableValue"

                await until(aged)
                found = await data(vera, where)
                assert found.Value.Value is not None
                assert found.SourceTimestamp >= before.SourceTimestamp

                async def status_aged():
                    running = await data(vera, "drives/pump/Status/Running")
                    return running.StatusCode.name == "UncertainLastUsableValue"

                await until(status_aged)
            finally:
                one.core.lines["yard"].start()

            async def current_again():
                return (await data(vera, where)).StatusCode.name == before.StatusCode.name

            await until(current_again)

    door.run(test)


class Notes:
    def __init__(self):
        self.values = []

    def datachange_notification(self, node, val, data):
        self.values.append((str(node.nodeid.Identifier), val, data.monitored_item.Value.StatusCode.name))


@pytest.mark.soak
def test_subscription_receives_changes(door):
    async def test(one):
        async with one.client("otto") as otto:
            notes = Notes()
            subscription = await otto.create_subscription(50, notes)
            await subscription.subscribe_data_change(
                [
                    node(otto, "drives/pump/Status/Running"),
                    node(otto, "drives/pump/Monitoring/ConverterOutputFrequency"),
                ]
            )
            await until(lambda: ("drives/pump/Status/Running", False, "Good") in notes.values)
            await lock(otto)
            await call(otto, "SetReference", 50.0, "%")
            await call(otto, "Start")
            await until(lambda: ("drives/pump/Status/Running", True, "Good") in notes.values)
            await until(lambda: any(value and value > 0 for name, value, _ in notes.values if "Frequency" in name))

    door.run(test)


@pytest.mark.soak
def test_line_that_is_being_closed_is_ignored(door, monkeypatch):
    async def test(one):
        lines = one.plant.lines()
        # The plant no longer has this line, but the core has not closed it yet.
        monkeypatch.setattr(one.plant, "lines", lambda: [LineSnapshot(name="gone", port=""), *lines])
        async with one.client("vera") as vera:

            async def polls():
                return (await data(vera, "lines/yard/Polls")).Value.Value

            before = await polls()
            monkeypatch.undo()

            async def goes_on():
                return await polls() > before

            await until(goes_on)

    door.run(test)


@pytest.mark.soak
def test_reload_updates_nodes_and_keeps_subscriptions_and_locks(tmp_path):
    async def test():
        async with opened(tmp_path) as one, one.client("otto") as otto:
            notes = Notes()
            subscription = await otto.create_subscription(50, notes)
            kept = "drives/pump/Monitoring/ConverterOutputFrequency"
            gone = "drives/fan/Monitoring/ConverterOutputFrequency"
            await subscription.subscribe_data_change([node(otto, kept), node(otto, gone)])
            await until(lambda: len(notes.values) >= 2)
            await lock(otto)
            text = PLANT.replace('["output_frequency", "3-41"]', '["output_frequency", "output_current"]')
            text = text[: text.index('[[drive]]\nname = "fan"')] + text[
                text.index('[[drive]]\nname = "fan"') :
            ].replace('"fan"', '"blower"')
            file = tmp_path / "plant.toml"
            file.write_text(text)
            await one.core.changed(await asyncio.to_thread(read_plant, file))

            async def shown():
                return (await data(otto, "drives/blower/Monitoring/ConverterOutputFrequency")).Value.Value is not None

            await until(shown)
            assert (await data(otto, "drives/fan")).StatusCode.name == "BadNodeIdUnknown"
            assert (await data(otto, "drives/pump/Parameters/3-41")).StatusCode.name == "BadNodeIdUnknown"
            await until(lambda: (gone, None, "BadNodeIdUnknown") in notes.values)
            # Subscriptions to remaining nodes continue, and the holder of the lock can still send commands.
            assert (await call(otto, "SetReference", 50.0, "%"))[0] == "Good"
            await call(otto, "Start")
            await until(lambda: any(value and value > 0 for name, value, _ in notes.values if name == kept))
            children = await node(otto, "drives").get_children()
            assert {str(each.nodeid.Identifier) for each in children} == {"drives/pump", "drives/blower"}

    asyncio.run(test())
