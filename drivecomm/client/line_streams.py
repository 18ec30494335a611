"""Services of a server for a whole line: scans, examinations, counters. One JSON object per line.

A stream has lines {"progress": [WHAT, DONE, TOTAL]} and result lines, such as {"found": ...}; {"error": ...} ends it.
"""

from __future__ import annotations

from collections import Counter
from decimal import Decimal
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from drivecomm.bus import Found
from drivecomm.client.wire import error_of
from drivecomm.link import Health, ReplyTimes, Statistics
from drivecomm.protocol import LineSettings

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from drivecomm.client.connection import LocalServer


def path_of(line: str, what: str) -> str:
    """Return the path of a service for a line."""
    return f"/api/v1/lines/{quote(line, safe='')}/{what}"


def service_results(
    server: LocalServer,
    line: str,
    what: str,
    request_options: Mapping[str, Any],
    progress: Callable[[str, int, int], None] | None,
) -> Iterator[dict[str, Any]]:
    """Start a service of the server for a line, and yield its result lines; raises the error with which it ends."""
    with server.stream(path_of(line, what), request_options) as news:
        for each in news:
            if each is None:
                continue
            if "error" in each:
                raise error_of(each["error"])
            if "progress" not in each:
                yield each
            elif progress is not None:
                progress(*each["progress"])


def scan(
    server: LocalServer, line: str, request_options: Mapping[str, Any], progress: Callable[[str, int, int], None] | None
) -> Iterator[Found]:
    """Yield the drives that a scan of the server finds."""
    for each in service_results(server, line, "scan", request_options, progress):
        yield found_of(each["found"])


def found_of(content: Mapping[str, Any]) -> Found:
    """Rebuild a scan result from its plain form."""
    settings, candidates = content.get("settings"), tuple(content.get("candidates", ()))
    made = {"settings": None if settings is None else settings_of(settings), "candidates": candidates}
    return Found(**{**content, **made})


def settings_of(content: Mapping[str, Any]) -> LineSettings:
    """Rebuild line settings from their plain form."""
    bits = content.get("stopbits", 1)
    return LineSettings(**{**content, "stopbits": bits if isinstance(bits, int) else float(bits)})


def statistics(server: LocalServer, line: str) -> dict[str, Statistics]:
    """Return the statistics of a line since the server began, by drive as PROTOCOL:ADDRESS."""
    counted = {}
    with server.stream(path_of(line, "statistics")) as news:
        for each in news:
            if each is not None:
                counted[str(each["drive"])] = _statistics_of(each)
    return counted


def _statistics_of(content: Mapping[str, Any]) -> Statistics:
    times = content["reply_times"]
    shortest = times.get("shortest_s")
    return Statistics(
        counters=Counter({name: int(number) for name, number in content["counters"].items()}),
        reply_times=ReplyTimes(
            classes=[int(number) for number in times["classes"]],
            # A drive that has not answered has no shortest reply.
            shortest_s=float("inf") if shortest is None else float(shortest),
            longest_s=float(times["longest_s"]),
            total_s=float(times["total_s"]),
        ),
    )


def since(before: Mapping[str, Statistics], now: Mapping[str, Statistics]) -> dict[str, Statistics]:
    """Return the difference of two statistics; the shortest and the longest reply are those since the server began."""
    return {name: _difference(before.get(name, Statistics()), each) for name, each in now.items()}


def _difference(before: Statistics, now: Statistics) -> Statistics:
    old, new = before.reply_times, now.reply_times
    return Statistics(
        counters=now.counters - before.counters,
        reply_times=ReplyTimes(
            classes=[later - earlier for earlier, later in zip(old.classes, new.classes, strict=True)],
            shortest_s=new.shortest_s,
            longest_s=new.longest_s,
            total_s=new.total_s - old.total_s,
        ),
    )


def health(server: LocalServer, line: str) -> dict[str, Health]:
    """Return the health of the drives of the server's plant on a line, by PROTOCOL:ADDRESS."""
    found = {}
    for each in server.ask("/api/v1/drives"):
        if each["line"] == line:
            found[str(each["drive"])] = one = Health()
            one.given_up = one.away = each["reachability"] == "silent"
    return found


def other_master(server: LocalServer, line: str) -> str:
    """Return why a line of a server counts as shared with another master, empty if it does not."""
    return next(
        (str(each["other_master"]) for each in server.ask("/api/v1/plant")["lines"] if each["name"] == line), ""
    )


def examination_results(
    bus: Any, request_options: Mapping[str, Any], progress: Callable[[str, int, int], None] | None
) -> Iterator[dict[str, Any]]:
    """Yield the results of a server's examination of a line: {"finding": ...} each, then {"measured": ...}.

    bus: the line, as opened by the client.
    """
    for each in service_results(bus.server, bus.line, "doctor", request_options, progress):
        yield _measured(each)


def _measured(content: Any) -> Any:
    """Return measurements with floats in place of decimals, since none of them is exact."""
    if isinstance(content, Decimal):
        return float(content)
    if isinstance(content, dict):
        return {name: _measured(each) for name, each in content.items()}
    return [_measured(each) for each in content] if isinstance(content, list) else content
