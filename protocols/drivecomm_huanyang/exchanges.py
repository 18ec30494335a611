"""Verbs of a master for a Huanyang drive that differ from those of other drives with registers."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal
from typing import TYPE_CHECKING

from drivecomm.errors import NotSupported, ValueRefusedError
from drivecomm.profiles import RegisterCommandMemory, RegisterOperations, check_needs
from drivecomm.protocol import check_store, exact, unscaled
from drivecomm_huanyang.dialect import TURNS, HuanyangConversation, HuanyangDialect

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.protocol import DriveStatus, Exchange, Model, Value
    from drivecomm_huanyang.options import HuanyangOptions

_MAXIMUM, _SET_FREQUENCY, _OUTPUT_FREQUENCY = "PD005", "CFG0", "CFG1"
_STEP_HZ = Decimal("0.01")


class HuanyangOperations(RegisterOperations):
    """Verbs of one drive, or at address 0 the stop of all drives on the line."""

    def __init__(
        self, address: int, options: HuanyangOptions, model: Model | None, memory: RegisterCommandMemory | None = None
    ) -> None:
        dialect, memory = HuanyangDialect(address, options, model), memory or RegisterCommandMemory()
        super().__init__(dialect, memory, HuanyangConversation(dialect, memory))
        self.capabilities = replace(
            self.capabilities, reference_percent=True, reference_hz=True, faults=False, reference_maximum=""
        )

    def write(self, parameter: str, value: Value | float, *, store: bool = False, type: str = "") -> Exchange[None]:
        """Write a parameter, or CFG0, the frequency.

        A parameter is stored permanently and needs store=True; CFG0 is volatile and takes no store.
        """
        wanted = self._known(parameter, type)
        if not wanted.place.kind:
            return super().write(parameter, value, store=store, type=type)
        raw = int(wanted.format.raw_for(value, wanted.address, wanted.info))
        if wanted.place.start:
            raise NotSupported("of the status values only CFG0 can be written")
        check_store(wanted.address, "never", store=store)
        return self._set_frequency(lambda _most: raw)

    def status(self) -> Exchange[DriveStatus]:
        """Read output frequency and set frequency; a drive reports neither a fault nor the direction."""
        hz = int((yield from self._drive.raw(self._known(_OUTPUT_FREQUENCY))))
        told = yield from self._drive.raw(self._known(_SET_FREQUENCY))
        seen = {_OUTPUT_FREQUENCY: hz, TURNS.name: int(hz > 0)}
        return (yield from self._commander.status(
            self._model, seen, actual_hz=hz * _STEP_HZ, at_reference=hz == told and hz > 0
        ))  # fmt: skip

    def reset(self) -> Exchange[None]:
        """Raise NotSupported, because no documented telegram acknowledges a fault."""
        raise NotSupported("no telegram acknowledges a fault of a Huanyang drive; use its keypad or its RST terminal")

    def set_reference_percent(self, percent: Value | float) -> Exchange[None]:
        """Set the frequency as a share of PD005, the maximum operating frequency, rounded to 0.01 Hz."""
        share = exact(percent, "reference")
        if share < 0:
            raise ValueRefusedError(f"a reference of {share} % is not 0 to 100 % of PD005; to reverse is a start")
        return self._set_frequency(lambda most: int((share * most / 100).to_integral_value()))

    def set_reference_hz(self, hz: Value | float) -> Exchange[None]:
        """Set the frequency in hertz, up to PD005, the maximum operating frequency."""
        raw = unscaled(exact(hz, "reference"), _STEP_HZ, "reference", "Hz")
        if raw not in range(0x10000):
            raise ValueRefusedError(f"a reference of {hz} Hz is not 0 Hz to PD005; to reverse is a start")
        return self._set_frequency(lambda _most: raw)

    def _set_frequency(self, wanted: Callable[[int], int]) -> Exchange[None]:
        """Set the frequency that `wanted` computes from the maximum, both in steps of 0.01 Hz."""
        yield from check_needs(self._control.needs_reference, self.read)
        most = int((yield from self._drive.raw(self._known(_MAXIMUM))))
        raw = wanted(most)
        if raw > most:
            limit = most * _STEP_HZ
            raise ValueRefusedError(f"a reference of {raw * _STEP_HZ} Hz is above PD005, which is {limit} Hz")
        goal = self._known(_SET_FREQUENCY)
        yield from self._drive.put(goal, raw, goal.place)
