"""History reads by clients, answered from the journal."""

from __future__ import annotations

import asyncio
import time
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from asyncua import ua
from asyncua.common.utils import Buffer
from asyncua.ua.ua_binary import Primitives

from drivecomm.errors import DriveCommError
from drivecomm.server.opcua import aggregates, limits
from drivecomm.server.opcua.refusals import RefusedPartError
from drivecomm.server.opcua.values import past_value, status

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.server import PlantHistory

_FIRST_YEAR = 1970
_EVER_S = 4e9


class PastReader:
    """Reader of the history.

    value_at: returns drive and name of the value of a node, None for another node. is_there: whether a node exists.
    """

    def __init__(
        self,
        history: PlantHistory | None,
        value_at: Callable[[ua.NodeId], tuple[str, str] | None],
        is_there: Callable[[ua.NodeId], bool],
    ) -> None:
        self._history, self._value_at, self._is_there = history, value_at, is_there
        # Serve history reads one at a time, so large requests delay only each other.
        self._turn = asyncio.Lock()

    async def read(self, params: ua.HistoryReadParameters) -> list[ua.HistoryReadResult]:
        """Return past values or aggregates of nodes."""
        details, wanted = params.HistoryReadDetails, params.NodesToRead
        if params.ReleaseContinuationPoints:
            # Continuation points hold no resources.
            return [ua.HistoryReadResult() for _ in wanted]
        if isinstance(details, ua.ReadProcessedDetails):
            kinds = details.AggregateType or []
            if len(kinds) != len(wanted):
                return [_failed(ua.StatusCodes.BadAggregateListMismatch) for _ in wanted]
            return [await self._aggregate(each, kind, details) for each, kind in zip(wanted, kinds, strict=True)]
        if isinstance(details, ua.ReadRawModifiedDetails) and not details.IsReadModified:
            return [await self._values(each, details) for each in wanted]
        return [_failed(ua.StatusCodes.BadHistoryOperationUnsupported) for _ in wanted]

    async def _aggregate(
        self, wanted: ua.HistoryReadValueId, kind: ua.NodeId, details: ua.ReadProcessedDetails
    ) -> ua.HistoryReadResult:
        found = self._value_at(wanted.NodeId)
        begin, end = _seconds(details.StartTime), _seconds(details.EndTime)
        if self._history is None or found is None:
            return self._without_history(wanted.NodeId)
        if begin is None or end is None:
            return _failed(ua.StatusCodes.BadHistoryOperationInvalid)
        first, most, every = begin, limits.PAST_VALUES, details.ProcessingInterval / 1000
        try:
            if wanted.ContinuationPoint:
                first = _continued(wanted.ContinuationPoint)
            aggregates.check(kind, details.AggregateConfiguration)
            asked = aggregates.processing_intervals(first, end, every, most)
        except RefusedPartError as error:
            return _failed(error.code)
        now = time.time()
        known = [(low, min(high, now)) for low, high in aggregates.in_order(asked[:most]) if low < now]
        try:
            async with self._turn:
                summaries = await self._history.summaries(*found, known) if known else ()
        except DriveCommError:
            # The value was never read.
            summaries = ()
        by_begin = {each.begin_s: each for each in summaries}
        told = [
            aggregates.data_value(
                kind, from_s, by_begin.get(min(from_s, to_s)), is_partial=0 < abs(to_s - from_s) < every * 0.999
            )
            for from_s, to_s in asked[:most]
        ]
        result = ua.HistoryReadResult(HistoryData=ua.HistoryData(DataValues=told))
        if len(asked) > most:
            result.ContinuationPoint = Primitives.DateTime.pack(datetime.fromtimestamp(asked[most][0], UTC))
        return result

    async def _values(self, wanted: ua.HistoryReadValueId, details: ua.ReadRawModifiedDetails) -> ua.HistoryReadResult:
        found = self._value_at(wanted.NodeId)
        if self._history is None or found is None:
            return self._without_history(wanted.NodeId)
        begin, end = _seconds(details.StartTime), _seconds(details.EndTime)
        most = min(details.NumValuesPerNode or limits.PAST_VALUES, limits.PAST_VALUES)
        if begin is None:
            if end is None or not details.NumValuesPerNode:
                return _failed(ua.StatusCodes.BadHistoryOperationInvalid)
            # Without a start time: the latest values before the end, backwards.
            begin, end = end, 0.0
        try:
            if wanted.ContinuationPoint:
                begin = _continued(wanted.ContinuationPoint)
        except RefusedPartError as error:
            return _failed(error.code)
        end = _EVER_S if end is None else end
        try:
            async with self._turn:
                values = await self._history.values(*found, begin, end, most + 1)
        except DriveCommError:
            # The value was never read.
            values = ()
        told = [past_value(each.value, each.quality, each.time_s) for each in values[:most]]
        result = ua.HistoryReadResult(HistoryData=ua.HistoryData(DataValues=told))
        if not told:
            result.StatusCode = status(ua.StatusCodes.GoodNoData)
        elif len(values) > most and not details.NumValuesPerNode:
            follows = datetime.fromtimestamp(values[most].time_s, UTC)
            result.ContinuationPoint = Primitives.DateTime.pack(follows)
        return result

    def _without_history(self, node: ua.NodeId) -> ua.HistoryReadResult:
        is_there = self._is_there(node)
        codes = ua.StatusCodes
        return _failed(codes.BadHistoryOperationUnsupported if is_there else codes.BadNodeIdUnknown)


def _continued(point: bytes) -> float:
    """Return the time of a continuation point, in seconds since 1970. Raises RefusedPartError if it is invalid."""
    try:
        found = _seconds(Primitives.DateTime.unpack(Buffer(point)))
    except Exception:  # noqa: BLE001 - it is whatever a client sends
        found = None
    if found is None:
        raise RefusedPartError(ua.StatusCodes.BadContinuationPointInvalid)
    return found


def _seconds(time: datetime | None) -> float | None:
    """Return seconds since 1970; None for an unspecified time."""
    if time is None or time.year < _FIRST_YEAR:
        return None
    return (time if time.tzinfo else time.replace(tzinfo=UTC)).timestamp()


def _failed(code: int) -> ua.HistoryReadResult:
    return ua.HistoryReadResult(StatusCode=status(code))
