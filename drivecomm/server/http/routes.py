"""The table of the API: what is served where, who may ask, what a request may hold. OpenAPI describes the same."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from drivecomm.protocol import Stop
from drivecomm.server import Role
from drivecomm.server.http import commanding, reading
from drivecomm.server.http.fields import CHOICE, NUMBER, OBJECT, TEXT, TEXTS, WHOLE, WHOLES, Field

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Mapping

    from starlette.responses import Response

    from drivecomm.server.http.asked import Asked

V1 = "/api/v1"


@dataclass(frozen=True, slots=True, kw_only=True)
class Route:
    """One way to ask.

    summary: one sentence, for the description. answer: the name of its content among the schemas. role: what a caller
    must have at least; NOBODY: none, not even a name. named: anonymous callers may not ask this. local: callers of the
    local door only. body, query: what a request may hold. form: how the answer is sent.
    """

    method: Literal["GET", "POST", "PUT", "DELETE"]
    path: str
    summary: str
    carry_out: Callable[[Asked], Awaitable[Response]]
    answer: str
    role: Role = Role.VIEW
    named: bool = False
    local: bool = False
    body: Mapping[str, Field] = field(default_factory=dict)
    query: Mapping[str, Field] = field(default_factory=dict)
    form: Literal["json", "events", "lines", "text"] = "json"


_SPAN = {
    "from": Field(kind=NUMBER, about="the earliest time, in seconds since 1970; a day before the latest unless given"),
    "to": Field(kind=NUMBER, about="the latest time, in seconds since 1970; now unless given"),
}
_LIMIT = {"limit": Field(kind=WHOLE, about="how many at most", low=1, high=10_000)}
_COMMAND = {
    "id": Field(
        kind=TEXT,
        network=True,
        about="a text of your choice; the same again gets the first answer again; a stop needs none, and acts each time",
    ),
    "lease": Field(kind=TEXT, about="the key of the lease under which it is asked"),
    "arm": Field(kind=CHOICE, about="command a drive that the plant file does not arm", local=True),
    "options": Field(kind=OBJECT, about="what you say of the drive itself, such as its model", local=True),
    "issued_s": Field(kind=NUMBER, about="when the command was given, in seconds since 1970", low=0),
    "valid_s": Field(kind=NUMBER, about="for how many seconds it counts; 2 unless given", low=0.001, high=10),
    "session": Field(kind=TEXT, about="the session of the plant that it is meant for"),
}
_VERB = {"arguments": Field(kind=OBJECT, about="the arguments of the verb, by their names"), **_COMMAND}
_SECONDS = Field(kind=NUMBER, about="for how long, until it is renewed", needed=True, low=0.1, high=30)
_KEY = Field(kind=TEXT, about="the key that came with the lease", needed=True)

ROUTES = (
    Route(
        method="GET", path=f"{V1}/plant", answer="Plant", carry_out=reading.plant,
        summary="The plant as a whole, and who you are.",
    ),
    Route(
        method="GET", path=f"{V1}/drives", answer="Drives", carry_out=reading.drives,
        summary="All drives, with their status, faults, leases and current values.",
    ),
    Route(
        method="GET", path=f"{V1}/drives/{{name}}", answer="Drive", carry_out=reading.drive,
        summary="One drive.",
    ),
    Route(
        method="GET", path=f"{V1}/values", answer="Values", carry_out=reading.values,
        summary="All current values, with unit, quality, source time and age.",
    ),
    Route(
        method="GET", path=f"{V1}/events", answer="Events", carry_out=reading.events, query=_LIMIT,
        summary="The latest events of this run of the server, the oldest first.",
    ),
    Route(
        method="GET", path=f"{V1}/history", answer="Points", carry_out=reading.history,
        summary="A quantity as it was, thinned for a plot.",
        query={
            "drive": Field(kind=TEXT, about="the drive's name", needed=True),
            "name": Field(kind=TEXT, about="the quantity, as it is polled", needed=True),
            **_SPAN,
            "points": Field(kind=WHOLE, about="about how many points; 500 unless given", low=2, high=10_000),
        },
    ),
    Route(
        method="GET", path=f"{V1}/history/events", answer="Events", carry_out=reading.past_events,
        summary="Events of this and earlier runs, the oldest first.",
        query={
            "drive": Field(kind=TEXT, about="of this drive only"),
            "kind": Field(kind=TEXT, about="of this kind only, such as fault"),
            **_SPAN,
            **_LIMIT,
        },
    ),
    Route(
        method="GET", path=f"{V1}/stream", answer="Stream", carry_out=reading.stream, form="events",
        summary="Values and events as they come, as Server-Sent Events.",
        query={
            "drives": Field(kind=TEXTS, about="the names of drives, with commas between them; all unless given"),
            "every": Field(kind=NUMBER, about="values at most once in so many seconds", low=0.05, high=3600),
        },
    ),
    Route(
        method="GET", path=f"{V1}/leases", answer="Leases", carry_out=reading.leases,
        summary="Who commands what now.",
    ),
    Route(
        method="GET", path=f"{V1}/alarms", answer="Alarms", carry_out=reading.alarms,
        summary="Alarms that are on, or that nobody has acknowledged.",
    ),
    Route(
        method="GET", path="/metrics", answer="Metrics", carry_out=reading.metrics, form="text",
        summary="All values, drives and lines for Prometheus.",
    ),
    Route(
        method="POST", path=f"{V1}/alarms/{{id}}/acknowledge", answer="Alarm", carry_out=commanding.acknowledge,
        summary="Acknowledge an alarm.", named=True,
    ),
    Route(
        method="POST", path=f"{V1}/login", answer="Login", carry_out=commanding.login, role=Role.NOBODY,
        summary="A token for a name and a password; give it as Authorization: Bearer TOKEN.",
        body={
            "name": Field(kind=TEXT, about="the user's name", needed=True),
            "password": Field(kind=TEXT, about="the user's password", needed=True),
        },
    ),
    Route(
        method="POST", path=f"{V1}/stop", answer="Stops", carry_out=commanding.stop, named=True,
        summary="Stop all drives of all lines, or of those that are named; needs no lease.",
        body={
            "how": Field(kind=TEXT, about="ramp unless given", choices=tuple(each.value for each in Stop)),
            "lines": Field(kind=TEXTS, about="the names of lines; all unless given"),
        },
    ),
    Route(
        method="POST", path=f"{V1}/drives/{{name}}/lease", answer="OwnLease", carry_out=commanding.take_lease,
        summary="Take the right to command a drive.", named=True, body={"seconds": _SECONDS},
    ),
    Route(
        method="PUT", path=f"{V1}/drives/{{name}}/lease", answer="OwnLease", carry_out=commanding.renew_lease,
        summary="Have it for longer.", named=True, body={"key": _KEY, "seconds": _SECONDS},
    ),
    Route(
        method="DELETE", path=f"{V1}/drives/{{name}}/lease", answer="EndedLease", carry_out=commanding.end_lease,
        summary="Give it back.", body={"key": _KEY}, named=True,
    ),
    Route(
        method="POST", path=f"{V1}/drives/{{name}}/keep", answer="Answer", carry_out=commanding.keep, named=True,
        summary="Set a drive's watchdog, start its motor, and keep it while the lease is renewed.",
        body={
            "policy": Field(kind=TEXT, about="what the motor does when its master falls silent; as the plant says"),
            "watchdog_s": Field(kind=NUMBER, about="after how many seconds the drive notices", low=0.001, high=3600),
            "reverse": Field(kind=CHOICE, about="backwards"),
            "percent": Field(kind=NUMBER, about="the reference, as a share of its range"),
            "hz": Field(kind=NUMBER, about="the reference, as an output frequency"),
            "by": Field(kind=OBJECT, about="verb (jog, call, write) and arguments that start it instead", local=True),
            "start": Field(kind=CHOICE, about="false: not started, which commands under the lease then do", local=True),
            **_COMMAND,
        },
    ),
    Route(
        method="GET", path=f"{V1}/drives/{{name}}/keep/events", answer="KeptEvent", carry_out=commanding.kept_events,
        summary="What happens to a motor that is kept running, until it is so no more.", form="lines",
    ),
    Route(
        method="POST", path=f"{V1}/drives/{{name}}/{{verb}}", answer="Answer", carry_out=commanding.command, named=True,
        summary="Carry out a verb, such as read, status, start, stop, set_reference or write.", body=_VERB,
    ),
    Route(
        method="POST", path=f"{V1}/lines/{{line}}/drives/{{drive}}/{{verb}}", answer="Answer", named=True, local=True,
        carry_out=commanding.command_elsewhere, body=_VERB,
        summary="Ask or stop a drive that the plant does not have, named as PROTOCOL:ADDRESS.",
    ),
    Route(
        method="POST", path=f"{V1}/lines/{{line}}/scan", answer="Found", carry_out=commanding.scan, form="lines",
        summary="Look for drives.", role=Role.COMMISSION, named=True, local=True,
        body={
            "only": Field(kind=TEXTS, about="these protocols only"),
            "addresses": Field(kind=WHOLES, about="these addresses only"),
            "choices": Field(kind=OBJECT, about="the line settings to try"),
            "options": Field(kind=OBJECT, about="further options"),
        },
    ),
    Route(
        method="POST", path=f"{V1}/lines/{{line}}/doctor", answer="Found", carry_out=commanding.doctor, form="lines",
        summary="Examine a line.", role=Role.COMMISSION, named=True, local=True,
        body={
            "only": Field(kind=TEXTS, about="these protocols only"),
            "addresses": Field(kind=WHOLES, about="these addresses only"),
            "probes": Field(kind=WHOLE, about="how often each drive is asked", low=1, high=1000),
            "search": Field(kind=CHOICE, about="whether drives that do not answer are given more time"),
            "rates": Field(kind=CHOICE, about="whether other baud rates are tried where nobody answers"),
            "options": Field(kind=OBJECT, about="line settings and timing for all drives"),
        },
    ),
    Route(
        method="GET", path=f"{V1}/lines/{{line}}/trace", answer="Telegram", carry_out=commanding.trace, form="lines",
        summary="Each telegram of a line, as it goes by.", local=True,
    ),
    Route(
        method="GET", path=f"{V1}/lines/{{line}}/statistics", answer="Counted", carry_out=commanding.statistics,
        summary="What was counted on a line.", local=True, form="lines",
    ),
)  # fmt: skip
