"""Aggregates over history (OPC UA Part 13), read by two client stacks and compared with a manual calculation."""

import asyncio
import json
import os
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from pathlib import Path

import pytest
from asyncua import ua
from served_opcua import PASSWORDS, until

pytestmark = pytest.mark.soak

PROGRAM = Path(__file__).with_name("node_aggregates.js")
WHERE = "drives/fan/Parameters/480"
NAMES = ["Interpolative", "Average", "TimeAverage", "Minimum", "Maximum", "Count"]
INTERVAL_MS = 700


async def processed(client, begin, end, name, *, interval_ms=INTERVAL_MS, place=WHERE, configuration=None, point=None):
    """Read an aggregate, and return the result."""
    details = ua.ReadProcessedDetails(
        StartTime=begin, EndTime=end, ProcessingInterval=float(interval_ms),
        AggregateType=[ua.NodeId(getattr(ua.ObjectIds, f"AggregateFunction_{name}"))],
        AggregateConfiguration=configuration or ua.AggregateConfiguration(UseServerCapabilitiesDefaults=True),
    )  # fmt: skip
    wanted = ua.HistoryReadValueId(NodeId=ua.NodeId(place, 2), ContinuationPoint=point)
    (result,) = await client.uaclient.history_read(
        ua.HistoryReadParameters(HistoryReadDetails=details, NodesToRead=[wanted], ReleaseContinuationPoints=False)
    )
    return result


def values_of(result):
    return [None if each.Value is None else each.Value.Value for each in result.HistoryData.DataValues]


def by_hand(raw, begin, end, name):
    """Calculate an aggregate of one interval from all raw values, without the code under test."""
    points = [(each.SourceTimestamp.replace(tzinfo=UTC).timestamp(), each.Value.Value) for each in raw]
    inside = [value for at, value in points if begin <= at < end]

    def at(moment):
        before = max(point for point in points if point[0] <= moment)
        after = min(point for point in points if point[0] > moment)
        return before[1] + (after[1] - before[1]) * (moment - before[0]) / (after[0] - before[0])

    if name == "Interpolative":
        return at(begin)
    if name == "TimeAverage":
        times = [begin, *(when for when, _ in points if begin < when < end), end]
        return sum((at(one) + at(other - 1e-7)) / 2 * (other - one) for one, other in pairwise(times)) / (end - begin)
    if name == "Average":
        return sum(inside) / len(inside)
    return {"Minimum": min, "Maximum": max, "Count": len}[name](inside)


async def played(one, client):
    """Change a value of a drive for some seconds; return begin and end, and the raw history around them."""
    shown = client.get_node(ua.NodeId(WHERE, 2))
    from_the_first = datetime.now(UTC)
    await asyncio.sleep(0.5)
    begin = datetime.now(UTC)
    for value in (10, 30, 20, 50, 40, 45):
        one.control.order("set", drive="fan", parameter="480", value=value * 100)
        await asyncio.sleep(0.35)
    end = begin + timedelta(milliseconds=3 * INTERVAL_MS)

    async def is_over():
        return bool(await shown.read_raw_history(end + timedelta(seconds=0.3), None, numvalues=1))

    await until(is_over)
    raw = await shown.read_raw_history(from_the_first - timedelta(seconds=5), end + timedelta(seconds=5))
    return begin, end, [each for each in raw if each.StatusCode.is_good()]


def test_aggregates_match_values_calculated_by_hand(hall):
    async def test(one):
        async with one.client("vera") as vera:
            begin, end, raw = await played(one, vera)
            for name in NAMES:
                result = await processed(vera, begin, end, name)
                expected = [
                    by_hand(raw, begin.timestamp() + at * 0.7, begin.timestamp() + (at + 1) * 0.7, name)
                    for at in range(3)
                ]
                assert values_of(result) == pytest.approx(expected, abs=1e-3), name
                starts = [each.SourceTimestamp.replace(tzinfo=UTC) for each in result.HistoryData.DataValues]
                assert [round((each - begin).total_seconds(), 3) for each in starts] == [0, 0.7, 1.4]
                bits = 0x402 if name == "Interpolative" else 0x401
                assert {each.StatusCode.value & 0x1F | 0x400 for each in result.HistoryData.DataValues} == {bits}

    hall(test)


def test_node_opcua_reads_the_same_aggregates(hall, node_opcua):
    async def test(one):
        async with one.client("vera") as vera:
            begin, end, _ = await played(one, vera)
            # Times of node-opcua have a resolution of milliseconds.
            begin, end = (each.replace(microsecond=each.microsecond // 1000 * 1000) for each in (begin, end))
            process = await asyncio.create_subprocess_exec(
                "node", str(PROGRAM), one.url, "vera", PASSWORDS["vera"], f"ns=2;s={WHERE}", begin.isoformat(),
                end.isoformat(), str(INTERVAL_MS), *NAMES,
                stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE,
                env={**os.environ, "NODE_PATH": node_opcua},
            )  # fmt: skip
            out, errors = await asyncio.wait_for(process.communicate(), 60)
            assert process.returncode == 0, errors.decode()[-2000:]
            told = json.loads(out.decode().strip().splitlines()[-1])
            assert set(NAMES) <= set(told.pop("offered"))
            for name in NAMES:
                assert told[name] == pytest.approx(values_of(await processed(vera, begin, end, name))), name

    hall(test)


def test_aggregate_intervals_may_run_backwards_and_end_partially(hall):
    async def test(one):
        async with one.client("vera") as vera:
            begin, end, _ = await played(one, vera)
            forwards = await processed(vera, begin, end, "Count")
            backwards = await processed(vera, end, begin, "Count")
            assert sum(values_of(backwards)) == sum(values_of(forwards))
            whole = await processed(vera, begin, end, "Maximum", interval_ms=0)
            assert values_of(whole) == [max(values_of(await processed(vera, begin, end, "Maximum")))]
            partial = await processed(vera, begin, end, "Average", interval_ms=2 * INTERVAL_MS)
            assert [bool(each.StatusCode.value & 4) for each in partial.HistoryData.DataValues] == [False, True]

    hall(test)


def test_aggregate_without_values_is_bad_no_data(hall):
    async def test(one):
        async with one.client("vera") as vera:
            later = datetime.now(UTC) + timedelta(days=1)
            for name in NAMES:
                result = await processed(vera, later, later + timedelta(seconds=1), name)
                assert [each.StatusCode.name for each in result.HistoryData.DataValues] == ["BadNoData", "BadNoData"]

    hall(test)


def test_many_aggregates_are_read_with_continuation_points(hall):
    async def test(one):
        async with one.client("vera") as vera:
            end = datetime.now(UTC)
            begin = end - timedelta(seconds=1500)
            first = await processed(vera, begin, end, "Count", interval_ms=1000)
            rest = await processed(vera, begin, end, "Count", interval_ms=1000, point=first.ContinuationPoint)
            assert (len(first.HistoryData.DataValues), len(rest.HistoryData.DataValues)) == (1000, 500)
            assert rest.ContinuationPoint is None

    hall(test)


@pytest.mark.parametrize(
    ("asked", "status"),
    [
        ({"name": "StandardDeviationSample"}, "BadAggregateNotSupported"),
        ({"name": "Average", "interval_ms": -1}, "BadAggregateInvalidInputs"),
        ({"name": "Average", "interval_ms": float("nan")}, "BadAggregateInvalidInputs"),
        ({"name": "Average", "place": "drives/fan/Status/Running"}, "BadHistoryOperationUnsupported"),
        ({"name": "Average", "point": b"what"}, "BadContinuationPointInvalid"),
        (
            {"name": "Average", "configuration": ua.AggregateConfiguration(
                UseServerCapabilitiesDefaults=False, UseSlopedExtrapolation=True
            )}, "BadAggregateConfigurationRejected",
        ),
    ],
)  # fmt: skip
def test_unsupported_aggregate_request_is_refused(hall, asked, status):
    async def test(one):
        async with one.client("vera") as vera:
            end = datetime.now(UTC)
            result = await processed(vera, end - timedelta(seconds=5), end, **asked)
            assert result.StatusCode.name == status

    hall(test)
