"""Subscription filters of OPC UA (Part 4, 7.17.2; Part 8, 6.2), used by two client stacks over TCP."""

import json
import math
from contextlib import asynccontextmanager
from functools import partial

import pytest
from asyncua import ua
from node_programs import node_program
from served_opcua import ReceivedValues, node, until

from drivecomm.server.opcua.filters import ChangeFilter

pytestmark = pytest.mark.soak

# The model gives a range of 0.00 to 300.00 %, so 1 % of the range is 3.00 %.
CURRENT_LIMIT = "drives/fan/Parameters/518"
WITHOUT_RANGE = "drives/fan/Monitoring/ConverterOutputFrequency"


class Heard:
    """Notifications of one value, without and with a filter. refused: status of a refused item, "" if accepted."""

    def __init__(self):
        self.all, self.filtered, self.refused = [], [], ""

    def values(self):
        """Return the values that came with the filter, without changes of status only.

        On a busy machine a value may go stale, which sends it once more with another status.
        """
        told, before = [], None
        for value, status in self.filtered:
            if before is None or before[0] != value or before[1] == status:
                told.append(value)
            before = value, status
        return told


@asynccontextmanager
async def heard_by_asyncua(one, place, trigger, deadband, size):
    heard = Heard()

    class Handler:
        def __init__(self, told):
            self.told = told

        def datachange_notification(self, _node, value, data):
            self.told.append((value, data.monitored_item.Value.StatusCode.name))

    async with one.client("vera") as vera:
        plain = await vera.create_subscription(50, Handler(heard.all))
        await plain.subscribe_data_change(node(vera, place))
        listening = await vera.create_subscription(50, Handler(heard.filtered))
        wished = ua.MonitoredItemCreateRequest(
            ItemToMonitor=ua.ReadValueId(NodeId=ua.NodeId(place, 2), AttributeId=ua.AttributeIds.Value),
            MonitoringMode=ua.MonitoringMode.Reporting,
            RequestedParameters=ua.MonitoringParameters(
                ClientHandle=1, QueueSize=100, Filter=ua.DataChangeFilter(
                    Trigger=ua.DataChangeTrigger[trigger], DeadbandType=ua.DeadbandType[deadband].value,
                    DeadbandValue=size,
                ),
            ),
        )  # fmt: skip
        (result,) = await listening.create_monitored_items([wished])
        if isinstance(result, ua.StatusCode):
            heard.refused = result.name
        yield heard


@asynccontextmanager
async def heard_by_node(folder, one, place, *filter_):
    heard = Heard()

    def told(said):
        if "refused" in said:
            heard.refused = said["refused"]
        else:
            getattr(heard, said["item"]).append((said["value"], said["status"]))

    wished = dict(zip(("trigger", "deadband", "size"), filter_, strict=True))
    words = (f"ns=2;s={place}", json.dumps(wished))
    async with node_program(folder, "node_filters.js", one.url, "vera", *words, told=told):
        yield heard


@pytest.fixture(params=["asyncua", "node-opcua"])
def listener(request):
    """Return a function of one client stack that subscribes to a value with a filter."""
    if request.param == "asyncua":
        return heard_by_asyncua
    folder = request.getfixturevalue("node_opcua")
    return partial(heard_by_node, folder)


async def begin_with(one, value):
    """Set a value of the drive, and wait until the server has read it."""
    one.control.order("set", drive="fan", parameter="518", value=round(value * 100))

    def is_known():
        known = {(each.drive, each.name): each.reading for each in one.plant.values()}
        reading = known["fan", "518"]
        return reading is not None and reading.value == value

    await until(is_known)


async def play(one, heard, course):
    """Set one value of the drive after another, each until the client without a filter has received it."""
    await until(lambda: heard.all)
    for value in course:
        one.control.order("set", drive="fan", parameter="518", value=round(value * 100))
        await until(lambda value=value: heard.all[-1][0] == pytest.approx(value))


def assert_told(hall, listener, filter_, course, expected):
    """Check that a client with this filter receives the expected values while the drive's value changes."""

    async def test(one):
        await begin_with(one, course[0])
        async with listener(one, CURRENT_LIMIT, *filter_) as heard:
            await until(lambda: heard.filtered)
            await play(one, heard, course)
            # The notification with the filter may arrive after the one without.
            await until(lambda: len(heard.filtered) >= len(expected))
            assert heard.values() == pytest.approx(expected)

    hall(test)


def test_filter_without_deadband_sends_every_change(hall, listener):
    assert_told(hall, listener, ("StatusValue", "None_", 0.0), [10, 10.5, 11], [10, 10.5, 11])


def test_deadband_counts_from_the_last_notified_value(hall, listener):
    assert_told(hall, listener, ("StatusValue", "Absolute", 1.0), [10, 10.6, 11.2, 11.8, 12.2, 12.3], [10, 11.2, 12.3])


def test_percent_deadband_is_relative_to_the_range(hall, listener):
    assert_told(hall, listener, ("StatusValue", "Percent", 1.0), [10, 12.5, 13.5, 16, 17], [10, 13.5, 17])


def test_timestamp_trigger_sends_unchanged_values(hall, listener):
    async def test(one):
        async with listener(one, CURRENT_LIMIT, "StatusValueTimestamp", "None_", 0.0) as heard:
            await until(lambda: len(heard.filtered) > 5)
            assert len(heard.all) == 1

    hall(test)


def test_deadband_suppresses_changes_of_the_timestamp(hall, listener):
    assert_told(hall, listener, ("StatusValueTimestamp", "Absolute", 1.0), [10, 10.5, 11.5, 12], [10, 11.5])


@pytest.mark.parametrize("filter_", [("StatusValue", "Absolute", 1000.0), ("Status", "None_", 0.0)])
def test_change_of_status_is_sent_with_any_filter(hall, listener, filter_):
    async def test(one):
        async with listener(one, CURRENT_LIMIT, *filter_) as heard:
            await until(lambda: heard.filtered)
            await play(one, heard, [20, 30])
            one.control.order("power", drive="fan", state="off")
            try:
                await until(lambda: heard.filtered[-1][1] == "BadNoCommunication", 30)
            finally:
                one.control.order("power", drive="fan", state="on")
            await until(lambda: heard.filtered[-1][1] == "Good", 30)
            assert 20 not in heard.values()

    hall(test)


@pytest.mark.parametrize(
    ("place", "filter_", "status"),
    [
        (CURRENT_LIMIT, ("StatusValue", "Percent", 101.0), "BadDeadbandFilterInvalid"),
        (CURRENT_LIMIT, ("StatusValue", "Absolute", -1.0), "BadDeadbandFilterInvalid"),
        (WITHOUT_RANGE, ("StatusValue", "Percent", 1.0), "BadDeadbandFilterInvalid"),
        ("drives/fan/Status/Error", ("StatusValue", "Absolute", 1.0), "BadFilterNotAllowed"),
    ],
)
def test_invalid_filter_refuses_only_its_item(hall, listener, place, filter_, status):
    async def test(one):
        async with listener(one, place, *filter_) as heard:
            await until(lambda: heard.refused and heard.all)
            assert heard.refused == status

    hall(test)


def test_deadband_set_by_asyncua_is_accepted_and_can_be_changed(hall):
    async def test(one):
        told = ReceivedValues()

        async def course(*values):
            for value in values:
                one.control.order("set", drive="fan", parameter="518", value=round(value * 100))
                await until(lambda value=value: shown[-1] == pytest.approx(value))

        class All:
            def datachange_notification(self, _node, value, _data):
                shown.append(value)

        shown = []
        await begin_with(one, 10)
        async with one.client("vera") as vera:
            plain = await vera.create_subscription(50, All())
            await plain.subscribe_data_change(node(vera, CURRENT_LIMIT))
            subscription = await vera.create_subscription(50, told)
            item = await subscription.deadband_monitor(node(vera, CURRENT_LIMIT), 1.0)
            await until(lambda: shown and told)
            await course(10.5, 11.5)
            await subscription.modify_monitored_item(item, 50, mod_filter_val=5)
            await course(13, 17)
            await until(lambda: len(told) >= 3)
            assert told == pytest.approx([10, 11.5, 17])

    hall(test)


def value(number, status=ua.StatusCodes.Good):
    return ua.DataValue(ua.Variant(number), ua.StatusCode(status))


@pytest.mark.parametrize("deadband", [None, 1.0])
def test_change_filter_sends_nan_once(deadband):
    wished = ChangeFilter(deadband=deadband)
    assert wished.passes(value(1.0), value(math.nan))
    assert not wished.passes(value(math.nan), value(math.nan))
    assert wished.passes(value(math.nan), value(1.0))


def test_change_filter_passes_an_array_if_one_element_changed():
    wished = ChangeFilter(deadband=1.0)
    assert wished.passes(value([1.0, 5.0]), value([1.0, 6.5]))
    assert not wished.passes(value([1.0, 5.0]), value([1.5, 5.5]))
    assert wished.passes(value([1.0]), value([1.0, 5.0]))
