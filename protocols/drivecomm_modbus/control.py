"""How drives of a series are commanded: the table [control] of their model, and nothing in Python.

A command is a list of steps, each `[address, value]` or `[address, value, mask]`: the master writes the value; a
virtual drive looks at the bits of the mask only. A condition of `status` is `[address, mask, value]`, or a list of
values: it holds when the register, masked, is one of them.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

from drivecomm.errors import UsageError
from drivecomm.profiles import Condition, ControlProfile, Refusal, State, Step
from drivecomm.protocol import DriveState, Stop
from drivecomm_modbus.functions import EXCEPTIONS
from drivecomm_modbus.parameters import Place, place_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.protocol import Model
    from drivecomm_modbus.options import ModbusOptions

_STOPS = {"stop": Stop.RAMP, "coast": Stop.COAST, "quick": Stop.QUICK, "dc_brake": Stop.DC_BRAKE}
_STORING = ("store_before", "store_after", "volatile_before")
_STEPS = ("start", "start_reverse", *_STOPS, "reset", *_STORING)
CONDITIONS = (
    "running", "started", "fault", "ready", "stopping", "warning", "at_reference", "reverse", "remote", "always",
)  # fmt: skip
_PLAIN = (
    "fault_code", "reference_hz", "reference_percent", "needs", "plain_write", "volatile_offset", "identity",
    "identification",
)  # fmt: skip
KEYS = frozenset({*_STEPS, *_PLAIN, "status", "start_pause_s", "exceptions", "probe"})
_FIRST_REGISTER = Place("", 0)
TRIPPED = "tripped"
"""The place where the master notes whether the drive has a fault, by its status or by the code of the fault."""

_IS_TRIPPED = Condition(place=TRIPPED, mask=1, values=(1,))


@dataclass(frozen=True, slots=True, kw_only=True)
class Control:
    """The table [control] of a model; the README of the package explains each key."""

    profile: ControlProfile = field(default_factory=lambda: ControlProfile(name=""))
    storing: Mapping[str, tuple[Step, ...]] = field(default_factory=dict)
    status: Mapping[str, Condition] = field(default_factory=dict)
    fault_code: str = ""
    reference_hz: str = ""
    reference_percent: str = ""
    needs: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    plain_write: Literal["", "stored", "volatile"] = ""
    volatile_offset: int = 0
    exceptions: Mapping[int, str] = field(default_factory=lambda: EXCEPTIONS)
    probe: Place = _FIRST_REGISTER
    identity: Mapping[str, str] = field(default_factory=dict)
    identification: int | None = None

    @property
    def can_store(self) -> bool:
        """Whether a write can be kept in EEPROM."""
        return self.plain_write == "stored" or not self.storing.keys().isdisjoint(("store_before", "store_after"))

    @property
    def can_keep_volatile(self) -> bool:
        """Whether a write can be kept out of EEPROM."""
        return self.plain_write == "volatile" or "volatile_before" in self.storing or self.volatile_offset > 0


def control_of(model: Model | None, options: ModbusOptions) -> Control:
    """Return how drives of a model are commanded; not at all without one. Raises UsageError for a wrong table."""
    if model is None:
        return Control()
    given = model.control
    steps = {name: tuple(_step(name, each, options) for each in given[name]) for name in _STEPS if name in given}
    status = {name: _condition(name, each, options) for name, each in given.get("status", {}).items()}
    if strange := sorted(set(status) - set(CONDITIONS)):
        raise UsageError(f"[control] status: unknown key {strange[0]!r}; it has {', '.join(CONDITIONS)}")
    for key in ("fault_code", "reference_hz", "reference_percent"):
        if key in given and model.find(given[key]) is None:
            raise UsageError(f"[control] {key}: {given[key]!r} is no parameter of the model")
    first = Place.named(next(iter(status.values())).place) if status else _FIRST_REGISTER
    return Control(
        profile=_profile(model.name, steps, status, given.get("start_pause_s", 0.0)),
        storing={name: steps[name] for name in _STORING if name in steps},
        status=status,
        probe=place_of(given["probe"], options) if "probe" in given else first,
        exceptions={**EXCEPTIONS, **{int(code): text for code, text in given.get("exceptions", {}).items()}},
        **{key: given[key] for key in _PLAIN if key in given},
    )


def _profile(
    name: str, steps: Mapping[str, tuple[Step, ...]], status: Mapping[str, Condition], pause_s: float
) -> ControlProfile:
    always = Condition(place=TRIPPED, mask=0, values=(0,))
    states = {
        "fault": (_IS_TRIPPED, DriveState.FAULT),
        "stopping": (status.get("stopping"), DriveState.STOPPING),
        "running": (status.get("running"), DriveState.RUNNING),
        "ready": (status.get("ready", always), DriveState.READY),
    }
    # Started is what the drive says of itself as soon as it obeys, where that is more than that its motor turns.
    obeyed = [status[each] for each in ("started", "running") if each in status][:1]

    def start(steps: tuple[Step, ...]) -> tuple[Step, ...]:
        spaced = (*steps[:1], *(replace(step, pause_s=pause_s) for step in steps[1:]))
        return (*spaced[:-1], *(replace(step, until=tuple(obeyed)) for step in spaced[-1:]))

    return ControlProfile(
        name=name,
        start=start(steps.get("start", ())),
        start_reverse=start(steps.get("start_reverse", ())),
        stops={how: steps[key] for key, how in _STOPS.items() if key in steps},
        reset=steps.get("reset", ()),
        refusals=(Refusal(when=(_IS_TRIPPED,), say="the drive has a fault{code} and cannot start; reset it first"),)
        if status
        else (),
        states=tuple(State(name=each, known_by=by, means=means) for each, (by, means) in states.items() if by),
        bits={**{each: (by,) for each, by in status.items() if each != "always"}, "fault": (_IS_TRIPPED,)},
    )


def _step(name: str, given: Any, options: ModbusOptions) -> Step:
    if not isinstance(given, tuple) or len(given) not in (2, 3) or any(type(each) is not int for each in given[1:]):
        raise UsageError(f"[control] {name}: a step is [address, value] or [address, value, mask], not {given!r}")
    place = place_of(given[0], options)
    return Step(place=place.name, word=given[1], mask=given[2] if len(given) == 3 else 0xFFFF)


def _condition(name: str, given: Any, options: ModbusOptions) -> Condition:
    if not isinstance(given, tuple) or len(given) != 3 or type(given[1]) is not int:
        raise UsageError(f"[control] status, {name}: a condition is [address, mask, value], not {given!r}")
    values = given[2] if isinstance(given[2], tuple) else (given[2],)
    place = place_of(given[0], options)
    _, shift = place.bits
    return Condition(place=place.name, mask=given[1] << shift, values=tuple(each << shift for each in values))
