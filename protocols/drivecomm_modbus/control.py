"""How drives of a series are commanded: the table [control] of their model, and nothing in Python.

A command is a list of steps, each `[address, value]` or `[address, value, mask]`: the master writes the value; a
virtual drive looks at the bits of the mask only. A condition of `status` is `[address, mask, value]`, or a list of
values: it holds when the register, masked, is one of them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from drivecomm.errors import UsageError
from drivecomm.protocol import Stop
from drivecomm_modbus.functions import EXCEPTIONS
from drivecomm_modbus.parameters import Place, place_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.protocol import Model
    from drivecomm_modbus.options import ModbusOptions

STOPS = {"stop": Stop.RAMP, "coast": Stop.COAST, "quick": Stop.QUICK, "dc_brake": Stop.DC_BRAKE}
COMMANDS = ("start", "start_reverse", *STOPS, "reset")
_STEPS = (*COMMANDS, "store_before", "store_after", "volatile_before")
CONDITIONS = ("running", "fault", "ready", "stopping", "warning", "at_reference", "reverse", "remote", "always")
KEYS = frozenset({
    *_STEPS, "status", "fault_code", "reference_hz", "reference_percent", "start_pause_s", "needs", "plain_write",
    "volatile_offset", "exceptions", "probe", "identity", "identification",
})  # fmt: skip


_FIRST_REGISTER = Place("", 0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One write of a command."""

    place: Place
    value: int
    mask: int = 0xFFFF

    def holds(self, value: int) -> bool:
        """Whether a written value means this step."""
        return value & self.mask == self.value & self.mask


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """What a status register says."""

    place: Place
    mask: int
    values: tuple[int, ...]

    def holds(self, word: int) -> bool:
        """Whether a status word says so."""
        return word & self.mask in self.values


@dataclass(frozen=True, slots=True, kw_only=True)
class Control:
    """The table [control] of a model; the README of the package explains each key."""

    steps: Mapping[str, tuple[Step, ...]] = field(default_factory=dict)
    status: Mapping[str, Condition] = field(default_factory=dict)
    fault_code: str = ""
    reference_hz: str = ""
    reference_percent: str = ""
    start_pause_s: float = 0.0
    needs: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    plain_write: Literal["", "stored", "volatile"] = ""
    volatile_offset: int = 0
    exceptions: Mapping[int, str] = field(default_factory=lambda: EXCEPTIONS)
    probe: Place = _FIRST_REGISTER
    identity: Mapping[str, str] = field(default_factory=dict)
    identification: int | None = None

    @property
    def status_places(self) -> tuple[Place, ...]:
        """The registers that tell the state, each once."""
        return tuple(dict.fromkeys(condition.place for condition in self.status.values()))

    @property
    def stops(self) -> frozenset[Stop]:
        """The ways to stop."""
        return frozenset(how for key, how in STOPS.items() if key in self.steps)

    @property
    def can_store(self) -> bool:
        """Whether a write can be kept in EEPROM."""
        return self.plain_write == "stored" or "store_before" in self.steps or "store_after" in self.steps

    @property
    def can_keep_volatile(self) -> bool:
        """Whether a write can be kept out of EEPROM."""
        return self.plain_write == "volatile" or "volatile_before" in self.steps or self.volatile_offset > 0


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
    plain = {key: given[key] for key in KEYS - {*_STEPS, "status", "probe", "exceptions"} if key in given}
    first = next(iter(status.values())).place if status else _FIRST_REGISTER
    own_texts = {int(code): text for code, text in given.get("exceptions", {}).items()}
    return Control(
        steps=steps,
        status=status,
        probe=place_of(given["probe"], options) if "probe" in given else first,
        exceptions={**EXCEPTIONS, **own_texts},
        **plain,
    )


def _step(name: str, given: Any, options: ModbusOptions) -> Step:
    if not isinstance(given, tuple) or len(given) not in (2, 3) or any(type(each) is not int for each in given[1:]):
        raise UsageError(f"[control] {name}: a step is [address, value] or [address, value, mask], not {given!r}")
    return Step(place=place_of(given[0], options), value=given[1], mask=given[2] if len(given) == 3 else 0xFFFF)


def _condition(name: str, given: Any, options: ModbusOptions) -> Condition:
    if not isinstance(given, tuple) or len(given) != 3 or type(given[1]) is not int:
        raise UsageError(f"[control] status, {name}: a condition is [address, mask, value], not {given!r}")
    values = given[2] if isinstance(given[2], tuple) else (given[2],)
    return Condition(place=place_of(given[0], options), mask=given[1], values=values)
