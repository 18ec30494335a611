"""History aggregates that this server computes, as defined in OPC UA Part 13."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from asyncua import ua

from drivecomm.server.opcua.refusals import RefusedPartError
from drivecomm.server.opcua.values import moment

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from drivecomm.server import PeriodSummary

_CALCULATED, _INTERPOLATED, _PARTIAL = 0x401, 0x402, 0x404
"""Low bits of an aggregate's status code (Part 4, 7.34.1): information bit and how the value was computed."""


def _count(found: PeriodSummary) -> ua.Variant | None:
    known = found.number or found.known_s
    return ua.Variant(ua.Int32(found.number), ua.VariantType.Int32) if known else None


def _double(of: Callable[[PeriodSummary], float | None]) -> Callable[[PeriodSummary], ua.Variant | None]:
    def told(found: PeriodSummary) -> ua.Variant | None:
        value = of(found)
        return None if value is None else ua.Variant(value, ua.VariantType.Double)

    return told


_AGGREGATES: Mapping[int, tuple[Callable[[PeriodSummary], ua.Variant | None], int, bool]] = {
    ua.ObjectIds.AggregateFunction_Interpolative: (_double(lambda found: found.at_begin), _INTERPOLATED, True),
    ua.ObjectIds.AggregateFunction_Average: (_double(lambda found: found.mean), _CALCULATED, False),
    ua.ObjectIds.AggregateFunction_TimeAverage: (_double(lambda found: found.mean_over_time), _CALCULATED, True),
    ua.ObjectIds.AggregateFunction_Minimum: (_double(lambda found: found.lowest), _CALCULATED, False),
    ua.ObjectIds.AggregateFunction_Maximum: (_double(lambda found: found.highest), _CALCULATED, False),
    ua.ObjectIds.AggregateFunction_Count: (_count, _CALCULATED, False),
}
"""Of each aggregate: its value in an interval, its status bit, and whether it depends on values between samples."""

AGGREGATES = tuple(ua.NodeId(ua.Int32(each), ua.Int16(0)) for each in _AGGREGATES)
"""Node ids of the aggregates that this server computes."""


def check(kind: ua.NodeId, configuration: ua.AggregateConfiguration) -> None:
    """Raise RefusedPartError for an unsupported aggregate or configuration."""
    if kind not in AGGREGATES:
        raise RefusedPartError(ua.StatusCodes.BadAggregateNotSupported)
    own = configuration.UseServerCapabilitiesDefaults or (
        (configuration.PercentDataBad, configuration.PercentDataGood, configuration.UseSlopedExtrapolation)
        == (100, 100, False)
    )
    if not own:
        raise RefusedPartError(ua.StatusCodes.BadAggregateConfigurationRejected)


def processing_intervals(begin_s: float, end_s: float, every_s: float, most: int) -> list[tuple[float, float]]:
    """Return the processing intervals between two times, in reverse if the end is earlier; at most `most` + 1.

    every_s: length of an interval, 0 for the whole time. Raises RefusedPartError.
    """
    if not 0 <= every_s < math.inf or begin_s == end_s:
        raise RefusedPartError(ua.StatusCodes.BadAggregateInvalidInputs)
    whole = abs(end_s - begin_s)
    every_s = min(every_s or whole, whole)
    step = math.copysign(every_s, end_s - begin_s)
    # A remainder caused by rounding is not an interval.
    number = min(most + 1, max(1, math.ceil(whole / every_s - 1e-6)))
    found = [(begin_s + step * place, begin_s + step * (place + 1)) for place in range(number)]
    if abs(found[-1][1] - begin_s) > whole:
        found[-1] = (found[-1][0], end_s)
    return found


def data_value(kind: ua.NodeId, begin_s: float, found: PeriodSummary | None, *, is_partial: bool) -> ua.DataValue:
    """Return an aggregate of one processing interval, which begins at begin_s.

    found: None if nothing is known of the interval. is_partial: whether it is shorter than the others.
    """
    of, how, is_between = _AGGREGATES[int(kind.Identifier)]
    variant = None if found is None else of(found)
    if found is None or variant is None:
        bad = ua.StatusCode(ua.UInt32(ua.StatusCodes.BadNoData))
        return ua.DataValue(ua.Variant(None, ua.VariantType.Null), bad, moment(begin_s), None)
    is_doubtful = found.has_gap or (is_between and found.is_held)
    status = ua.StatusCodes.UncertainDataSubNormal if is_doubtful else ua.StatusCodes.Good
    bits = how | (_PARTIAL if is_partial else 0)
    return ua.DataValue(variant, ua.StatusCode(ua.UInt32(status | bits)), moment(begin_s), None)


def in_order(asked: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return processing intervals in ascending order, each from its earlier to its later time."""
    return sorted((min(each), max(each)) for each in asked)
