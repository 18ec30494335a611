"""The form of what the API answers, as JSON Schema: of dataclasses by their fields, of what is put together by hand."""

from __future__ import annotations

from dataclasses import fields
from decimal import Decimal
from enum import Enum
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Any, Literal, Union, get_args, get_origin, get_type_hints

from drivecomm.line import ResultQuality
from drivecomm.protocol import DriveStatus, LinkLoss, Quality, Reading, Stop
from drivecomm.server import Event, LineState, RememberedFault, StandingStop

if TYPE_CHECKING:
    from collections.abc import Mapping

Schema = dict[str, Any]

_PLAIN: Mapping[Any, str] = {str: "string", bool: "boolean", int: "integer", float: "number", Decimal: "number"}
_NULL: Schema = {"type": "null"}


def _of_type(hint: Any) -> Schema:
    if hint in _PLAIN:
        return {"type": _PLAIN[hint]}
    if hint is NoneType:
        return dict(_NULL)
    if get_origin(hint) in (Union, UnionType):
        return {"anyOf": [_of_type(each) for each in get_args(hint)]}
    if get_origin(hint) is Literal:
        return {"enum": list(get_args(hint))}
    if get_origin(hint) is tuple:
        return {"type": "array", "items": _of_type(get_args(hint)[0])}
    if isinstance(hint, type) and issubclass(hint, Enum):
        return {"enum": [each.value for each in hint]}
    raise TypeError(f"no schema for {hint}")


def _of_class(owner: type, **further: Schema) -> Schema:
    # What a module names for type checkers only.
    hints = get_type_hints(owner, localns={"Decimal": Decimal, "Stop": Stop})
    return _object({field.name: _of_type(hints[field.name]) for field in fields(owner)} | further)


def _object(properties: Mapping[str, Schema], about: str = "") -> Schema:
    made: Schema = {"type": "object", "properties": dict(properties), "required": list(properties)}
    return {"description": about, **made} if about else made


def _ref(name: str) -> Schema:
    return {"$ref": f"#/components/schemas/{name}"}


def _list(name: str) -> Schema:
    return {"type": "array", "items": _ref(name)}


def _or_null(schema: Schema) -> Schema:
    return {"anyOf": [schema, dict(_NULL)]}


_TEXT: Schema = {"type": "string"}
_NUMBER: Schema = {"type": "number"}
_WHOLE: Schema = {"type": "integer"}
_CHOICE: Schema = {"type": "boolean"}
_ANY: Schema = {}
_QUALITY: Schema = {"enum": list(get_args(ResultQuality))}
_LEASE = {"drive": _TEXT, "holder": _TEXT, "door": _TEXT, "until_s": _NUMBER, "yours": _CHOICE}
_ANSWER = {
    "id": _TEXT,
    "outcome": {"enum": ["done", "refused", "failed", "open"]},
    "result": _ANY,
    "error": _or_null(_ref("Error")),
}
_NAMED: Schema = {"type": "object", "additionalProperties": True}

SCHEMAS: Mapping[str, Schema] = {
    "Error": {
        "type": "object",
        "properties": {"kind": _TEXT, "text": _TEXT, "exit_code": _WHOLE},
        "required": ["kind", "text", "exit_code"],
        "description": "kind: of the tree of errors that Python callers get.",
    },
    "Failure": _object({"error": _ref("Error")}),
    "Reading": _of_class(Reading, quality={"enum": list(get_args(Quality))}),
    "Status": _of_class(DriveStatus),
    "Line": _of_class(LineState),
    "Event": _of_class(Event),
    "Events": _list("Event"),
    "Value": _object({
        "drive": _TEXT, "name": _TEXT, "quality": _QUALITY, "cause": _TEXT, "time_s": _NUMBER,
        "source_s": _or_null(_NUMBER), "age_s": _or_null(_NUMBER), "reading": _or_null(_ref("Reading")),
    }, "The latest of one quantity. source_s: when the reply with it had arrived."),
    "Values": _list("Value"),
    "Plant": _object({
        "name": _TEXT, "file": _TEXT, "session": _TEXT, "version": _TEXT, "started_s": _NUMBER, "time_s": _NUMBER,
        "you": _object({"name": _TEXT, "role": {"enum": ["nobody", "view", "operate", "commission"]}, "door": _TEXT}),
        "lines": _list("Line"), "drives": {"type": "array", "items": _TEXT}, "alarms": _WHOLE,
    }, "session: a random word of this run of the server."),
    "Lease": _object(_LEASE),
    "Leases": _list("Lease"),
    "OwnLease": _object({**_LEASE, "key": _TEXT}),
    "EndedLease": _object({"drive": _TEXT}),
    "Drive": _object({
        "name": _TEXT, "drive": _TEXT, "line": _TEXT, "title": _TEXT, "model": _TEXT, "armed": _CHOICE,
        "read_only_reason": _TEXT, "link_loss": _or_null(_ref("LinkLoss")),
        "policies": {"type": "array", "items": _ref("Policy")}, "monitoring_only": _CHOICE,
        "fault_log": {"type": "array", "items": _ref("RememberedFault")},
        "may": {"type": "array", "items": _TEXT}, "reachability": {"enum": ["asking", "answers", "silent"]},
        "state": _or_null(_TEXT), "status": _or_null(_ref("Status")), "fault": _TEXT, "late": _CHOICE, "error": _TEXT,
        "answered_s": _or_null(_NUMBER), "age_s": _or_null(_NUMBER), "lease": _or_null(_ref("Lease")), "kept": _TEXT,
        "standing_stop": _or_null(_ref("StandingStop")),
        "counters": {"type": "object", "additionalProperties": _WHOLE}, "reply_s": _NUMBER, "values": _list("Value"),
    }, "may: the verbs that you may use. late: its line had no time to ask for its status, which may have "
       "changed since. policies: with which link-loss policies it can be started. monitoring_only: its model has no "
       "orders, so it can only be read. fault_log: what the drive remembered of its faults when it was asked last, "
       "the newest first. kept: the link-loss policy under which the server keeps the motor running. standing_stop: "
       "the stop that is retried until the drive confirms it, or that a door demands; null without one."),
    "StandingStop": _of_class(StandingStop, text=_TEXT),
    "Drives": _list("Drive"),
    "Policy": {"enum": list(get_args(LinkLoss))},
    "LinkLoss": _object({"policy": _ref("Policy"), "watchdog_s": _NUMBER}, "What the plant file says."),
    "RememberedFault": _of_class(RememberedFault),
    "Answer": _object(_ANSWER, "open: it was sent, and whether the drive acted is not known."),
    "Stops": {"type": "array", "items": _object(
        {"line": _TEXT, "drive": _TEXT, **_ANSWER, "how": _TEXT},
        "drive: PROTOCOL:* for a broadcast, which nobody confirms: its outcome is open, without an error.",
    )},
    "Points": _object({"points": {"type": "array", "items": {
        "type": "array", "prefixItems": [_NUMBER, _or_null(_NUMBER), _QUALITY], "minItems": 3, "maxItems": 3,
    }}}, "Time, value and quality of each."),
    "Login": _object({"token": _TEXT, "until_s": _NUMBER}),
    "Alarm": _NAMED,
    "Alarms": _list("Alarm"),
    "Stream": {
        "type": "string",
        "description": "Messages: hello (Plant), values (Values), events (Events, with an id), lost ({events: n}).",
    },
    "Metrics": {"type": "string", "description": "The text format of Prometheus, or OpenMetrics where asked for."},
    "KeptEvent": _NAMED,
    "Found": _NAMED,
    "Telegram": _NAMED,
    "Counted": _NAMED,
}  # fmt: skip
