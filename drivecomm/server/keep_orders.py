"""How a motor is to be kept: what a command says of it, and what the plant file says where the command does not."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from drivecomm.errors import UsageError
from drivecomm.server.callers import LOCAL

if TYPE_CHECKING:
    from drivecomm.protocol import DriveConfig, LinkLoss
    from drivecomm.server.callers import Caller
    from drivecomm.server.door import Command


@dataclass(frozen=True, slots=True, kw_only=True)
class KeepOrder:
    """How a motor is to be started and kept. watchdog_s: of the drive's own watchdog. percent, hz: set before."""

    policy: LinkLoss
    watchdog_s: Any = 5
    reverse: bool = False
    percent: Any = None
    hz: Any = None


def kept_if_remote(caller: Caller, command: Command) -> Command:
    """Return a command; a start from a network is one that is kept, by the policy that the plant file says."""
    if caller.door == LOCAL or command.verb not in ("start", "reverse"):
        return command
    reverse = command.verb == "reverse" or bool(command.arguments.get("reverse"))
    return replace(command, verb="keep", arguments={**command.arguments, "reverse": reverse})


def keep_order(command: Command, config: DriveConfig) -> KeepOrder | None:
    """Return how a motor is to be kept by a command, None for one that keeps none. Raises UsageError."""
    given = dict(command.arguments)
    if command.verb != "keep":
        return None
    said = config.link_loss
    policy = given.pop("policy", None) or (said.policy if said else None)
    if policy is None:
        raise UsageError(
            f"no motor is started without saying what it does when its commander falls silent; write link_loss of "
            f"{config.name} into the plant file, or give policy"
        )
    usual_s: Any = said.watchdog_s if said and said.policy == policy else 5
    unknown = given.keys() - {"watchdog_s", "reverse", "percent", "hz"}
    if unknown:
        raise UsageError(f"keep has no argument {min(unknown)!r}; it has policy, watchdog_s, reverse, percent and hz")
    return KeepOrder(policy=policy, **{"watchdog_s": usual_s, **given})
