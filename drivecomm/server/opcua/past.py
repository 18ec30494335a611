"""What values were, from the journal, for clients that read history."""

from __future__ import annotations

import asyncio
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from asyncua import ua
from asyncua.common.utils import Buffer
from asyncua.ua.ua_binary import Primitives

from drivecomm.errors import DriveCommError
from drivecomm.server.opcua import limits
from drivecomm.server.opcua.values import past_value

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.server import History

_FIRST_YEAR = 1970
_EVER_S = 4e9


class PastReader:
    """Reads the history. value_at: the drive and the name of the value that a node is, None for one without."""

    def __init__(self, history: History | None, value_at: Callable[[ua.NodeId], tuple[str, str] | None]) -> None:
        self._history, self._value_at = history, value_at
        # One after the other, so that those who ask for much hold up each other only.
        self._turn = asyncio.Lock()

    async def read(self, params: ua.HistoryReadParameters) -> list[ua.HistoryReadResult]:
        """Tell what the values of some nodes were."""
        details = params.HistoryReadDetails
        if not isinstance(details, ua.ReadRawModifiedDetails) or details.IsReadModified:
            return [_failed(ua.StatusCodes.BadHistoryOperationUnsupported) for _ in params.NodesToRead]
        if params.ReleaseContinuationPoints:
            # Nothing is kept for them.
            return [ua.HistoryReadResult() for _ in params.NodesToRead]
        return [await self._values(each, details) for each in params.NodesToRead]

    async def _values(self, wanted: ua.HistoryReadValueId, details: ua.ReadRawModifiedDetails) -> ua.HistoryReadResult:
        found = self._value_at(wanted.NodeId)
        if self._history is None or found is None:
            return _failed(ua.StatusCodes.BadHistoryOperationUnsupported)
        begin, end = _seconds(details.StartTime), _seconds(details.EndTime)
        most = min(details.NumValuesPerNode or limits.PAST_VALUES, limits.PAST_VALUES)
        if begin is None and (end is None or not details.NumValuesPerNode):
            return _failed(ua.StatusCodes.BadHistoryOperationInvalid)
        if begin is None and end is not None:
            # The latest before the end, backwards.
            begin, end = end, 0.0
        try:
            if wanted.ContinuationPoint:
                begin = _seconds(Primitives.DateTime.unpack(Buffer(wanted.ContinuationPoint)))
        except Exception:  # noqa: BLE001 - it is whatever a client sends
            begin = None
        if begin is None:
            return _failed(ua.StatusCodes.BadContinuationPointInvalid)
        end = _EVER_S if end is None else end
        try:
            async with self._turn:
                values = await self._history.values(*found, begin, end, most + 1)
        except DriveCommError:
            # It was never read.
            values = ()
        told = [past_value(each.value, each.quality, each.time_s) for each in values[:most]]
        result = ua.HistoryReadResult(HistoryData=ua.HistoryData(DataValues=told))
        if not told:
            result.StatusCode = ua.StatusCode(ua.UInt32(ua.StatusCodes.GoodNoData))
        elif len(values) > most and not details.NumValuesPerNode:
            follows = datetime.fromtimestamp(values[most].time_s, UTC)
            result.ContinuationPoint = Primitives.DateTime.pack(follows)
        return result


def _seconds(time: datetime | None) -> float | None:
    """Return seconds since 1970; None for a time that is not given."""
    if time is None or time.year < _FIRST_YEAR:
        return None
    return (time if time.tzinfo else time.replace(tzinfo=UTC)).timestamp()


def _failed(code: int) -> ua.HistoryReadResult:
    return ua.HistoryReadResult(StatusCode=ua.StatusCode(ua.UInt32(code)))
