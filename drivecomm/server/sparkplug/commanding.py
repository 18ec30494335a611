"""What hosts may command: the metrics for it, and what a message with them asks for.

Sparkplug carries neither a lease nor a session, and most hosts write one metric at a time. So a command counts only
with the time at which its message was sent, and a start, which somebody must answer for, only with the server's session
in the same message. What a drive does is told by its status alone, never by these metrics: they have no value.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from math import isfinite
from typing import TYPE_CHECKING, Any

from drivecomm.errors import NotAllowedError, UsageError, meant
from drivecomm.server import NEEDS, Command
from drivecomm.server.sparkplug.payload import DataType, Metric, typed

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping, Sequence

    from drivecomm.server.sparkplug.payload import Payload

FOLDER = "Command/"
SESSION = f"{FOLDER}Session"
"""Goes with a start: the word that the birth of the edge node has as Properties/Session."""

VALID_S = 2.0
"""A command is carried out within so many seconds after its message was sent, by its own time, or not at all."""

_STARTS = frozenset({"start", "reverse", "jog"})
"""What lets a motor turn."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Order:
    """A metric by which something is commanded. argument: what its value is, empty where it is only true."""

    verb: str
    type: DataType = DataType.BOOLEAN
    argument: str = ""
    fixed: Mapping[str, Any] = field(default_factory=dict, hash=False)


ORDERS: Mapping[str, Order] = {
    f"{FOLDER}Stop": Order(verb="stop"),
    f"{FOLDER}Stop Coast": Order(verb="stop", fixed={"how": "coast"}),
    f"{FOLDER}Stop Quick": Order(verb="stop", fixed={"how": "quick"}),
    f"{FOLDER}Reset": Order(verb="reset"),
    f"{FOLDER}Hold": Order(verb="hold"),
    f"{FOLDER}Reference Percent": Order(verb="set_reference", type=DataType.DOUBLE, argument="percent"),
    f"{FOLDER}Reference Hertz": Order(verb="set_reference", type=DataType.DOUBLE, argument="hz"),
    f"{FOLDER}Setup": Order(verb="select_setup", type=DataType.INT32, argument="number"),
    f"{FOLDER}Preset": Order(verb="select_preset", type=DataType.INT32, argument="number"),
    f"{FOLDER}Relay 1": Order(verb="set_relay", argument="on", fixed={"number": 1}),
    f"{FOLDER}Relay 2": Order(verb="set_relay", argument="on", fixed={"number": 2}),
    f"{FOLDER}Start": Order(verb="start"),
    f"{FOLDER}Start Reverse": Order(verb="reverse"),
}


def offered(verbs: Collection[str]) -> list[Metric]:
    """Return the metrics of what may be commanded, by the verbs that may be used; they have no value."""
    found = [Metric(name=name, type=order.type) for name, order in ORDERS.items() if order.verb in verbs]
    if any(order.verb in verbs and order.verb in _STARTS for order in ORDERS.values()):
        found.append(Metric(name=SESSION, type=DataType.STRING))
    return found


def commands_in(payload: Payload, metrics: Sequence[Metric], drive: str) -> list[Command]:
    """Return what a message wants of a drive, a stop first, and then nothing else.

    metrics: of the payload, with their names. Raises UsageError for what is no command, and NotAllowedError for one
    without what it must carry.
    """
    for metric in metrics:
        # Before anything else is looked at: what is wrong beside it keeps no stop from going out.
        order = ORDERS.get(metric.name)
        if order is not None and order.verb == "stop" and _is_on(metric):
            return [Command(drive=drive, verb="stop", arguments=dict(order.fixed), id=_id(payload))]
    said = {each.name: each for each in metrics}
    session = said.pop(SESSION, None)
    word = "" if session is None else str(typed(session, DataType.STRING).value or "")
    wanted = [
        command
        for number, metric in enumerate(said.values())
        if (command := _command(metric, payload, drive, number, word)) is not None
    ]
    if wanted and payload.time_ms is None:
        raise NotAllowedError("the message does not say when it was sent; a DCMD needs a timestamp")
    for each in wanted:
        if each.verb in _STARTS and not word:
            raise NotAllowedError(
                f"{each.verb} of {drive} needs {SESSION} in the same message, with what the birth of the edge node has "
                "as Properties/Session"
            )
    return wanted


def _command(metric: Metric, payload: Payload, drive: str, number: int, session: str) -> Command | None:
    """Return what one metric wants; None for a button that was let go, which is no command."""
    order = ORDERS.get(metric.name)
    if order is None:
        raise UsageError(
            f"{metric.name[:100]!r} of {drive} cannot be written; {meant(metric.name[:100], ORDERS, 'there are')}"
        )
    if metric.type is not None:
        # What contradicts itself commands nothing.
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
    return Command(
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
    """Return a metric with its number as the birth has it: hosts send whole ones where a double is wanted."""
    if wanted is DataType.DOUBLE and isinstance(metric.value, int) and not isinstance(metric.value, bool):
        return Metric(name=metric.name, value=float(metric.value))
    return Metric(name=metric.name, value=metric.value)


def _id(payload: Payload) -> str:
    """Return what a message is recognised by when it comes again: its uuid, or all that it says."""
    if payload.uuid:
        return payload.uuid[:100]
    return hashlib.sha256(repr(payload).encode()).hexdigest()[:32]


def is_start(command: Command) -> bool:
    """Whether a command may let a motor turn."""
    return command.verb in _STARTS


def verbs_allowed(may: Iterable[str]) -> set[str]:
    """Return the verbs that are offered of those that a caller may use: commands, and stops."""
    return {verb for verb in may if verb == "stop" or NEEDS[verb].commands}
