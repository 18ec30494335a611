"""Speed and direction of a motor: fixed frequency 1 (480), fixed percent 1 (520), and the resulting reference (283).

No known page describes how frequency and percentage are combined: parameters 475 and 476 select their sources by
numbers that are on no page, and the ramp gets a sum (ACU CM-PROFINET manual p. 75). So at most one of them is left
other than zero, and the drive's resulting reference is read afterwards. No page describes what 283 shows in standstill,
so a 0 of a stopped motor proves nothing; any other value is accepted.

The control word has no bit for the direction; the sign of the references determines it (Agile VABus manual p. 41), and
it belongs to the start: a new reference takes the present sign. Zero has no sign, so zero for a motor that runs
backwards is written as the smallest step, -0.01.
"""

from __future__ import annotations

from decimal import Decimal
from typing import TYPE_CHECKING

from drivecomm.errors import RefusedError, StateError, ValueRefusedError
from drivecomm.protocol import check_store, exact, unscaled
from drivecomm_vabus.conversation import profile
from drivecomm_vabus.parameters import VabusTarget, characters_for, target
from drivecomm_vabus.telegrams import data_of, number_of, range_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.protocol import Exchange, Model, Value
    from drivecomm_vabus.conversation import VabusConversation
    from drivecomm_vabus.options import VabusOptions

_MAXIMUM_FREQUENCY = 419

_HUNDREDTH = Decimal("0.01")
"""Step of a parameter without model data.

All references and frequencies have two decimals (short description section 7).
"""


class VabusReferences:
    """The references of one drive, which are only written to its RAM."""

    def __init__(self, talk: VabusConversation, options: VabusOptions, model: Model | None) -> None:
        self._talk = talk
        self._in_ram = options.ram_datasets
        self._hz = target(str(options.reference_hz_parameter), model, "long", None)
        self._percent = target(str(options.reference_percent_parameter), model, "int", None)
        self._shown = target(str(options.reference_shown_parameter), model, "long", None)
        self._maximum = target(str(_MAXIMUM_FREQUENCY), model, "long", None)

    @property
    def maximum(self) -> str:
        """The parameter with the maximum frequency; empty without a model, because only a model gives its unit."""
        return "" if self._maximum.info is None else self._maximum.address

    def set_hz(self, hz: Value | float) -> Exchange[None]:
        """Set a frequency.

        Raises ValueRefusedError immediately, StateError if the drive then shows another frequency.
        """
        return self._set(self._hz, self._percent, self._raw(self._hz, hz, "Hz"))

    def set_percent(self, percent: Value | float) -> Exchange[None]:
        """Set a share of the maximum frequency. Raises the same errors as `set_hz`."""
        return self._set(self._percent, self._hz, self._raw(self._percent, percent, "%"))

    def turn(self, *, backwards: bool) -> Exchange[None]:
        """Give the references the sign of a direction. Raises StateError if the motor would turn the other way."""
        stands = True
        for wanted in (self._percent, self._hz):
            held = yield from self._held(wanted)
            stands = stands and not any(held.values())
            for dataset, raw in held.items():
                if (turned := _turned(raw, backwards=backwards)) != raw:
                    yield from self._write(wanted, turned, dataset)
        if backwards and stands:
            yield from self._write(self._hz, -1)
        try:
            shown = yield from self._effective()
        except RefusedError:
            return
        if shown and (shown < 0) is not backwards:
            raise StateError(
                f"the reference of the drive (parameter {self._shown.number}) is {shown} Hz, the other way round, "
                f"though {self._hz.number} and {self._percent.number} are not; it was not started"
            )

    def _set(self, wanted: VabusTarget, other: VabusTarget, raw: int) -> Exchange[None]:
        held = yield from self._held(wanted)
        others = yield from self._held(other)
        signs = {value < 0 for value in (*held.values(), *others.values()) if value}
        backwards = signs == {True} or (len(signs) > 1 and ((yield from self._effective()) or 0) < 0)
        signed = -max(raw, 1) if backwards else raw
        meant = yield from self._meant_hz(wanted, signed)
        # Write the other reference first: if the line fails in between, the motor slows down.
        if any(others.values()):
            yield from self._write(other, 0)
        yield from self._write(wanted, signed)
        try:
            shown = yield from self._effective()
        except RefusedError as error:
            raise StateError(
                f"{_what(wanted, signed)}, and the drive does not show its reference: {error}; {_REMEDY}"
            ) from None
        if shown is None or any(abs(shown - each) <= _HUNDREDTH for each in meant):
            return
        if shown or profile().status((yield from self._talk.look())).running:
            # Restore the new reference first, because the other one adds to it.
            yield from self._set_back(wanted, held, signed)
            yield from self._set_back(other, others, 0)
            raise StateError(
                f"with {signed * _factor(wanted)} {_unit(wanted)} in parameter {wanted.address} the reference of the "
                f"drive was {shown} Hz (parameter {self._shown.number}), so the references were set back: it is "
                f"limited (418, 419), or follows something else (475, 476); {_REMEDY}"
            )

    def _set_back(self, wanted: VabusTarget, held: Mapping[int, int], now: int) -> Exchange[None]:
        """Restore the earlier values of a reference, by data set, where they differ from the present one."""
        for dataset, raw in held.items():
            if raw != now:
                yield from self._write(wanted, raw, dataset)

    def _meant_hz(self, wanted: VabusTarget, raw: int) -> Exchange[list[Decimal]]:
        """Return the frequencies that a reference may represent: one for each maximum in the data sets."""
        value = raw * _factor(wanted)
        if wanted is self._hz or not self._shown.number:
            return [value]
        maxima = yield from self._held(self._maximum)
        if not maxima:
            raise StateError("the drive has no maximum frequency (parameter 419), so a percentage is undefined; use hz")
        return [value / 100 * maximum * _factor(self._maximum) for maximum in maxima.values()]

    def _effective(self) -> Exchange[Decimal | None]:
        """Read the drive's resulting reference; None if the options exclude that. Raises RefusedError."""
        if not self._shown.number:
            return None
        raw = yield from self._talk.number(self._shown.number, "long", self._shown.address)
        return raw * _factor(self._shown)

    def _held(self, wanted: VabusTarget) -> Exchange[Mapping[int, int]]:
        return self._talk.held(wanted.number, wanted.type, wanted.address)

    def _write(self, wanted: VabusTarget, raw: int, dataset: int = 0) -> Exchange[None]:
        if not self._in_ram:
            raise StateError(
                f"{_what(wanted, -raw)}, which turns the motor the other way, and this drive has no RAM data sets to "
                "turn it round in; write it with store=True",
                says="store=True",
            )
        # The smallest number has no positive counterpart, but no drive turns that fast.
        highest = range_of(wanted.type)[-1]
        yield from self._talk.select(wanted.number, dataset + 5, data_of(min(raw, highest), wanted.type))

    def _raw(self, wanted: VabusTarget, value: Value | float, unit: str) -> int:
        """Return a reference in the drive's steps. Raises NotSupported, ValueRefusedError."""
        name = str(wanted.number)
        check_store(name, "as asked" if self._in_ram else "always", store=False)
        number = exact(value, name)
        if number < 0:
            raise ValueRefusedError(f"a reference of {value} {unit} is negative; a motor is reversed by its start")
        if wanted.info is None:
            number = Decimal(unscaled(number, _HUNDREDTH, name))
        return number_of(characters_for(wanted, number), wanted.type)


_REMEDY = "look at those, or, if it shows no reference in standstill, use the option reference_shown_parameter=0"


def _turned(raw: int, *, backwards: bool) -> int:
    """Return a reference for this direction; the smallest step backwards represents zero."""
    if backwards:
        return -abs(raw)
    return 0 if raw == -1 else abs(raw)


def _factor(wanted: VabusTarget) -> Decimal:
    return wanted.info.factor if wanted.info is not None else _HUNDREDTH


def _what(wanted: VabusTarget, raw: int) -> str:
    return f"parameter {wanted.address} is {raw * _factor(wanted)} {_unit(wanted)} now"


def _unit(wanted: VabusTarget) -> str:
    return "%" if wanted.type == "int" else "Hz"
