"""A plant as data: which lines there are, which drives on them, and what goes wrong when.

`drivecomm.plant.files` reads one from a file; `drivecomm.virtual.virtual_plant` makes virtual drives of it. All times
are seconds of the plant's process, from its start.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from math import inf
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

from drivecomm.errors import UsageError, meant
from drivecomm.plant.line_faults import TRANSMISSION_FAULTS, Fault, FaultPlan
from drivecomm.protocol import LinkLoss

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from drivecomm.protocol import Motor

Of: TypeAlias = Literal["request", "reply", "reply to a read", "reply to a write", "reply to a command"]
"""Which telegrams a fault is for."""

PLATE = frozenset(
    {
        "rated_hz",
        "rated_v",
        "rated_a",
        "rated_kw",
        "rated_rpm",
        "maximum_hz",
        "ramp_up_s",
        "ramp_down_s",
        "quick_ramp_s",
        "coast_s",
        "dc_brake_s",
        "load",
        "mains_v",
        "ambient_c",
    }
)
"""What can be said of a motor: its name plate and what it drives, as `Motor` names them."""

LARGEST_CODE = 0xFFFF
"""Fault codes have 16 bits at most."""

_MAY_BE_ZERO = frozenset(["ramp_up_s", "ramp_down_s", "quick_ramp_s", "load", "ambient_c"])


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """What disturbs a line all the time, by chance; the fields are those of a `FaultPlan`."""

    rate: float
    seed: int = 0
    kinds: tuple[Fault, ...] = TRANSMISSION_FAULTS
    requests: bool = True
    replies: bool = True
    delay_s: float = 1.0
    bits: int = 8

    def __post_init__(self) -> None:
        _share(self.rate)
        _not_negative("delay_s", self.delay_s)
        if not self.kinds or Fault.FOREIGN in self.kinds:
            raise UsageError(f"kinds names no kind of noise; write one or more of {_names(_NOISE)}")
        if not 1 <= self.bits <= 8:
            raise UsageError(f"bits = {self.bits} is not between 1 and 8")

    def plan(self) -> FaultPlan:
        """Return a plan that begins with the seed."""
        return FaultPlan(**{each.name: getattr(self, each.name) for each in fields(self)})


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantLine:
    """A line.

    name: what the plant calls it. listen: where a master outside connects to its virtual drives, as `parse_listen`
    takes it; empty for nowhere. port: what a master opens to reach it, for commands that are masters; where it is
    empty, `reached_at` is the other end of `listen`. echo: the master hears itself. paced: characters take their time.
    settings: line facts for all its drives, such as baudrate=19200; a drive's own options go before. noise: what
    disturbs it all the time.
    """

    name: str
    listen: str = ""
    port: str = ""
    echo: bool = False
    paced: bool = True
    settings: Mapping[str, Any] = field(default_factory=dict, hash=False)
    noise: Noise | None = None

    def __post_init__(self) -> None:
        if not self.name:
            raise UsageError("a line needs a name")

    @property
    def opening(self) -> dict[str, Any]:
        """What is said of this line, as keywords of `open_bus`."""
        return {**self.settings, **({"echo": "expect"} if self.echo else {})}

    @property
    def reached_at(self) -> str:
        """What a master opens: the port, or where the line's virtual drives listen; empty when neither is known."""
        if self.port:
            return self.port
        kind, _, place = self.listen.partition(":")
        host, colon, number = place.rpartition(":")
        if kind == "pty":
            return place
        if kind not in ("tcp", "rfc2217") or number in ("", "0"):
            return ""
        scheme = "socket" if kind == "tcp" else kind
        return f"{scheme}://{host if colon and host else '127.0.0.1'}:{number}"


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantRead:
    """What is polled of a drive: parameters, by address or name, how often, and how important against others."""

    parameters: tuple[str, ...]
    period_s: float = 1.0
    priority: int = 0

    def __post_init__(self) -> None:
        if not self.parameters:
            raise UsageError('nothing to poll; write parameters = ["output_frequency"]')
        _not_negative("period_s", self.period_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantLinkLoss:
    """What a drive's motor shall do when its master falls silent, and after how many seconds the drive notices."""

    policy: LinkLoss
    watchdog_s: float = 5.0

    def __post_init__(self) -> None:
        if self.policy not in get_args(LinkLoss):
            known = meant(self.policy, get_args(LinkLoss), "write one of")
            raise UsageError(f"policy = {self.policy!r} is none; {known}")
        if not 0 < self.watchdog_s < inf:
            raise UsageError(f"watchdog_s = {self.watchdog_s:g} cannot be; write seconds above 0")


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantDrive:
    """A drive.

    protocol, address, options: as `Bus.drive` takes them. line: the name of its line. name: what the plant calls it,
    PROTOCOL:ADDRESS if empty. title: what it is, for people.

    For masters: armed: it may be written and commanded; otherwise it is read-only for all that takes it from the plant,
    except for stopping it. poll: what is polled of it. link_loss: what its motor does when its master falls silent.

    For virtual drives: values: what its parameters hold at the start, raw, by parameter address or name. motor: what
    differs from the drive's usual motor, by the names in `PLATE`.
    """

    protocol: str
    address: int
    line: str
    name: str = ""
    title: str = ""
    options: Mapping[str, Any] = field(default_factory=dict, hash=False)
    armed: bool = False
    poll: tuple[PlantRead, ...] = ()
    link_loss: PlantLinkLoss | None = None
    values: Mapping[str, int | str] = field(default_factory=dict, hash=False)
    motor: Mapping[str, float] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        if not self.name:
            object.__setattr__(self, "name", f"{self.protocol}:{self.address}")
        for key, value in self.motor.items():
            if key not in PLATE:
                raise UsageError(f"a motor has no {key!r}; {meant(key, sorted(PLATE), 'it has')}")
            if value < 0 or (not value and key not in _MAY_BE_ZERO):
                raise UsageError(f"a motor with {key} = {value} cannot be; write a number above 0")

    def why_read_only(self, file: str) -> str:
        """Return why masters may not write or command this drive, which this file says; empty where they may."""
        return "" if self.armed else f"{self.name} is read-only in {file}; write armed = true there"

    def fit(self, motor: Motor) -> None:
        """Give a motor what is said of this drive's."""
        for key, value in self.motor.items():
            setattr(motor, key, float(value))


@dataclass(frozen=True, slots=True, kw_only=True)
class Window:
    """The time in which something holds, from from_s up to until_s."""

    from_s: float = 0.0
    until_s: float = inf

    def __post_init__(self) -> None:
        if not 0 <= self.from_s < self.until_s:
            raise UsageError(f"from_s = {self.from_s:g} and until_s = {self.until_s:g} leave no time; let it end later")

    def holds(self, time_s: float) -> bool:
        """Whether this time is inside."""
        return self.from_s <= time_s < self.until_s


@dataclass(frozen=True, slots=True, kw_only=True)
class TelegramFault:
    """Telegrams on a line that are lost, changed, cut, late or doubled.

    line or drive: for all telegrams of a line, or for the replies of one drive. kind: what happens to them. of: which
    ones; None for all. to: fields that the request must have, for a reply to it, as `drivecomm decode` shows them.
    every: each so-manieth of these; rate: this share of them, by chance with the seed; neither: each one. delay_s: how
    late a delayed one is.
    """

    kind: Fault
    line: str = ""
    drive: str = ""
    of: Of | None = None
    to: Mapping[str, Any] = field(default_factory=dict, hash=False)
    every: int | None = None
    rate: float | None = None
    seed: int = 0
    delay_s: float = 1.0
    window: Window = field(default_factory=Window)

    def __post_init__(self) -> None:
        if bool(self.line) == bool(self.drive):
            raise UsageError("a fault of telegrams is of a line or of a drive; name one of them")
        if self.kind not in TRANSMISSION_FAULTS:
            raise UsageError(f"no telegram can be {self.kind.value!r}; write one of {_names(TRANSMISSION_FAULTS)}")
        if self.of is not None and self.of not in get_args(Of):
            raise UsageError(f"of = {self.of!r} names no telegrams; write one of {', '.join(get_args(Of))}")
        if self.drive and self.of == "request":
            raise UsageError("requests are disturbed for everybody on a line; name the line in place of the drive")
        if self.to and (self.of is None or not self.of.startswith("reply")):
            raise UsageError('to says which requests are answered; write of = "reply" with it')
        if self.every is not None and self.rate is not None:
            raise UsageError("every and rate exclude each other; write one of them")
        if self.every is not None and self.every < 1:
            raise UsageError(f"every = {self.every} is no number of telegrams; write 1 or more")
        if self.rate is not None:
            _share(self.rate)
        _not_negative("delay_s", self.delay_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class PowerCutStep:
    """A drive without power from off_at_s to back_at_s; for ever if that is None.

    factory: it comes back with its factory settings: those of its line, and all parameters of its model.
    """

    drive: str
    off_at_s: float
    back_at_s: float | None = None
    factory: bool = False

    def __post_init__(self) -> None:
        _not_negative("off_at_s", self.off_at_s)
        if self.back_at_s is not None and self.back_at_s <= self.off_at_s:
            raise UsageError(f"back_at_s = {self.back_at_s:g} is not after off_at_s = {self.off_at_s:g}")
        if self.factory and self.back_at_s is None:
            raise UsageError("a drive that does not come back has no factory settings; write back_at_s")


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """A parameter's value, as a master reads it, above or below a limit for some time without a break."""

    parameter: str
    above: float = inf
    below: float = -inf
    for_s: float = 0.0

    def __post_init__(self) -> None:
        if (self.above == inf) == (self.below == -inf):
            raise UsageError("a condition says above or below; write one of them")
        _not_negative("for_s", self.for_s)

    def met_by(self, value: float) -> bool:
        """Whether the value is beyond the limit."""
        return value > self.above or value < self.below


@dataclass(frozen=True, slots=True, kw_only=True)
class TripStep:
    """A drive trips with a fault code: at a time, or each time a condition begins to be true."""

    drive: str
    code: int
    at_s: float | None = None
    when: Condition | None = None

    def __post_init__(self) -> None:
        if not 1 <= self.code <= LARGEST_CODE:
            raise UsageError(
                f"a trip with fault code {str(self.code)[:12]} cannot be; write a number from 1 to {LARGEST_CODE}"
            )
        if (self.at_s is None) == (self.when is None):
            raise UsageError("a trip comes at_s or when; write one of them")
        if self.at_s is not None:
            _not_negative("at_s", self.at_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class StuckStep:
    """A drive that answers reads of a parameter with the same value, whatever it holds or measures.

    value: a number as a master reads it, or a text as its `Reading.raw` is.
    """

    drive: str
    parameter: str
    value: float | str
    window: Window = field(default_factory=Window)


@dataclass(frozen=True, slots=True, kw_only=True)
class InjectStep:
    """Bytes that nobody on the line has sent: noise, or the telegram of somebody else."""

    line: str
    data: bytes
    at_s: float

    def __post_init__(self) -> None:
        _not_negative("at_s", self.at_s)
        if not self.data:
            raise UsageError("no bytes to inject")


Step: TypeAlias = TelegramFault | PowerCutStep | TripStep | StuckStep | InjectStep
"""What goes wrong on a plant, once or for a time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Plant:
    """Lines, drives, and the script of faults. Names are unique, and everything named is there."""

    lines: tuple[PlantLine, ...]
    drives: tuple[PlantDrive, ...] = ()
    script: tuple[Step, ...] = ()

    def __post_init__(self) -> None:
        if not self.lines:
            raise UsageError("a plant needs at least one line")
        lines = _unique("lines", [line.name for line in self.lines])
        drives = _unique("drives", [drive.name for drive in self.drives])
        for drive in self.drives:
            _there(drive.line, lines, "line", f"drive {drive.name}")
        for number, step in enumerate(self.script, start=1):
            named = getattr(step, "line", "")
            if named:
                _there(named, lines, "line", f"fault {number}")
            else:
                _there(getattr(step, "drive", ""), drives, "drive", f"fault {number}")

    def drive(self, name: str) -> PlantDrive:
        """Return a drive by its name, or by PROTOCOL:ADDRESS where that is one drive only. Raises UsageError."""
        for drive in self.drives:
            if drive.name == name:
                return drive
        same = [drive for drive in self.drives if f"{drive.protocol}:{drive.address}" == name]
        if len(same) > 1:
            names = " and ".join(drive.name for drive in same)
            raise UsageError(f"{name} is on several lines of this plant; name the drive: {names}")
        if not same:
            known = meant(name, [drive.name for drive in self.drives], "it has")
            raise UsageError(f"there is no drive {name!r} in this plant; {known}")
        return same[0]

    def line(self, name: str) -> PlantLine:
        """Return a line by its name. Raises UsageError."""
        for line in self.lines:
            if line.name == name:
                return line
        known = meant(name, [line.name for line in self.lines], "it has")
        raise UsageError(f"there is no line {name!r} in this plant; {known}")

    def on_line(self, name: str) -> tuple[PlantDrive, ...]:
        """Return the drives of a line, in their order."""
        return tuple(drive for drive in self.drives if drive.line == name)


def kind_named(name: str) -> Fault:
    """Return the kind of fault with this name, such as drop. Raises UsageError."""
    try:
        return Fault(name)
    except ValueError:
        known = meant(name, [kind.value for kind in _NOISE], "write one of")
        raise UsageError(f"{name!r} is no kind of fault; {known}") from None


# Foreign traffic needs bytes, which a script says with inject.
_NOISE = tuple(kind for kind in Fault if kind is not Fault.FOREIGN)


def _names(kinds: Iterable[Fault]) -> str:
    return ", ".join(kind.value for kind in kinds)


def _share(rate: float) -> None:
    if not 0 <= rate <= 1:
        raise UsageError(f"rate = {rate:g} is no share; write a number from 0 to 1")


def _not_negative(key: str, seconds: float) -> None:
    if not 0 <= seconds < inf:
        raise UsageError(f"{key} = {seconds:g} cannot be; write seconds, 0 or more")


def _unique(what: str, names: list[str]) -> frozenset[str]:
    for name in names:
        if names.count(name) > 1:
            raise UsageError(f"two {what} are named {name!r}; give each a name of its own")
    return frozenset(names)


def _there(name: str, names: frozenset[str], what: str, where: str) -> None:
    if name not in names:
        raise UsageError(f"{where}: there is no {what} {name!r} in this plant; {meant(name, sorted(names), 'it has')}")
