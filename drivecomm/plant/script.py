"""Faults in a plant of virtual drives, with their times: noise on lines, and a script of faults.

All times are seconds of the plant's process, from its start.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from math import inf
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

from drivecomm.errors import UsageError, suggestion
from drivecomm.plant.line_faults import TRANSMISSION_FAULTS, FaultPlan, LineFault

if TYPE_CHECKING:
    from collections.abc import Mapping

Of: TypeAlias = Literal["request", "reply", "reply to a read", "reply to a write", "reply to a command"]
"""Telegrams that a fault affects."""

LARGEST_CODE = 0xFFFF
"""Largest fault code; fault codes have up to 16 bits."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LineNoise:
    """Permanent random disturbance of a line; the fields are those of `FaultPlan`."""

    rate: float
    seed: int = 0
    kinds: tuple[LineFault, ...] = TRANSMISSION_FAULTS
    requests: bool = True
    replies: bool = True
    delay_s: float = 1.0
    bits: int = 8

    def __post_init__(self) -> None:
        _share(self.rate)
        _not_negative("delay_s", self.delay_s)
        if not self.kinds or LineFault.FOREIGN in self.kinds:
            raise UsageError(f"invalid kinds; write one or more of {', '.join(_NOISE)}")
        if not 1 <= self.bits <= 8:
            raise UsageError(f"bits = {self.bits} is not between 1 and 8")

    def plan(self) -> FaultPlan:
        """Return a new fault plan that starts from the seed."""
        return FaultPlan(**{each.name: getattr(self, each.name) for each in fields(self)})


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultWindow:
    """Time span in which a fault is active, from from_s up to until_s."""

    from_s: float = 0.0
    until_s: float = inf

    def __post_init__(self) -> None:
        if not 0 <= self.from_s < self.until_s:
            raise UsageError(f"until_s = {self.until_s:g} is not after from_s = {self.from_s:g}, or that is below 0")

    def holds(self, time_s: float) -> bool:
        """Return whether a time is within the span."""
        return self.from_s <= time_s < self.until_s


@dataclass(frozen=True, slots=True, kw_only=True)
class TelegramFault:
    """Telegrams on a line that are lost, changed, cut, late or doubled.

    line or drive: for all telegrams of a line, or for the replies of one drive. kind: kind of fault. of: telegrams that
    are affected; None for all. to: fields that the answered request must have, as `drivecomm decode` shows them. every:
    every n-th telegram; rate: a random share of them, by the seed; neither: all of them. delay_s: delay of a late
    telegram.
    """

    kind: LineFault
    line: str = ""
    drive: str = ""
    of: Of | None = None
    to: Mapping[str, Any] = field(default_factory=dict, hash=False)
    every: int | None = None
    rate: float | None = None
    seed: int = 0
    delay_s: float = 1.0
    window: FaultWindow = field(default_factory=FaultWindow)

    def __post_init__(self) -> None:
        if bool(self.line) == bool(self.drive):
            raise UsageError("a fault of telegrams needs either line or drive")
        if self.kind not in TRANSMISSION_FAULTS:
            known = ", ".join(kind.value for kind in TRANSMISSION_FAULTS)
            raise UsageError(f"invalid kind {self.kind.value!r} for telegrams; write one of {known}")
        if self.of is not None and self.of not in get_args(Of):
            raise UsageError(f"invalid of = {self.of!r}; write one of {', '.join(get_args(Of))}")
        if self.drive and self.of == "request":
            raise UsageError("requests are disturbed for all drives of a line; name the line in place of the drive")
        if self.to and (self.of is None or not self.of.startswith("reply")):
            raise UsageError('to says which requests are answered; write of = "reply" with it')
        if self.every is not None and self.rate is not None:
            raise UsageError("every and rate exclude each other; write one of them")
        if self.every is not None and self.every < 1:
            raise UsageError(f"invalid every = {self.every}; write 1 or more")
        if self.rate is not None:
            _share(self.rate)
        _not_negative("delay_s", self.delay_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class PowerCutStep:
    """Drive without power from off_at_s to back_at_s; forever if back_at_s is None.

    factory: whether the drive comes back with its factory settings, those of its line and all parameters of its model.
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
class TripCondition:
    """Value of a parameter, as a master reads it, above or below a limit for for_s seconds without a break."""

    parameter: str
    above: float = inf
    below: float = -inf
    for_s: float = 0.0

    def __post_init__(self) -> None:
        if (self.above == inf) == (self.below == -inf):
            raise UsageError("a condition says above or below; write one of them")
        _not_negative("for_s", self.for_s)

    def met_by(self, value: float) -> bool:
        """Return whether the value is beyond the limit."""
        return value > self.above or value < self.below


@dataclass(frozen=True, slots=True, kw_only=True)
class TripStep:
    """Trip of a drive with a fault code: at a time, or each time that a condition becomes true."""

    drive: str
    code: int
    at_s: float | None = None
    when: TripCondition | None = None

    def __post_init__(self) -> None:
        if not 1 <= self.code <= LARGEST_CODE:
            raise UsageError(f"invalid fault code {str(self.code)[:12]}; write a number from 1 to {LARGEST_CODE}")
        if (self.at_s is None) == (self.when is None):
            raise UsageError("a trip comes at_s or when; write one of them")
        if self.at_s is not None:
            _not_negative("at_s", self.at_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class StuckStep:
    """Drive that answers reads of a parameter with a fixed value, independent of its real value.

    value: a number as a master reads it, or a text in the form of `Reading.raw`.
    """

    drive: str
    parameter: str
    value: float | str
    window: FaultWindow = field(default_factory=FaultWindow)


@dataclass(frozen=True, slots=True, kw_only=True)
class InjectStep:
    """Bytes on the line that come from no known sender: noise, or a foreign telegram."""

    line: str
    data: bytes
    at_s: float

    def __post_init__(self) -> None:
        _not_negative("at_s", self.at_s)
        if not self.data:
            raise UsageError("no bytes to inject")


ScriptStep: TypeAlias = TelegramFault | PowerCutStep | TripStep | StuckStep | InjectStep
"""Fault of a plant, at one time or for a time span."""


def kind_named(name: str) -> LineFault:
    """Return the kind of fault with this name, such as drop. Raises UsageError."""
    try:
        return LineFault(name)
    except ValueError:
        known = suggestion(name, _NOISE, "write one of")
        raise UsageError(f"unknown kind of fault {name!r}; {known}") from None


# Foreign traffic needs bytes, which a script gives with `inject`.
_NOISE = tuple(kind.value for kind in LineFault if kind is not LineFault.FOREIGN)


def _share(rate: float) -> None:
    if not 0 <= rate <= 1:
        raise UsageError(f"invalid rate = {rate:g}; write a share from 0 to 1")


def _not_negative(key: str, seconds: float) -> None:
    if not 0 <= seconds < inf:
        raise UsageError(f"invalid {key} = {seconds:g}; write seconds, 0 or more")
