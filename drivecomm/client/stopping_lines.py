"""Stop of all drives of a line of a server, which stops those of its plant concurrently."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from drivecomm.bus import StopResult, stopping_all
from drivecomm.client.wire import error_of
from drivecomm.errors import DriveCommError
from drivecomm.protocol import Stop, way_to_stop

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from drivecomm.bus import OnResult, Procedure
    from drivecomm.client.async_served_bus import AsyncServedBus
    from drivecomm.client.served_bus import ServedBus
    from drivecomm.protocol import DriveConfig, StopName

# Time for a stop of each drive of a line, with all attempts that silent drives may need.
_LONGEST_S = 20.0


def stopping_served_line(
    bus: ServedBus | AsyncServedBus,
    drives: Iterable[DriveConfig] | None,
    how: Stop | StopName,
    on_result: OnResult | None,
) -> Procedure[list[StopResult]]:
    """Stop a line of a server, and return all results; see `Bus.stop_all`.

    drives: further drives besides those of the server's plant; they are stopped one by one. Raises the server's error
    only if there is no drive for which it could be reported.
    """
    how = way_to_stop(how)
    left = {str(each): each for each in (*bus.drives, *(drives or ()))}
    results: list[StopResult] = []
    try:
        results += yield lambda _: bus.at_server(partial(_stopped, bus, how))
    except DriveCommError:
        if not left:
            raise
    else:
        left = {place: each for place, each in left.items() if place not in bus.names}
    if on_result is not None:
        for each in results:
            on_result(each)
    return results + (yield from stopping_all(bus, left.values(), how, on_result, by_name=True))


def _stopped(bus: ServedBus | AsyncServedBus, how: Stop) -> list[StopResult]:
    asked = {"how": how.value, "lines": [bus.line]}
    limit_s = _LONGEST_S * max(1, len(bus.drives))
    return [_result_of(each) for each in bus.server.order("/api/v1/stop", asked, limit_s=limit_s)]


def _result_of(content: Mapping[str, Any]) -> StopResult:
    protocol, _, whom = str(content["drive"]).rpartition(":")
    is_to_all = whom == "*"
    return StopResult(
        line=str(content["line"]),
        drive="" if is_to_all else str(content["drive"]),
        protocol=protocol if is_to_all else "",
        how=Stop(content["how"]),
        error=error_of(content["error"]) if content.get("error") else None,
    )
