"""What is said of a drive before its line is open: in a plant file, on the command line, in a program."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import inf
from typing import TYPE_CHECKING, Any, TypeVar, cast, get_args

from drivecomm.errors import AddressError, UsageError, meant
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
"""Digits; Python makes no number of some thousands of them."""

_MAY_BE_ZERO = frozenset(["ramp_up_s", "ramp_down_s", "quick_ramp_s", "load", "ambient_c"])


@dataclass(frozen=True, slots=True, kw_only=True)
class PollGroup:
    """Parameters of a drive that are polled alike.

    parameters: by address or name. period_s: how often. priority: how important against others that are due. options:
    the protocol's own for reading, such as type="long".
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
    """What a drive's motor shall do when its master falls silent, and after how many seconds the drive notices."""

    policy: LinkLoss
    watchdog_s: float = 5.0

    def __post_init__(self) -> None:
        if self.policy not in get_args(LinkLoss):
            raise UsageError(f"unknown policy {self.policy!r}; {meant(self.policy, get_args(LinkLoss), 'use')}")
        if not 0 < self.watchdog_s < inf:
            raise UsageError(f"invalid watchdog_s = {self.watchdog_s:g}; write seconds above 0")


NETWORK_VERBS = (
    "start", "stop", "reset", "reverse", "reference", "jog", "hold", "select_setup", "select_preset", "set_relay",
)  # fmt: skip
"""What a plant file can allow the doors to a network, by the words that it uses; a stop they may give always."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NetworkAccess:
    """What may be done with a drive over a network; nothing but asking and stopping unless it is listed here.

    verbs: of `NETWORK_VERBS`, by the kind of door, such as "http". write: parameters that may be written, as they are
    named in the command, and verbs of the protocol's own that may be called.
    """

    verbs: Mapping[str, tuple[str, ...]] = field(default_factory=dict, hash=False)
    write: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if "local" in self.verbs:
            raise UsageError("programs of this machine need no list in network; leave local out")
        for door, verbs in self.verbs.items():
            for verb in verbs:
                if verb == "*":
                    raise UsageError(f"network has no wildcard; list each verb that {door} may use")
                if verb not in NETWORK_VERBS:
                    raise UsageError(f"unknown verb {verb!r} for {door}; {meant(verb, NETWORK_VERBS, 'use')}")
        for parameter in self.write:
            if not parameter or "*" in parameter:
                raise UsageError("network has no wildcard; list each parameter that may be written")


LONGEST_TAG = 200
"""Characters of the name or the group of a tag."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tag:
    """What supervisory systems call a polled value.

    name: unique in the plant; empty without one. group: where it belongs, such as "mixing/P101". deadband: by how much
    it must differ from the value that was published last, in its unit; None for what the door says.
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
    """A drive, and how it is used.

    protocol, address, options: as `Bus.drive` takes them; options are its model, line facts and the protocol's own.
    name: what people call it, PROTOCOL:ADDRESS if empty. line: the plant's name of its line, or its port; empty as long
    as nobody has said. title: what it is, for people. groups: names that stand for it and others; in other groups it
    is the same drive.

    For masters: armed: it may be written and commanded; otherwise it is read-only for all that takes it from a plant,
    except for stopping it. read_only_reason: why this master may not command it, empty where it may. confirmed: its
    parameters, by address or name, whose type, scale and unit a person has checked on this very drive. poll: what is
    polled of it. link_loss: what its motor does when its master falls silent. network: what may be done with it over a
    network where a server has such doors, if it is armed, too. tags: what supervisory systems call its values, by the
    names by which they are polled; with other tags it is the same drive. machine: what a hertz of it is at its machine.

    For virtual drives: reply_delay_s: from the end of a request to the begin of the reply; None for the usual delay.
    needs_pause_s: from the end of its reply to the next request; it does not hear one that begins sooner.
    values: what its parameters hold at the start, raw, by parameter address or name. motor: what differs from the
    drive's usual motor, by the names in `MOTOR_DATA`.
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
                raise UsageError(f"unknown motor data {key!r}; {meant(key, sorted(MOTOR_DATA), 'use')}")
            if value < 0 or (not value and key not in _MAY_BE_ZERO):
                raise UsageError(f"invalid motor data {key} = {value}; write a number above 0")

    def __str__(self) -> str:
        return f"{self.protocol}:{self.address}"

    @property
    def full_name(self) -> str:
        """The name, with PROTOCOL:ADDRESS where it says something else: pump (vabus:1)."""
        return self.name if self.name == str(self) else f"{self.name} ({self})"

    @property
    def labels(self) -> dict[str, str]:
        """How a JSON object names the drive that it is about."""
        return {"name": self.name, "drive": str(self), "line": self.line}

    def build(self, factory: Callable[..., T]) -> T:
        """Return what a factory, such as `bus.drive` or `virtual_drive`, makes of protocol, address and options."""
        options = {**self.options, CONFIRMED_FACTS: self.confirmed} if self.confirmed else self.options
        if self.machine is not None:
            options = {**options, "machine": self.machine}
        if not self.read_only_reason:
            return factory(self.protocol, self.address, **options)
        made: Any = factory(self.protocol, self.address, read_only=True, **options)
        made.read_only_reason = self.read_only_reason
        return cast("T", made)

    def with_options(self, **options: Any) -> DriveConfig:
        """Return the same with further options, which go before those that it has."""
        return replace(self, options={**self.options, **options})

    def why_read_only(self, file: str) -> str:
        """Return why masters may not write or command this drive, which this file says; empty where they may."""
        return "" if self.armed else f"{self.name} is read-only in {file}; write armed = true there"

    def fit(self, motor: Motor) -> None:
        """Give a motor what is said of this drive's."""
        for key, value in self.motor.items():
            setattr(motor, key, float(value))


def parse_drive(text: str) -> DriveConfig:
    """Read `vabus:1` or `danfoss-fc:3,model=fc101,baudrate=19200`. Raises UsageError."""
    drive, *options = text.split(",")
    protocol, colon, address = drive.partition(":")
    if not colon or not protocol:
        raise UsageError(f"{text!r} is not a drive; write PROTOCOL:ADDRESS, such as vabus:1")
    if not address.isascii() or not address.isdigit() or len(address) > _LONGEST_ADDRESS:
        raise AddressError(f"invalid address {address!r} in {text!r}; write PROTOCOL:ADDRESS, such as vabus:1")
    return DriveConfig(protocol=protocol, address=int(address), options=parse_options(options))


def parse_options(settings: Iterable[str]) -> dict[str, Any]:
    """Read `name=value` pairs: whole numbers (also 0x0F), decimals, true and false, or text. Raises UsageError."""
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
