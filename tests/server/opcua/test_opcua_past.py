"""Events with their severities, and history read from the journal."""

import asyncio
import time
from datetime import UTC, datetime, timedelta
from types import SimpleNamespace
from typing import get_args

import pytest
from asyncua import ua
from served_opcua import call, node, until

from drivecomm.server import EventKind
from drivecomm.server.history_service import _backwards
from drivecomm.server.opcua import limits
from drivecomm.server.opcua.events import _SEVERITIES

WHERE = "drives/pump/Monitoring/ConverterOutputFrequency"


class Heard:
    def __init__(self):
        self.events = []

    def event_notification(self, event):
        self.events.append(event)


async def listening(client, on, types=ua.ObjectIds.BaseEventType):
    heard = Heard()
    subscription = await client.create_subscription(50, heard)
    await subscription.subscribe_events(on, types)
    return heard


@pytest.mark.soak
def test_trip_event_is_sent_at_server_plant_and_drive(door):
    async def test(one):
        async with one.client("vera") as vera:
            types = node(vera, "types/PlantEventType")
            at = [vera.nodes.server, node(vera, "plant"), node(vera, "drives/fan")]
            all_heard = [await listening(vera, each, types) for each in at]
            other = await listening(vera, node(vera, "drives/pump"), types)
            of_any_kind = await listening(vera, vera.nodes.server)
            one.control.order("trip", drive="fan", code=14)

            def faults(heard):
                return [each for each in heard.events if each.Kind == "fault"]

            await until(lambda: all(map(faults, all_heard)))
            told = faults(all_heard[0])[0]
            assert (told.Severity, told.Drive, told.SourceName) == (900, "fan", "fan")
            assert told.SourceNode == ua.NodeId("drives/fan", 2)
            assert told.EventType == ua.NodeId("types/PlantEventType", 2)
            assert told.Message.Text
            assert abs(told.Time.replace(tzinfo=UTC).timestamp() - time.time()) < 30
            assert told.EventId
            assert not faults(other)
            await until(lambda: of_any_kind.events)
            one.control.order("power", drive="fan", state="factory")

    door.run(test)


@pytest.mark.soak
def test_invalid_event_filter_of_one_client_does_not_affect_others(door):
    async def test(one):
        async with one.client("vera") as vera, one.client("otto") as otto:
            wished = ua.EventFilter()
            for name in ("__class__", "to_event_fields", "types", "Message"):
                wished.SelectClauses.append(ua.SimpleAttributeOperand(
                    TypeDefinitionId=ua.NodeId(ua.ObjectIds.BaseEventType), BrowsePath=[ua.QualifiedName(name, 0)],
                    AttributeId=ua.AttributeIds.Value,
                ))  # fmt: skip
            subscription = await vera.create_subscription(50, Heard())
            await subscription.subscribe_events(vera.nodes.server, evfilter=wished)
            heard = await listening(otto, otto.nodes.server, node(otto, "types/PlantEventType"))
            await call(otto, "Stop")
            await until(lambda: any(each.Kind == "command" and each.Who.startswith("otto") for each in heard.events))

    door.run(test)


def test_circular_event_filter_is_refused(door):
    async def test(one):
        async with one.client("vera") as vera:
            wished = ua.EventFilter(SelectClauses=[])
            wished.WhereClause = ua.ContentFilter(Elements=[
                ua.ContentFilterElement(
                    FilterOperator=ua.FilterOperator.Not, FilterOperands=[ua.ElementOperand(Index=0)]
                )
            ])  # fmt: skip
            subscription = await vera.create_subscription(50, Heard())
            with pytest.raises(ua.uaerrors.BadEventFilterInvalid):
                await subscription.subscribe_events(vera.nodes.server, evfilter=wished)

    door.run(test)


@pytest.mark.soak
def test_event_filter_with_repeated_references_is_evaluated_quickly(door):
    """Evaluating each reference separately would take an exponential number of steps."""
    last = limits.FILTER_ELEMENTS - 1
    elements = [
        ua.ContentFilterElement(
            FilterOperator=ua.FilterOperator.And,
            FilterOperands=[ua.ElementOperand(Index=place + 1), ua.ElementOperand(Index=place + 1)],
        )
        for place in range(last)
    ]
    literal = ua.LiteralOperand(Value=ua.Variant(1))
    elements.append(ua.ContentFilterElement(FilterOperator=ua.FilterOperator.Equals, FilterOperands=[literal] * 2))

    async def test(one):
        async with one.client("vera") as vera, one.client("otto") as otto:
            wished = ua.EventFilter(SelectClauses=[], WhereClause=ua.ContentFilter(Elements=elements))
            for _ in range(10):
                heard = Heard()
                subscription = await vera.create_subscription(50, heard)
                await subscription.subscribe_events(vera.nodes.server, evfilter=wished)
            begun = time.monotonic()
            for _ in range(5):
                await call(otto, "Stop")
            await until(lambda: heard.events)
            assert time.monotonic() - begun < 10

    door.run(test)


@pytest.mark.soak
def test_history_is_read_forwards_backwards_and_in_pages(door):
    async def test(one):
        async with one.client("vera") as vera:
            shown = node(vera, WHERE)
            begin = datetime.now(UTC)
            await asyncio.sleep(1.5)
            end = datetime.now(UTC)

            async def later_ones_are_there():
                return await shown.read_raw_history(end, None, numvalues=1)

            await until(later_ones_are_there)
            found = await shown.read_raw_history(begin, end)
            assert len(found) > 10
            times = [each.SourceTimestamp for each in found]
            assert times == sorted(times)
            # The model marks this parameter as uncertain.
            assert {each.StatusCode.name for each in found} <= {"Good", "UncertainLastUsableValue"}
            assert all(isinstance(each.Value.Value, float) for each in found)
            back = await shown.read_raw_history(end, begin)
            assert [each.SourceTimestamp for each in back] == times[::-1]
            latest = await shown.read_raw_history(None, end, numvalues=3)
            assert [each.SourceTimestamp for each in latest] == times[:-4:-1]
            assert len(await shown.read_raw_history(begin, None, numvalues=2)) == 2

    door.run(test)


def test_history_of_a_node_without_history_is_refused(door):
    async def test(one):
        async with one.client("vera") as vera:
            now = datetime.now(UTC)
            details = ua.ReadRawModifiedDetails(IsReadModified=False, StartTime=now - timedelta(hours=1), EndTime=now)
            nodes = [
                ua.HistoryReadValueId(NodeId=each)
                for each in (ua.NodeId("drives/pump/Status/State", 2), ua.NodeId("nowhere", 2))
            ]
            params = ua.HistoryReadParameters(
                HistoryReadDetails=details, ReleaseContinuationPoints=False, NodesToRead=nodes
            )
            results = await vera.uaclient.history_read(params)
            assert [each.StatusCode.name for each in results] == ["BadHistoryOperationUnsupported", "BadNodeIdUnknown"]
            params.NodesToRead = [ua.HistoryReadValueId(NodeId=ua.NodeId(WHERE, 2), ContinuationPoint=b"\x00")]
            (result,) = await vera.uaclient.history_read(params)
            assert result.StatusCode.name == "BadContinuationPointInvalid"
            params.NodesToRead = nodes * 100
            with pytest.raises(ua.uaerrors.BadTooManyOperations):
                await vera.uaclient.history_read(params)
            params.NodesToRead = [ua.HistoryReadValueId(NodeId=ua.NodeId(WHERE, 2))]
            for unanswered, status in (
                (ua.ReadAtTimeDetails(), "BadHistoryOperationUnsupported"),
                (ua.ReadProcessedDetails(), "BadAggregateListMismatch"),
            ):
                params.HistoryReadDetails = unanswered
                (result,) = await vera.uaclient.history_read(params)
                assert result.StatusCode.name == status

    door.run(test)


@pytest.mark.soak
def test_backward_history_read_searches_near_the_end_first():
    asked = []

    def between(begin, end):
        asked.append((begin, end))
        return [each for each in stored if begin <= each.time_s <= end]

    stored = [SimpleNamespace(time_s=float(each)) for each in range(0, 1_000_000, 10)]
    found = _backwards(between, 1_000_000.0, 0.0, 5)
    assert [each.time_s for each in found] == [999_990.0, 999_980.0, 999_970.0, 999_960.0, 999_950.0]
    assert asked == [(996_400.0, 1_000_000.0)]
    assert len(_backwards(between, 1_000_000.0, 0.0, 10_000)) == 10_000
    assert [each.time_s for each in _backwards(between, 25.0, 0.0, 10)] == [20.0, 10.0, 0.0]
    assert _backwards(between, 5.0, 1.0, 10) == []


@pytest.mark.soak
def test_history_is_read_in_pages(door, monkeypatch):
    monkeypatch.setattr(limits, "PAST_VALUES", 4)

    async def test(one):
        async with one.client("vera") as vera:
            begin = datetime.now(UTC)
            await until(lambda: (datetime.now(UTC) - begin).total_seconds() > 1.5)
            details = ua.ReadRawModifiedDetails(IsReadModified=False, StartTime=begin, EndTime=datetime.now(UTC))
            point, times, pages = None, [], 0
            while point or not pages:
                wanted = ua.HistoryReadValueId(NodeId=ua.NodeId(WHERE, 2), ContinuationPoint=point)
                (result,) = await vera.uaclient.history_read(ua.HistoryReadParameters(
                    HistoryReadDetails=details, ReleaseContinuationPoints=False, NodesToRead=[wanted]
                ))  # fmt: skip
                assert len(result.HistoryData.DataValues) <= 4
                times += [each.SourceTimestamp for each in result.HistoryData.DataValues]
                point, pages = result.ContinuationPoint, pages + 1
            assert pages > 2
            monkeypatch.undo()
            whole = await node(vera, WHERE).read_raw_history(details.StartTime, details.EndTime)
            assert times == [each.SourceTimestamp for each in whole]

    door.run(test)


def test_every_kind_of_event_has_a_severity():
    assert set(_SEVERITIES) == set(get_args(EventKind))
