"""Configuration of a drive before its line is open: from a plant file, the command line or a program."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import inf
from typing import TYPE_CHECKING, Any, TypeVar, cast, get_args

from drivecomm.errors import AddressError, UsageError, suggestion
from drivecomm.protocol.argument_types import is_duration
from drivecomm.protocol.model import LinkLoss
from drivecomm.protocol.motor import MOTOR_DATA
from drivecomm.protocol.options import CONFIRMED_FACTS
from drivecomm.protocol.reading import is_plain

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from drivecomm.protocol.machine_unit import MachineUnit
    from drivecomm.protocol.motor import Motor

LONGEST_DELAY_S = 60.0
"""The longest reply delay of a drive, in seconds."""

_LONGEST_ADDRESS = 9
"""Maximum digits of an address; Python refuses to convert a text of some thousands of digits."""

_MAY_BE_ZERO = frozenset(["ramp_up_s", "ramp_down_s", "quick_ramp_s", "load", "ambient_c"])


@dataclass(frozen=True, slots=True, kw_only=True)
class PollGroup:
    """Parameters of a drive that are polled with the same period, priority and options.

    parameters: by address or name. period_s: seconds from one poll to the next. priority: rank among the parameters
    that are due. options: the protocol's own options for reading, such as type="long".
    """

    parameters: tuple[str, ...]
    period_s: float = 1.0
    priority: int = 0
    options: Mapping[str, Any] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        if not self.parameters or not all(self.parameters):
            raise UsageError('nothing to poll; write parameters = ["output_frequency"]')
        if not is_duration(self.period_s):
            raise UsageError(f"invalid period_s = {self.period_s:g}; write seconds, 0 or more")


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkLossPolicy:
    """Reaction of a motor to a silent master, and the number of seconds after which its drive notices the silence."""

    policy: LinkLoss
    watchdog_s: float = 5.0

    def __post_init__(self) -> None:
        if self.policy not in get_args(LinkLoss):
            raise UsageError(f"unknown policy {self.policy!r}; {suggestion(self.policy, get_args(LinkLoss), 'use')}")
        if not 0 < self.watchdog_s < inf:
            raise UsageError(f"invalid watchdog_s = {self.watchdog_s:g}; write seconds above 0")


NETWORK_VERBS = (
    "start", "stop", "reset", "reverse", "reference", "jog", "hold", "select_setup", "select_preset", "set_relay",
)  # fmt: skip
"""Verbs that a plant file can allow to network doors, in the words of the file; stops are always allowed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NetworkAccess:
    """Operations that are allowed on a drive over a network, in addition to reading and stopping.

    verbs: words of `NETWORK_VERBS`, by the kind of door, such as "http". write: parameters that may be written, by the
    names that the command uses, and verbs of the protocol's own that may be called.
    """

    verbs: Mapping[str, tuple[str, ...]] = field(default_factory=dict, hash=False)
    write: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if "local" in self.verbs:
            raise UsageError("programs on this machine need no network list; leave local out")
        for door, verbs in self.verbs.items():
            for verb in verbs:
                if verb == "*":
                    raise UsageError(f"network has no wildcard; list each verb that {door} may use")
                if verb not in NETWORK_VERBS:
                    raise UsageError(f"unknown verb {verb!r} for {door}; {suggestion(verb, NETWORK_VERBS, 'use')}")
        for parameter in self.write:
            if not parameter or "*" in parameter:
                raise UsageError("network has no wildcard; list each parameter that may be written")


LONGEST_TAG = 200
"""Longest name or group of a tag, in characters."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tag:
    """Identification of a polled value for supervisory systems.

    name: unique in the plant; empty if the value has none. group: the place of the value, such as "mixing/P101".
    deadband: the smallest change since the last published value that is published, in the value's unit; None for the
    default of the door.
    """

    name: str = ""
    group: str = ""
    deadband: float | None = None

    def __post_init__(self) -> None:
        for key in ("name", "group"):
            text = getattr(self, key)
            if not text.isprintable() or text != text.strip() or len(text) > LONGEST_TAG:
                raise UsageError(
                    f"invalid {key} {text!r:.80} of a tag; write up to {LONGEST_TAG} printable characters, without "
                    "spaces around them"
                )
        if self.deadband is not None and not 0 <= self.deadband < inf:
            raise UsageError(f"invalid deadband = {self.deadband:g}; write a number in the value's unit, 0 or more")


T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveConfig:
    """Configuration of one drive.

    protocol, address, options: as `Bus.drive` takes them; options are its model, line facts and the protocol's own
    options. name: for people, PROTOCOL:ADDRESS if empty. line: the plant's name of its line, or its port; empty while
    unknown. title: a description for people. groups: names that stand for this drive and others; a comparison of drives
    ignores them.

    For masters: armed: the drive may be written and commanded; otherwise every program that takes it from a plant
    treats it as read-only, except for stops. read_only_reason: why this master may not command it, empty if it may.
    confirmed: its parameters, by address or name, whose type, scale and unit a person has checked on this very drive.
    poll: its groups of polled parameters. link_loss: the reaction of its motor to a silent master. network: the
    operations that are allowed on it through the network doors of a server, if it is armed as well. tags: the tags of
    its values, by the names under which the values are polled; a comparison of drives ignores them. machine: its
    machine unit, with the scale per hertz.

    For virtual drives: reply_delay_s: from the end of a request to the beginning of the reply; None for the usual
    delay. needs_pause_s: from the end of its reply to the next request; it does not receive a request that begins
    sooner. values: raw start values, by parameter address or name. motor: differences from the drive's usual motor, by
    the names in `MOTOR_DATA`.
    """

    protocol: str
    address: int
    name: str = ""
    line: str = ""
    title: str = ""
    groups: tuple[str, ...] = field(default=(), compare=False)
    options: Mapping[str, Any] = field(default_factory=dict, hash=False)
    armed: bool = False
    read_only_reason: str = ""
    confirmed: tuple[str, ...] = ()
    poll: tuple[PollGroup, ...] = ()
    link_loss: LinkLossPolicy | None = None
    network: NetworkAccess = NetworkAccess()
    tags: Mapping[str, Tag] = field(default_factory=dict, compare=False)
    machine: MachineUnit | None = None
    reply_delay_s: float | None = None
    needs_pause_s: float = 0.0
    values: Mapping[str, int | str] = field(default_factory=dict, hash=False)
    motor: Mapping[str, float] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        if not self.name:
            object.__setattr__(self, "name", str(self))
        if self.reply_delay_s is not None and not 0 <= self.reply_delay_s < LONGEST_DELAY_S:
            raise UsageError(f"invalid reply_delay_s = {self.reply_delay_s:g}; write 0 to {LONGEST_DELAY_S:g} seconds")
        if not 0 <= self.needs_pause_s < LONGEST_DELAY_S:
            raise UsageError(f"invalid needs_pause_s = {self.needs_pause_s:g}; write 0 to {LONGEST_DELAY_S:g} seconds")
        for key, value in self.motor.items():
            if key not in MOTOR_DATA:
                raise UsageError(f"unknown motor data {key!r}; {suggestion(key, sorted(MOTOR_DATA), 'use')}")
            if value < 0 or (not value and key not in _MAY_BE_ZERO):
                raise UsageError(f"invalid motor data {key} = {value}; write a number above 0")

    def __str__(self) -> str:
        return f"{self.protocol}:{self.address}"

    @property
    def full_name(self) -> str:
        """The name, followed by PROTOCOL:ADDRESS if that is not the name: pump (vabus:1)."""
        return self.name if self.name == str(self) else f"{self.name} ({self})"

    @property
    def labels(self) -> dict[str, str]:
        """Keys that identify the drive in a JSON object."""
        return {"name": self.name, "drive": str(self), "line": self.line}

    def build(self, factory: Callable[..., T]) -> T:
        """Build the drive with a factory, such as `bus.drive` or `virtual_drive`."""
        options = {**self.options, CONFIRMED_FACTS: self.confirmed} if self.confirmed else self.options
        if self.machine is not None:
            options = {**options, "machine": self.machine}
        if not self.read_only_reason:
            return factory(self.protocol, self.address, **options)
        made: Any = factory(self.protocol, self.address, read_only=True, **options)
        made.read_only_reason = self.read_only_reason
        return cast("T", made)

    def with_options(self, **options: Any) -> DriveConfig:
        """Return a copy with further options, which override options of the same name."""
        return replace(self, options={**self.options, **options})

    def why_read_only(self, file: str) -> str:
        """Return the reason why masters may not write or command this drive; empty if they may.

        file: the plant file, for the text of the reason.
        """
        return "" if self.armed else f"{self.name} is read-only in {file}; write armed = true there"

    def fit(self, motor: Motor) -> None:
        """Set the configured data of this drive's motor on a motor."""
        for key, value in self.motor.items():
            setattr(motor, key, float(value))


def parse_drive(text: str) -> DriveConfig:
    """Parse a text such as `vabus:1` or `danfoss-fc:3,model=fc101,baudrate=19200`. Raises UsageError."""
    drive, *options = text.split(",")
    protocol, colon, address = drive.partition(":")
    if not colon or not protocol:
        raise UsageError(f"{text!r} is not a drive; write PROTOCOL:ADDRESS, such as vabus:1")
    if not address.isascii() or not address.isdigit() or len(address) > _LONGEST_ADDRESS:
        raise AddressError(f"invalid address {address!r} in {text!r}; write PROTOCOL:ADDRESS, such as vabus:1")
    return DriveConfig(protocol=protocol, address=int(address), options=parse_options(options))


def parse_options(settings: Iterable[str]) -> dict[str, Any]:
    """Parse `name=value` pairs into whole numbers (also 0x0F), decimals, booleans or text. Raises UsageError."""
    chosen = {}
    for setting in settings:
        name, equals, value = setting.partition("=")
        if not equals or not name:
            raise UsageError(f"{setting!r} is not an option; write NAME=VALUE")
        chosen[name.strip().replace("-", "_")] = _value(value.strip())
    return chosen


def _value(text: str) -> Any:
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    for kind in (lambda digits: int(digits, 0), float) if is_plain(text) else ():
        try:
            return kind(text)
        except ValueError:
            continue
    return text
