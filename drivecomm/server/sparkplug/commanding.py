"""Commands of hosts: the metrics for them, and the commands in a message.

Sparkplug has neither leases nor sessions, and most hosts write one metric at a time. So every command needs the
timestamp of its message. A start, for which a host must take responsibility, also needs the server's session in the
same message. Hosts see the state of a drive in its status only: the command metrics never have a value.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from math import isfinite
from typing import TYPE_CHECKING, Any

from drivecomm.errors import NotAllowedError, UsageError, suggestion
from drivecomm.server import NEEDS, CommandRequest
from drivecomm.server.sparkplug.payload import DataType, Metric, typed

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping, Sequence

    from drivecomm.server.sparkplug.payload import Payload

FOLDER = "Command/"
SESSION = f"{FOLDER}Session"
"""Metric required with a start; its value is Properties/Session from the birth of the edge node."""

VALID_S = 2.0
"""Seconds after the message's timestamp within which a command is carried out; later it is refused."""

_STARTS = frozenset({"start", "reverse", "jog"})
"""Verbs that can make a motor turn."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandMetric:
    """Command behind a metric. argument: the argument that takes the metric's value, "" for a button."""

    verb: str
    type: DataType = DataType.BOOLEAN
    argument: str = ""
    fixed: Mapping[str, Any] = field(default_factory=dict, hash=False)


ORDERS: Mapping[str, CommandMetric] = {
    f"{FOLDER}Stop": CommandMetric(verb="stop"),
    f"{FOLDER}Stop Coast": CommandMetric(verb="stop", fixed={"how": "coast"}),
    f"{FOLDER}Stop Quick": CommandMetric(verb="stop", fixed={"how": "quick"}),
    f"{FOLDER}Reset": CommandMetric(verb="reset"),
    f"{FOLDER}Hold": CommandMetric(verb="hold"),
    f"{FOLDER}Reference Percent": CommandMetric(verb="set_reference", type=DataType.DOUBLE, argument="percent"),
    f"{FOLDER}Reference Hertz": CommandMetric(verb="set_reference", type=DataType.DOUBLE, argument="hz"),
    f"{FOLDER}Setup": CommandMetric(verb="select_setup", type=DataType.INT32, argument="number"),
    f"{FOLDER}Preset": CommandMetric(verb="select_preset", type=DataType.INT32, argument="number"),
    f"{FOLDER}Relay 1": CommandMetric(verb="set_relay", argument="on", fixed={"number": 1}),
    f"{FOLDER}Relay 2": CommandMetric(verb="set_relay", argument="on", fixed={"number": 2}),
    f"{FOLDER}Start": CommandMetric(verb="start"),
    f"{FOLDER}Start Reverse": CommandMetric(verb="reverse"),
}


def command_metrics(verbs: Collection[str]) -> list[Metric]:
    """Return the command metrics for the permitted verbs, without values."""
    found = [Metric(name=name, type=order.type) for name, order in ORDERS.items() if order.verb in verbs]
    if any(order.verb in verbs and order.verb in _STARTS for order in ORDERS.values()):
        found.append(Metric(name=SESSION, type=DataType.STRING))
    return found


def commands_in(payload: Payload, metrics: Sequence[Metric], drive: str) -> list[CommandRequest]:
    """Return the commands in a message to a drive; if there is a stop, only the stop.

    metrics: metrics of the payload, with their names. Raises UsageError for an invalid command, and NotAllowedError for
    one without a required part.
    """
    for metric in metrics:
        # Checked first: an error elsewhere in the message must not prevent a stop.
        order = ORDERS.get(metric.name)
        if order is not None and order.verb == "stop" and _is_on(metric):
            return [CommandRequest(drive=drive, verb="stop", arguments=dict(order.fixed), id=_id(payload))]
    said = {each.name: each for each in metrics}
    session = said.pop(SESSION, None)
    word = "" if session is None else str(typed(session, DataType.STRING).value or "")
    wanted = [
        command
        for number, metric in enumerate(said.values())
        if (command := _command(metric, payload, drive, number, word)) is not None
    ]
    if wanted and payload.time_ms is None:
        raise NotAllowedError("the message has no timestamp; a DCMD needs one")
    for each in wanted:
        if each.verb in _STARTS and not word:
            raise NotAllowedError(
                f"{each.verb} of {drive} needs {SESSION} in the same message, with what the birth of the edge node has "
                "as Properties/Session"
            )
    return wanted


def _command(metric: Metric, payload: Payload, drive: str, number: int, session: str) -> CommandRequest | None:
    """Return the command in a metric; None for a released button."""
    order = ORDERS.get(metric.name)
    if order is None:
        raise UsageError(
            f"{metric.name[:100]!r} of {drive} cannot be written; {suggestion(metric.name[:100], ORDERS, 'there are')}"
        )
    if metric.type is not None:
        # A value that contradicts its own type is refused.
        metric = typed(metric, metric.type)
    value = typed(_number(metric, order.type), order.type).value
    if value is None or (isinstance(value, float) and not isfinite(value)):
        raise UsageError(f"{metric.name} of {drive} needs a value")
    if order.argument:
        given = {**order.fixed, order.argument: value}
    elif value:
        given = dict(order.fixed)
    else:
        return None
    return CommandRequest(
        drive=drive,
        verb=order.verb,
        arguments=given,
        id=f"{_id(payload)}-{number}",
        issued_s=None if payload.time_ms is None else payload.time_ms / 1000,
        valid_s=VALID_S,
        session=session,
    )


def _is_on(metric: Metric) -> bool:
    """Whether a button is pressed; some hosts send 1 for true."""
    return not isinstance(metric.value, str) and bool(metric.value)


def _number(metric: Metric, wanted: DataType) -> Metric:
    """Return a metric with a number of the type in the birth: hosts send integers for doubles."""
    if wanted is DataType.DOUBLE and isinstance(metric.value, int) and not isinstance(metric.value, bool):
        return Metric(name=metric.name, value=float(metric.value))
    return Metric(name=metric.name, value=metric.value)


def _id(payload: Payload) -> str:
    """Return an id that identifies repetitions of a message: its uuid, or a hash of its content."""
    if payload.uuid:
        return payload.uuid[:100]
    return hashlib.sha256(repr(payload).encode()).hexdigest()[:32]


def is_start(command: CommandRequest) -> bool:
    """Whether a command can make a motor turn."""
    return command.verb in _STARTS


def verbs_allowed(may: Iterable[str]) -> set[str]:
    """Return the verbs to offer from those permitted to a caller: commands and stops."""
    return {verb for verb in may if verb == "stop" or NEEDS[verb].commands}
