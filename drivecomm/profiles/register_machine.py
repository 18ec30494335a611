"""Registers and coils of a virtual drive, with its parameters, commands and status, and the effects of writes.

Registers have names. They keep their contents until mains is switched off; then only those in EEPROM remain.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal, TypeAlias

from drivecomm.profiles.control_table import SIGNED
from drivecomm.profiles.register_commands import RegisterCommandMachine
from drivecomm.profiles.state_machine import StateMachineOrders
from drivecomm.protocol import MotorCommand, Stop

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping, Sequence

    from drivecomm.profiles.control_table import ControlTable, Views
    from drivecomm.profiles.registers import RegisterParameter
    from drivecomm.protocol import Model, Motor

_DIRECTED = frozenset({"output_frequency", "motor_speed"})
"""Common names whose value in a `Motor` has no sign for the direction."""

Why: TypeAlias = Literal["unknown", "read only", "running", "limits", "count", "not set up"]


class RegisterRefusal(Exception):  # noqa: N818 - becomes a telegram
    """Refusal of a read or a write."""

    def __init__(self, why: Why) -> None:
        self.why: Why = why
        super().__init__(why)


class RegisterMachine:
    """Registers of a virtual drive, and the effects of writes to them.

    targets: all parameters, by address. control: how the drive is commanded and how it stores. views: registers that
    show others.
    """

    def __init__(
        self, model: Model, targets: Mapping[str, RegisterParameter], control: ControlTable, motor: Motor, views: Views
    ) -> None:
        self._model, self._targets, self._motor = model, targets, motor
        self._all = [(each, each.spots) for each in targets.values()]
        self._views = views
        self._control, self._said, self._storing = control, control.status, control.storing
        references = (control.reference_percent, control.reference_hz, *control.further_references)
        self._references = [each for each in references if each]
        self._heard_at = 0.0
        self._is_numbered = True
        self._remembered = False
        profile, storing = control.profile, control.storing
        orders = [profile.start, profile.start_reverse, profile.reset, *profile.stops.values()]
        self._ordering = frozenset(step.place for steps in orders for step in steps)
        self.words = dict.fromkeys((step.place for steps in (*orders, *storing.values()) for step in steps), 0)
        self.words |= dict.fromkeys((each.place for each in self._said.values()), 0)
        self.words |= dict.fromkeys((spot for each in targets.values() for spot in each.spots), 0)
        self.words |= dict.fromkeys(views, 0)
        for each in targets.values():
            self._begin_with(each)
        self._stored = dict(self.words)
        self._orders = self._obeying(control, motor)
        self._orders.power_up(self.words, 0.0)

    def _obeying(self, control: ControlTable, motor: Motor) -> RegisterCommandMachine | StateMachineOrders:
        """Return the machine that obeys commands: that of a standard, or else one for the words of the commands."""
        machine = control.state_machine
        if machine is None:
            return RegisterCommandMachine(control.profile, motor, self._wanted_hz, control.way)
        place = machine.control_word
        parts = {source.name for _, source in self._views.get(place, ())}
        return StateMachineOrders(
            machine,
            motor,
            self._wanted_hz,
            control_word=lambda: self._seen(place),
            parts=parts,
            is_set_up=self.is_set_up,
        )

    def is_set_up(self) -> bool:
        """Return whether the parameters hold all values that the drive needs to obey the bus."""
        needs = self._control.needs.items()
        return all(self.fetch(self._targets[address]) in allowed for address, allowed in needs)

    def ignores(self, places: Iterable[str]) -> bool:
        """Return whether one of these places commands the drive while it is not set up to obey."""
        return not self._ordering.isdisjoint(places) and not self.is_set_up()

    def _begin_with(self, wanted: RegisterParameter) -> None:
        """Write the model's start value of a parameter into its registers."""
        info = wanted.info
        if info is None or info.start is None:
            return
        if isinstance(info.start, str) or wanted.format.type in ("f32", "digits"):
            self.put(wanted, info.start if isinstance(info.start, str) else wanted.raw_for(info.start))
        else:
            self.put(wanted, int(info.start / info.factor) & 0xFFFFFFFF)

    def live(self, now: float) -> None:
        """Advance the time, and show the values of the motor in the registers for them."""
        motor = self._motor
        self._watch(now)
        self._orders.follow(now)
        for name, address in self._model.quantities.items():
            wanted, measured = self._targets.get(address), self._measured(name)
            if measured is not None and wanted and wanted.info and wanted.info.access == "r":
                self._show(wanted, self._turned(measured, name, wanted))
        for address, name in self._control.measured.items():
            wanted, measured = self._targets[address], self._measured(name)
            if measured is not None:
                self._show(wanted, self._turned(measured, name, wanted))
        if self._control.actual_percent:
            actual = self._targets[self._control.actual_percent]
            self._show(actual, self._share(motor.output_hz))
        self.words |= self._orders.status_words(self._said)
        # Set after the status, which may be in the other byte of the same register.
        code = self._control.fault_code
        shown = motor.fault if self._is_numbered or "fault" not in self._said else 0
        if motor.fault and not self._remembered:
            self._remember(shown)
        self._remembered = bool(motor.fault)
        if code and not (code in self._model.fault_log and "fault" in self._said):
            self.put(self._targets[code], shown)

    def _remember(self, fault: int) -> None:
        """Add a fault to the fault memory and shift the others by one; the memory survives without mains."""
        log = [self._targets[each] for each in self._model.fault_log if each in self._targets]
        for wanted, held in zip(log, [fault, *map(self.fetch, log)], strict=False):
            self.put(wanted, held)
            self._stored.update((spot, self.words[spot]) for spot in wanted.spots)

    def heard(self, now: float) -> None:
        """Record that the master has sent something, which feeds the watchdog unless only commands do."""
        if self._control.fed_by is None:
            self._heard_at = now

    def trip(self, code: int, now: float) -> None:
        """Trip with this fault code."""
        self._is_numbered = True
        self._orders.trip(code, now)

    def power_cycle(self, now: float) -> None:
        """Switch mains off and on: commands, a trip and values that were not stored are lost."""
        self._motor.warning = False
        self.words = dict(self._stored)
        self._orders.power_up(self.words, now)

    def fetch(self, wanted: RegisterParameter) -> int | str:
        """Return the raw value of a parameter."""
        return wanted.raw_of([self._seen(spot) for spot in wanted.spots])

    def put(self, wanted: RegisterParameter, raw: int | str) -> None:
        """Set the raw value of a parameter, as if at the keypad."""
        words = wanted.words_for(raw, self._seen(wanted.spots[0]))
        self.words |= self._passed_on(dict(zip(wanted.spots, words, strict=True)))

    def read(self, places: Iterable[str]) -> tuple[int, ...]:
        """Return the contents of registers. Raises RegisterRefusal if one does not exist."""
        asked = tuple(places)
        known = self._known(asked)
        return tuple(self._seen(place) if place in known else 0 for place in asked)

    def write(self, places: Sequence[str], values: Sequence[int], now: float, *, only_ram: bool = False) -> None:
        """Write registers and carry out the commands in them. If RegisterRefusal is raised, nothing has changed."""
        known = self._known(places)
        given = {place: word for place, word in zip(places, values, strict=True) if place in known}
        whole = self._passed_on(given)
        before = {place: self.words[place] for place in whole}
        self.words |= whole
        touched = [each for each, spots in self._all if not before.keys().isdisjoint(spots)]
        try:
            for each in touched:
                self._check(each)
        except RegisterRefusal:
            self.words |= before
            raise
        fed_by = self._control.fed_by
        if fed_by is not None and fed_by.place in whole and fed_by.holds(self.words):
            self._heard_at = now
        if any(step.place in before for step in self._storing.get("store_after", ())):
            self._store_all()
        volatile = any(each.info is not None and each.info.storage == "volatile" for each in touched)
        if not only_ram and not volatile and self._goes_to_eeprom():
            self._stored.update((place, self.words[place]) for place in whole if place not in self._ordering)
        for reference in {each.address for each in touched}.intersection(self._references):
            # The reference that was written last counts.
            self._references.insert(0, self._references.pop(self._references.index(reference)))
            if self._motor.command is MotorCommand.RUN:
                self._orders.act(now)
        self._orders.written(whole, self.words, now)

    def _known(self, places: Sequence[str]) -> Collection[str]:
        """Return those of these places that exist. Raises RegisterRefusal if the drive does not tolerate the others."""
        known = {place for place in places if place in self.words}
        if len(known) < len(places) and (self._control.unused != "zero" or places[0] not in self.words):
            raise RegisterRefusal("unknown")
        return known

    def _seen(self, place: str) -> int:
        """Return the value of a register or a coil, with the parts of others that it shows."""
        word = self.words[place]
        for own, source in self._views.get(place, ()):
            word = own.put(word, source.cut(self._seen(source.name)))
        return word

    def _passed_on(self, given: Mapping[str, int]) -> dict[str, int]:
        """Return the written registers, plus the registers to which they pass on the writes."""
        whole = dict(given)
        for place, word in given.items():
            for own, source in self._views.get(place, ()):
                whole[source.name] = source.put(whole.get(source.name, self.words[source.name]), own.cut(word))
        return whole

    def _show(self, wanted: RegisterParameter, value: float) -> None:
        """Set the value that a parameter shows, as exactly as its factor allows."""
        factor = 1 if wanted.info is None else wanted.info.factor
        self.put(wanted, round(value / float(factor)) & 0xFFFFFFFF)

    def _check(self, wanted: RegisterParameter) -> None:
        """Raise RegisterRefusal if the value just written to a parameter is not permitted."""
        info = wanted.info
        if info is None:
            return
        if info.access == "r":
            raise RegisterRefusal("read only")
        if info.access == "rw*" and self._motor.running:
            raise RegisterRefusal("running")
        value = wanted.reading(self.fetch(wanted)).value
        if not isinstance(value, str) and not info.allows(value):
            raise RegisterRefusal("limits")

    def _goes_to_eeprom(self) -> bool:
        steps = self._storing.get("store_before")
        if steps is None:
            return self._control.plain_write == "stored"
        return all(self.words[step.place] & step.mask == step.word & step.mask for step in steps)

    def _store_all(self) -> None:
        """Copy all values to EEPROM, except those of volatile parameters."""
        held = self._targets.values()
        volatile = {spot for each in held if each.info and each.info.storage == "volatile" for spot in each.spots}
        self._stored.update((place, word) for place, word in self.words.items() if place not in volatile)

    def _watch(self, now: float) -> None:
        """Carry out the action of the watchdog if the master has been silent for longer than the watchdog's time.

        The action takes effect at the moment at which that time ended.
        """
        watchdog, motor = self._model.watchdog, self._motor
        timer = self._targets.get(watchdog.time) if watchdog is not None else None
        if watchdog is None or timer is None or timer.info is None or not motor.running:
            return
        raw = self.fetch(timer)
        if not isinstance(raw, int) or raw == (watchdog.off or 0):
            return
        silent_at = self._heard_at + raw * float(timer.info.factor)
        if now <= silent_at:
            return
        action = self.fetch(self._targets[watchdog.action]) if watchdog.action else None
        policy = next((each for each, code in watchdog.actions.items() if action in (None, code)), "hold")
        if policy == "trip":
            self.trip(watchdog.fault or 1, silent_at)
            # If no source states the code of this fault, only the status shows the trip, if it can.
            self._is_numbered = bool(watchdog.fault)
        elif policy != "hold":
            self._orders.stop(Stop.COAST if policy == "coast" else Stop.RAMP, silent_at)

    def _turned(self, measured: float, quantity: str, wanted: RegisterParameter) -> float:
        """Return a measured value with the sign of the direction, if this parameter shows the direction."""
        shows_sign = wanted.format.type in SIGNED or wanted.address in self._control.signed
        directed = quantity in _DIRECTED and shows_sign
        return -measured if directed and self._motor.output_hz < 0 else measured

    def _measured(self, quantity: str) -> float | None:
        """Return the value that a drive shows for a common name; None if it concerns neither motor nor command."""
        if quantity == "reference_frequency":
            return self._wanted_hz()
        if quantity == "reference_percent":
            return self._share(self._wanted_hz())
        return self._motor.measured(quantity)

    def _wanted_hz(self) -> float:
        """Return the reference that was written last, in Hz."""
        if not self._references:
            return 0.0
        wanted = self._targets[self._references[0]]
        value = float(wanted.reading(self.fetch(wanted)).value)
        in_percent = wanted.info is not None and wanted.info.unit == "%"
        if not in_percent:
            return value
        lowest, highest = self._full_scale()
        return math.copysign(lowest + abs(value) * (highest - lowest) / 100, value)

    def _share(self, hz: float) -> float:
        """Return a frequency in per cent of the reference range."""
        lowest, highest = self._full_scale()
        share = (abs(hz) - lowest) * 100 / (highest - lowest) if highest > lowest else 0.0
        return math.copysign(max(share, 0.0), hz)

    def _full_scale(self) -> tuple[float, float]:
        """Return the frequencies in Hz of a reference of 0 % and of 100 %."""
        scale = self._control.full_scale
        if scale is None:
            return 0.0, self._motor.maximum_hz
        held = [float(self._targets[each].reading(self.fetch(self._targets[each])).value) for each in scale.addresses]
        highest, lowest = (*held, 0.0)[:2]
        return lowest, highest
