"""The table [control] of a model: how drives whose commands are registers are commanded, and how they store a write.

Besides the commands and the status of `drivecomm.profiles.register_command_tables`, the table names the parameters that
hold the references and the code of a fault, the requirements of a start, and the place to which a write goes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from drivecomm.errors import NotSupported, UsageError
from drivecomm.profiles.files import control_profile
from drivecomm.profiles.full_scale import full_scale_of
from drivecomm.profiles.profile import ControlProfile
from drivecomm.profiles.register_command_tables import (
    COMMAND_KEYS,
    condition_of,
    profile_of_orders,
    status_of,
    steps_of,
)
from drivecomm.profiles.state_machine import StateMachine
from drivecomm.protocol import Capabilities, Stop, check_store

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from drivecomm.profiles.full_scale import FullScale
    from drivecomm.profiles.profile import BitCondition, ControlStep
    from drivecomm.profiles.registers import RegisterParameter, RegisterPlace
    from drivecomm.protocol import Model, ParameterInfo

Views: TypeAlias = "Mapping[str, tuple[tuple[RegisterPlace, RegisterPlace], ...]]"
"""Registers and coils that show others, or bits of them, and pass on writes to them.

By name, as pairs of the own part and the place that it shows. A register that shows several places passes on writes to
all of them, and shows the last one.
"""

SIGNED = frozenset({"s16", "s32"})
"""Types of parameters whose sign can show the direction."""

_STORING = ("store_before", "store_after", "volatile_before", "volatile_after", "write_before")
CONTROL_PARAMETERS = ("fault_code", "reference_hz", "reference_percent", "actual_percent", "direction")
"""Keys of a table [control] that name a parameter of the model."""
_FURTHER = ("further_references", "signed")
_PLAIN = (
    *CONTROL_PARAMETERS,
    *_FURTHER,
    "measured",
    "needs",
    "needs_reverse",
    "needs_reference",
    "plain_write",
    "volatile_offset",
    "unused",
    "sure_stop",
    "code_tells",
    "further_starts",
)
CONTROL_KEYS = frozenset(
    {
        *(*COMMAND_KEYS, *_STORING, *_PLAIN),
        *("full_scale", "status", "start_pause_s", "views", "fed_by", "command_shown", "way", "state_machine"),
    }
)


@dataclass(frozen=True, slots=True, kw_only=True)
class WritePlan:
    """Steps before and after a write, and the offset from the parameter's place to the place of the write."""

    before: tuple[ControlStep, ...] = ()
    offset: int = 0
    after: tuple[ControlStep, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlTable:
    """Content of a table [control].

    storing: the steps before and after a write that goes to EEPROM, those before and after a write that is kept out of
    it, and those before each write, references included (`write_before`). status: the conditions of the status, by
    name. fault_code, reference_hz, reference_percent: addresses of parameters, empty if there are none. full_scale: the
    parameters that hold the range of reference_percent; None if no parameter in hertz is known to hold it. direction:
    the address of a signed parameter that is negative while the motor turns backwards; empty if the status shows the
    direction, or nothing does. needs: the raw values with which a drive obeys, by address; needs_reverse: further ones
    for a start backwards; needs_reference: those with which it takes a reference. plain_write: the memory to which a
    write without such steps goes, empty if it is unknown. volatile_offset: the offset to the registers that keep a
    write in RAM.

    further_starts: addresses of registers and coils that can start the motor in addition to those of `start`. starts:
    the places of all these, and of registers and coils that pass on writes to them. imported: whether any fact of the
    model comes from a file of another program; without commands, such a drive accepts no write, since its registers may
    have wrong numbers.

    sure_stop: the stop whose words start nothing, whatever the parameters of `needs` hold, if other stops could start
    something; a stop to all drives uses it. code_tells: whether the code of a fault shows a fault as well as the status
    does; if the status shows none, only the code does. way: the values of the status before the first step of a start
    and after each step, in this order; None if the steps are not awaited. fed_by: the write that restarts the time of
    the drive's watchdog; None if every telegram does. command_shown: the place where the drive shows the last command
    from the bus, empty if it does not show it.

    For virtual drives only: further_references: further parameters in per cent or hertz that are references.
    actual_percent: the parameter that shows the output frequency in per cent of the highest one. signed: parameters
    that show the direction by their sign although their type does not say so. state_machine: the state machine by which
    the drive obeys any control word; None if only the words of the commands have a meaning. measured: parameters
    without a common name, with the common name whose value they show. unused: "zero" if registers that a drive does not
    have read as 0 and accept any value, behind one that it has.
    """

    profile: ControlProfile = field(default_factory=lambda: ControlProfile(name=""))
    storing: Mapping[str, tuple[ControlStep, ...]] = field(default_factory=dict)
    status: Mapping[str, BitCondition] = field(default_factory=dict)
    fault_code: str = ""
    reference_hz: str = ""
    reference_percent: str = ""
    full_scale: FullScale | None = None
    direction: str = ""
    needs: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    needs_reverse: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    needs_reference: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    code_tells: bool = False
    way: BitCondition | None = None
    fed_by: BitCondition | None = None
    command_shown: str = ""
    plain_write: Literal["", "stored", "volatile"] = ""
    volatile_offset: int = 0
    further_references: tuple[str, ...] = ()
    actual_percent: str = ""
    signed: tuple[str, ...] = ()
    state_machine: StateMachine | None = None
    measured: Mapping[str, str] = field(default_factory=dict)
    unused: Literal["", "zero"] = ""
    sure_stop: Literal["", "ramp", "coast", "quick", "dc_brake"] = ""
    further_starts: tuple[str, ...] = ()
    starts: frozenset[str] = frozenset()
    imported: bool = False

    def may_start(self, written: RegisterParameter, words: Iterable[int]) -> bool:
        """Return whether words written to a parameter may start the motor."""
        if self.is_monitoring_only and (self.imported or written.info is None):
            return True
        orders = (*self.profile.stops.values(), self.profile.reset)
        harmless = {(step.place, step.word) for steps in orders for step in steps}
        pairs = zip(written.spots, words, strict=True)
        return any(word and spot in self.starts and (spot, word) not in harmless for spot, word in pairs)

    def write_plan(self, address: str, info: ParameterInfo | None, *, store: bool) -> WritePlan:
        """Return the steps and the offset of a write, stored or not. Raises NotSupported if such a write is impossible.

        address: for the error. info: the model's facts about the parameter, if it has any.
        """
        commands = info is not None and info.kind == "command"
        if commands or self.imported:
            self.must_have_orders()
        plain = commands or (info is not None and info.storage == "volatile")
        never, always = plain or not self.can_store, not self.can_keep_volatile
        check_store(address, "never" if never else "always" if always else "as asked", store=store)
        unlocking = self.storing.get("write_before", ())
        if plain:
            return WritePlan(before=unlocking)
        if store:
            before = (*unlocking, *self.storing.get("store_before", ()))
            return WritePlan(before=before, after=self.storing.get("store_after", ()))
        before, after = (self.storing.get(f"volatile_{each}", ()) for each in ("before", "after"))
        return WritePlan(before=(*unlocking, *before), offset=self.volatile_offset, after=after)

    def capabilities(self, model: Model | None, *, broadcast: bool) -> Capabilities:
        """Return the capabilities of a drive with this table.

        broadcast: whether its protocol can address all drives.
        """
        return Capabilities(
            # Without a model no stop is known; the call raises an error that says so.
            stops=frozenset(self.profile.stops) if model else frozenset({Stop.RAMP}),
            reverse=bool(self.profile.start_reverse),
            reference_percent=bool(self.reference_percent) and not self.is_monitoring_only,
            reference_hz=bool(self.reference_hz) and not self.is_monitoring_only,
            stored_writes=self.can_store,
            volatile_writes=self.can_keep_volatile,
            broadcast=broadcast,
            monitoring_only=self.is_monitoring_only,
            reference_maximum=model.quantities.get("maximum_frequency", "") if model else "",
        )

    @property
    def is_monitoring_only(self) -> bool:
        """Whether the model starts, stops and resets nothing; False without a model."""
        profile = self.profile
        return bool(profile.name) and not (profile.start or profile.start_reverse or profile.stops or profile.reset)

    def must_have_orders(self) -> None:
        """Raise NotSupported for a drive that is monitoring only."""
        if self.is_monitoring_only:
            raise NotSupported(
                f"a drive of model {self.profile.name} is monitoring only: the model has no commands, so it can "
                "only be read here; command it at the drive"
            )

    @property
    def can_store(self) -> bool:
        """Whether a write can be kept in EEPROM."""
        return self.plain_write == "stored" or not self.storing.keys().isdisjoint(("store_before", "store_after"))

    @property
    def can_keep_volatile(self) -> bool:
        """Whether a write can be kept out of EEPROM."""
        return self.plain_write == "volatile" or "volatile_before" in self.storing or self.volatile_offset > 0


def references_of(model: Model | None) -> frozenset[str]:
    """Return the addresses of the parameters that are written as references, and of those that these show as views."""
    given: Mapping[str, Any] = model.control if model is not None else {}
    written = {given.get("reference_hz", ""), given.get("reference_percent", ""), *given.get("further_references", ())}
    views = given.get("views", {})
    return frozenset(written.union(*(views.get(each, ()) for each in written)) - {""})


def control_entries(model: Model, place_of: Callable[[str], RegisterPlace]) -> dict[str, Any]:
    """Return the arguments of `ControlTable` from the table of a model. Raises UsageError for an invalid table.

    place_of: returns the register, the coil or the part of a register for an address.
    """

    def spot_of(address: str) -> tuple[str, int]:
        place = place_of(address)
        return place.name, place.bits[1]

    given = model.control
    steps = {name: steps_of(name, given[name], spot_of) for name in (*COMMAND_KEYS, *_STORING) if name in given}
    status = status_of(given.get("status", {}), spot_of)
    for key in CONTROL_PARAMETERS:
        if key in given and model.find(given[key]) is None:
            raise UsageError(f"[control] {key}: {given[key]!r} is not a parameter of the model")
    turning = model.find(given.get("direction", ""))
    if turning is not None and turning.type not in SIGNED:
        raise UsageError(f"[control] direction: parameter {turning.address} is {turning.type or 'u16'}, without a sign")
    for key in (*_FURTHER, "measured"):
        if strange := [each for each in given.get(key, ()) if model.find(each) is None]:
            raise UsageError(f"[control] {key}: {strange[0]!r} is not a parameter of the model")
    way = condition_of("way", given["way"], spot_of) if "way" in given else None
    started = {*(step.place for each in ("start", "start_reverse") for step in steps.get(each, ())[-1:])}
    started |= {place_of(each).name for each in given.get("further_starts", ())}
    passed_on = {own for own, shown in views_of(model, place_of).items() if started & {each.name for _, each in shown}}
    for name in ("start", "start_reverse"):
        if way is not None and len(way.values) != len(steps.get(name, way.values[1:])) + 1:
            raise UsageError(f"[control] way: {name} has {len(steps[name])} steps, and the way needs one more value")
    return {
        "profile": profile_of_orders(model.name, steps, status, given.get("start_pause_s", 0.0), way),
        "way": way,
        "full_scale": full_scale_of(model),
        "storing": {name: steps[name] for name in _STORING if name in steps},
        "status": status,
        "starts": frozenset(started | passed_on),
        "imported": any(info.sure == "imported" for info in model.parameters.values()),
        "fed_by": condition_of("fed_by", given["fed_by"], spot_of) if "fed_by" in given else None,
        "command_shown": spot_of(given["command_shown"])[0] if "command_shown" in given else "",
        "state_machine": _state_machine(given["state_machine"], spot_of) if "state_machine" in given else None,
        **{key: given[key] for key in _PLAIN if key in given},
    }


def _state_machine(given: Any, spot_of: Callable[[str], tuple[str, int]]) -> StateMachine:
    """Return the state machine of the entry `state_machine`. Raises UsageError for an invalid entry or profile."""
    keys = ("profile", "control_word", "status_word")
    if not isinstance(given, Mapping) or given.keys() - {"reset_lock_s", "contacts"} != set(keys):
        raise UsageError(f"[control] state_machine: write {{ {', '.join(f'{key} = ...' for key in keys)} }}")
    return StateMachine(
        profile=control_profile(given["profile"]),
        control_word=spot_of(given["control_word"])[0],
        status_word=spot_of(given["status_word"])[0],
        reset_lock_s=float(given.get("reset_lock_s", 0)),
        contacts=int(given.get("contacts", 0)),
    )


def views_of(model: Model, place_of: Callable[[str], RegisterPlace]) -> Views:
    """Return the views in the table [control.views] of a model, for a virtual drive.

    place_of: as in `control_entries`.
    """
    views: dict[str, tuple[tuple[RegisterPlace, RegisterPlace], ...]] = {}
    for address, given in model.control.get("views", {}).items():
        for shown in given if isinstance(given, tuple) else (given,):
            for own, source in _parts(place_of(address), place_of(shown)):
                views[own.name] = (*views.get(own.name, ()), (own, source))
    return views


def _parts(own: RegisterPlace, shown: RegisterPlace) -> list[tuple[RegisterPlace, RegisterPlace]]:
    """Return pairs of a place and the place that it shows: sixteen coils in a row show the bits of a register."""
    if not own.is_bit or shown.is_bit or shown.part:
        return [(own, shown)]
    return [(replace(own, start=own.start + bit), replace(shown, part=str(bit))) for bit in range(16)]
