"""Rights of callers: their role, what the drive permits their door, and whether the drive is armed.

Reading needs only a role. A stop needs only a known caller.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivecomm.errors import NotAllowedError, ReadOnlyError, UsageError, shortened, suggestion
from drivecomm.server.callers import ANONYMOUS, LOCAL, Role
from drivecomm.server.keep_settings import why_looser

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.protocol import DriveConfig
    from drivecomm.server.callers import Caller
    from drivecomm.server.door import CommandRequest


@dataclass(frozen=True, slots=True)
class Needs:
    """The requirements of a verb.

    network: the word by which a plant file permits it to a door, empty if it cannot be permitted.
    """

    role: Role
    commands: bool = True
    network: str = ""


NEEDS = {
    **dict.fromkeys(
        (
            "read",
            "read_many",
            "polled",
            "polled_many",
            "status",
            "polled_status",
            "wait",
            "identify",
            "probe",
            "read_watchdog",
        ),
        Needs(Role.VIEW, commands=False),
    ),
    "start": Needs(Role.OPERATE, network="start"),
    "keep": Needs(Role.OPERATE, network="start"),
    "reverse": Needs(Role.OPERATE, network="reverse"),
    "reset": Needs(Role.OPERATE, network="reset"),
    "set_reference": Needs(Role.OPERATE, network="reference"),
    "jog": Needs(Role.OPERATE, network="jog"),
    "hold": Needs(Role.OPERATE, network="hold"),
    "select_setup": Needs(Role.OPERATE, network="select_setup"),
    "select_preset": Needs(Role.OPERATE, network="select_preset"),
    "set_relay": Needs(Role.OPERATE, network="set_relay"),
    "write": Needs(Role.COMMISSION, network="write"),
    "write_and_read": Needs(Role.COMMISSION, network="write"),
    "call": Needs(Role.COMMISSION, network="write"),
    "set_watchdog": Needs(Role.COMMISSION),
    "stop": Needs(Role.VIEW, commands=False),
}
"""The requirements of each verb; commands: also an armed drive, a lease, and a record in the audit."""

MOTOR_VERBS = frozenset(verb for verb, needs in NEEDS.items() if needs.network not in ("", "write"))
"""Verbs that command a motor, without those that write parameters or only stop it."""


@dataclass(frozen=True, slots=True)
class Rights:
    """The rights check of a plant. plant_file, users_file: named in refusals, as the files in which to permit more."""

    plant_file: str = "the plant file"
    users_file: str = "the users file"

    def check(self, caller: Caller, command: CommandRequest, drive: DriveConfig) -> None:
        """Raise NotAllowedError or ReadOnlyError unless the caller may give this command.

        Raises UsageError for an unknown verb.
        """
        if command.verb not in NEEDS:
            raise UsageError(f"unknown verb {shortened(command.verb)}; {suggestion(command.verb, NEEDS, 'use')}")
        self._check_role(caller, command.verb, drive.name)
        if caller.door != LOCAL:
            self._check_said(command)
        if command.verb == "stop" or not NEEDS[command.verb].commands:
            return
        if command.line:
            raise ReadOnlyError(
                f"{self.plant_file} has no {command.drive} on line {command.line}, so it can only be read and stopped; "
                "write a [[drive]] there"
            )
        if caller.door != LOCAL:
            self._check_network(caller, command, drive)
        # A verb of a protocol's own may be a read; if it is not, an unarmed drive refuses its telegrams.
        if not command.arm and not (caller.door == LOCAL and command.verb == "call"):
            self._check_armed(drive)

    def check_stored(self, caller: Caller, drive: DriveConfig, parameter: str) -> None:
        """Raise NotAllowedError for a stored write over a network, because EEPROM cells wear out."""
        if caller.door != LOCAL:
            raise NotAllowedError(
                f"{parameter} of {drive.name} cannot be stored over a network, because EEPROM cells wear out; "
                "store it by a program on the server's machine"
            )

    def verbs_for(self, caller: Caller, drive: DriveConfig) -> list[str]:
        """Return the verbs that this caller may use on this drive; write and call may be limited to some parameters."""
        return [verb for verb in NEEDS if self._may(caller, verb, drive)]

    def _may(self, caller: Caller, verb: str, drive: DriveConfig) -> bool:
        try:
            self._check_role(caller, verb, drive.name)
            if NEEDS[verb].commands:
                self._check_armed(drive)
        except (NotAllowedError, ReadOnlyError):
            return False
        if caller.door == LOCAL or not NEEDS[verb].commands:
            return True
        word, network = NEEDS[verb].network, drive.network
        return bool(network.write) if word == "write" else word in network.verbs.get(caller.door_kind, ())

    def _check_role(self, caller: Caller, verb: str, drive: str) -> None:
        role = NEEDS[verb].role
        if verb == "stop" and caller.name == ANONYMOUS and caller.door != LOCAL:
            raise NotAllowedError(f"{drive} is stopped only for known users; log in, or send a token")
        if caller.role >= role:
            return
        if caller.role is Role.NOBODY:
            raise NotAllowedError(f"{verb} of {drive} is only for known users; log in, or send a token")
        raise NotAllowedError(
            f"{caller.name} has the role {caller.role.name.lower()}, and {verb} of {drive} needs {role.name.lower()}; "
            f'write role = "{role.name.lower()}" in {self.users_file}'
        )

    def _check_said(self, command: CommandRequest) -> None:
        armed = command.arm and command.verb != "stop"
        given = (("line", command.line), ("options", command.options), ("arm", armed))
        for what, said in (*given, ("by", command.arguments.get("by"))):
            if said:
                raise NotAllowedError(f"{what} is only for programs on the server's machine; leave it out")

    def _check_armed(self, drive: DriveConfig) -> None:
        if reason := drive.read_only_reason or drive.why_read_only(self.plant_file):
            raise ReadOnlyError(reason)

    def _check_network(self, caller: Caller, command: CommandRequest, drive: DriveConfig) -> None:
        word, given = NEEDS[command.verb].network, command.arguments
        if not word:
            raise NotAllowedError(f"{command.verb} is only for programs on the server's machine")
        if given.get("store"):
            self.check_stored(caller, drive, shortened(given.get("parameter", command.verb)))
        if word == "write":
            key, allowed = "write", drive.network.write
            wanted = [given.get("verb" if command.verb == "call" else "parameter")]
        else:
            key, allowed = caller.door_kind, drive.network.verbs.get(caller.door_kind, ())
            # A negative reference reverses the motor, too.
            backwards = (word == "start" and given.get("reverse")) or any(map(_is_negative, _references(given)))
            wanted = [word, "reverse"] if backwards else [word]
        for each in wanted:
            if each not in allowed:
                raise NotAllowedError(
                    f"{self.plant_file} does not allow {command.verb} of {drive.name} over {caller.door_kind}; "
                    f"to allow it, add {shortened(each)} to network = {{ {key} = [...] }} of this drive there"
                )
        self._check_link_loss(caller, command, drive)

    def _check_link_loss(self, caller: Caller, command: CommandRequest, drive: DriveConfig) -> None:
        """Raise NotAllowedError if a start from a network has a looser link-loss policy than the plant file."""
        given, said = command.arguments, drive.link_loss
        if looser := why_looser(given.get("policy"), given.get("watchdog_s"), said):
            allowed = (
                "has no link_loss for it, which allows trip, ramp or coast within 5 s; write the policy into link_loss "
                "of this drive there to allow it"
                if said is None
                else f'allows policy = "{said.policy}" within {said.watchdog_s:g} s or less'
            )
            raise NotAllowedError(
                f"{command.verb} of {drive.name} over {caller.door_kind} asks for {looser}; {self.plant_file} {allowed}"
            )


def _references(given: Mapping[str, Any]) -> list[Any]:
    return [given[unit] for unit in ("percent", "hz", "rpm", "machine") if unit in given]


def _is_negative(value: object) -> bool:
    """Return whether a reference, as a number or as text, is below zero."""
    return str(value).strip().startswith("-") and any(digit in str(value) for digit in "123456789")
