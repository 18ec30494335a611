"""Orders to keep a motor: how it is started and stopped, by the command or else by the plant file."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from drivecomm.bus import USUAL_WATCHDOG_S
from drivecomm.errors import NotAllowedError, UsageError, shortened
from drivecomm.protocol import exact
from drivecomm.server.callers import LOCAL

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.bus import AsyncDrive
    from drivecomm.protocol import DriveConfig, LinkLoss, LinkLossPolicy, Model, Value
    from drivecomm.server.callers import Caller
    from drivecomm.server.door import CommandRequest


_STARTED_BY = ("jog", "call", "write", "write_and_read")


@dataclass(frozen=True, slots=True, kw_only=True)
class KeepSettings:
    """An order to start and keep a motor.

    watchdog_s: time of the drive's own watchdog. percent, hz: reference to set before the start. by: the verb that
    starts the motor and its arguments, such as jog; None for a plain start. start: whether the server starts the motor;
    if not, its commander starts and stops it, under the lease.
    """

    policy: LinkLoss
    watchdog_s: Any = USUAL_WATCHDOG_S
    reverse: bool = False
    percent: Any = None
    hz: Any = None
    by: tuple[str, Mapping[str, Any]] | None = None
    start: bool = True


def keep_if_remote(caller: Caller, command: CommandRequest) -> CommandRequest:
    """Return a command, changed to `keep` if it starts a motor from a network.

    The motor is then kept by the policy of the plant file unless the command names one.
    """
    if caller.door == LOCAL or command.verb not in ("start", "reverse", "jog"):
        return command
    if command.verb == "jog":
        how = {name: value for name, value in command.arguments.items() if name in ("policy", "watchdog_s")}
        given = {name: value for name, value in command.arguments.items() if name not in how}
        return replace(command, verb="keep", arguments={**how, "by": {"verb": "jog", "arguments": given}})
    reverse = command.verb == "reverse" or bool(command.arguments.get("reverse"))
    return replace(command, verb="keep", arguments={**command.arguments, "reverse": reverse})


def keep_settings_of(command: CommandRequest, config: DriveConfig) -> KeepSettings | None:
    """Return the order of a `keep` command, or None for any other command. Raises UsageError."""
    given = dict(command.arguments)
    if command.verb != "keep":
        return None
    said = config.link_loss
    policy = given.pop("policy", None) or (said.policy if said else None)
    if policy is None:
        raise UsageError(
            f"no motor is started without a link-loss policy; write link_loss of "
            f"{config.name} into the plant file, or give policy"
        )
    usual_s: Any = said.watchdog_s if said and said.policy == policy else USUAL_WATCHDOG_S
    unknown = given.keys() - {"watchdog_s", "reverse", "percent", "hz", "by", "start"}
    if unknown:
        raise UsageError(
            f"keep has no argument {min(unknown)!r}; it has policy, watchdog_s, reverse, percent, hz, by, start"
        )
    if given.get("start") is False and (policy == "hold" or given.keys() & {"reverse", "percent", "hz", "by"}):
        raise UsageError("a motor that is kept without a start has no hold, reverse, percent, hz or by; leave them out")
    by = given.pop("by", None)
    return KeepSettings(
        policy=policy, by=None if by is None else _starting_call(by), **{"watchdog_s": usual_s, **given}
    )


def _starting_call(by: Any) -> tuple[str, Mapping[str, Any]]:
    """Return the verb that starts a motor, and its arguments. Raises UsageError for any other verb."""
    if not isinstance(by, dict) or by.get("verb") not in _STARTED_BY or not isinstance(by.get("arguments", {}), dict):
        raise UsageError(f"by is an object with verb, one of {', '.join(_STARTED_BY)}, and arguments")
    return by["verb"], by.get("arguments", {})


def check_kept(caller: Caller, command: CommandRequest, drive: AsyncDrive) -> None:
    """Raise NotAllowedError for a call or write from a network that would undermine the link-loss policy.

    Such a command may start the motor without keeping it, or write a parameter of the drive's own watchdog, which
    `link_loss` of the plant file sets. drive: knows which commands may start its motor; sends nothing.
    """
    if caller.door == LOCAL or command.verb not in ("call", "write", "write_and_read"):
        return
    parameter = command.arguments.get("parameter")
    if drive.model is not None and isinstance(parameter, str) and _is_of_watchdog(drive.model, parameter):
        raise NotAllowedError(
            f"{shortened(parameter)} of {command.drive} belongs to its watchdog, which link_loss of the plant file "
            "sets; it is written only by programs on the server's machine"
        )
    if drive.may_start(command.verb, **command.arguments):
        raise NotAllowedError(
            f"{command.verb} of {shortened(command.arguments.get('verb') or command.arguments.get('parameter'))} may "
            f"start the motor of {command.drive}; over a network start or jog does, which the server keeps in hand"
        )


def why_looser(policy: object, watchdog_s: Value | float | None, said: LinkLossPolicy | None) -> str:
    """Return why the link-loss policy of a start is looser than the plant file, as a clause; empty if it is not.

    policy, watchdog_s: policy and watchdog time of the start; None if left to the plant file. said: `link_loss` of the
    plant file, None if it has none.

    From loose to strict: hold, then a watchdog with a longer time, then one with a shorter time. The policies that stop
    the motor are equally strict, because it depends on the machine whether ramping or coasting is safer. So any policy
    other than that of the plant file is looser, unless the file says hold. Without link_loss a start may choose any
    policy that stops the motor, with the usual time or less. Raises UsageError if watchdog_s is not a number.
    """
    chosen = policy if policy is not None else said and said.policy
    if said is not None and said.policy == "hold":
        return ""
    if said is not None and chosen != said.policy:
        return f"the policy {shortened(chosen)} instead of {said.policy}"
    if chosen == "hold":
        return "the policy hold, which link_loss does not name"
    longest_s = exact(USUAL_WATCHDOG_S if said is None else said.watchdog_s, "watchdog time")
    if chosen is not None and watchdog_s is not None and exact(watchdog_s, "watchdog time") > longest_s:
        return f"a watchdog time of {watchdog_s} s, where {longest_s:g} s is the longest"
    return ""


def _is_of_watchdog(model: Model, parameter: str) -> bool:
    """Return whether a parameter, by address or name, with or without an index, belongs to the drive's watchdog."""
    if model.watchdog is None:
        return False
    named = model.quantities.get(parameter, parameter).partition("[")[0]
    info = model.find(named)
    own = {found.address for each in (model.watchdog.time, model.watchdog.action) if (found := model.find(each))}
    return (named if info is None else info.address) in own
