"""References of a drive that takes them only in per cent or only in hertz; the other form is converted."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from drivecomm.errors import NotSupported, StateError, ValueRefusedError
from drivecomm.protocol import exact, unless_refused

if TYPE_CHECKING:
    from collections.abc import Callable
    from decimal import Decimal

    from drivecomm.profiles.dialect import Dialect
    from drivecomm.protocol import Exchange, Reading, Value


class ReferenceConverter:
    """References of one drive, converted to the form that the drive takes.

    capabilities: capabilities of its model, with both forms if one can be converted. read: reads a parameter by its
    address.
    """

    def __init__(self, dialect: Dialect, read: Callable[[str], Exchange[Reading]]) -> None:
        control = dialect.control
        known = control.capabilities(dialect.model, broadcast=dialect.broadcast_address is not None)
        self._control, self._read, self._maximum = control, read, known.reference_maximum
        self._lowest, self._highest = dialect.reference_range
        self._option = dialect.reference_option
        is_given = self._highest is not None
        in_percent, in_hertz = known.reference_percent, known.reference_hz
        self.capabilities = replace(
            known,
            reference_percent=in_percent or (in_hertz and (is_given or bool(known.reference_maximum))),
            reference_hz=in_hertz or (in_percent and (is_given or control.full_scale is not None)),
            reference_limit_hz=self._highest,
        )

    def must_have(self, form: str) -> None:
        """Raise NotSupported unless the drive takes a reference in "per cent" or "hertz", directly or converted."""
        able, other = self.capabilities, "hertz" if form == "per cent" else "per cent"
        if not (able.reference_percent if form == "per cent" else able.reference_hz):
            hint = f"give the frequency that is 100 % at the drive, such as {self._option}, to set it in {form}"
            raise NotSupported(
                f"a drive of model {self._control.profile.name} takes its reference in {other} only; "
                f"{hint if self._option else f'set it in {other}'}",
                says=self._option,
            )

    def hz_for(self, percent: Value | float) -> Exchange[Decimal]:
        """Return a reference in per cent as a frequency.

        Raises StateError if the maximum frequency of the drive is not above 0, ValueRefusedError for a result above it.
        """
        share, maximum = exact(percent, "reference"), None
        if self._maximum:
            found = self._read(self._maximum)
            # If the drive does not report its maximum, the option counts.
            reading = (yield from unless_refused(found)) if self._highest is not None else (yield from found)
            maximum = None if reading is None else exact(reading.value, "maximum frequency")
        if maximum is not None and maximum <= 0:
            raise StateError(f"the maximum frequency is {maximum} Hz, so a share of it is not a reference; use hertz")
        highest = maximum if self._highest is None else self._highest
        hz = share * (highest or 0) / 100
        if maximum is not None and abs(hz) > maximum:
            raise ValueRefusedError(
                f"a reference of {share} % of {highest} Hz is above {maximum} Hz, the maximum frequency of the drive "
                f"(parameter {self._maximum}); set reference_maximum_hz to what the drive holds"
            )
        return hz

    def percent_for(self, hz: Value | float) -> Exchange[Decimal]:
        """Return a frequency in per cent. Raises StateError for an empty range, ValueRefusedError outside the range."""
        wanted = exact(hz, "reference")
        lowest, highest = self._lowest, self._highest
        scale, where = self._control.full_scale, "by the options"
        if highest is None and scale is not None:
            highest = exact((yield from self._read(scale.maximum)).value, "full scale")
            if scale.minimum:
                lowest = exact((yield from self._read(scale.minimum)).value, "lowest reference")
            where = f"parameter {' and '.join(scale.addresses)}"
        if highest is None or highest <= lowest:
            raise StateError(
                f"100 % is {highest} Hz and 0 % is {lowest} Hz ({where}), so no reference in hertz is a share of that; "
                "use per cent"
            )
        if abs(wanted) > highest or (lowest and wanted < lowest):
            least = lowest or -highest
            raise ValueRefusedError(
                f"a reference of {wanted} Hz is outside {least} to {highest} Hz, the reference range of the drive "
                f"({where})"
            )
        return (wanted - lowest) * 100 / (highest - lowest)
