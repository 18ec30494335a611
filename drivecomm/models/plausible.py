"""Plausibility of readings with a common name, by the drive's name plate and by the limits of all drives.

The limits are in `plausible.toml` beside this module, in the units of `quantities.toml`. maximum: the highest value, in
either direction unless there is a minimum. of, times: once the rated value `of` has been read from the drive, the
highest value is that multiplied by `times` instead.
"""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal
from functools import cache
from types import MappingProxyType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.protocol import Reading


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Limits of a quantity; see the module."""

    minimum: Decimal
    maximum: Decimal
    of: str = ""
    times: Decimal = Decimal(0)


@cache
def limits() -> Mapping[str, Limits]:
    """Return the limits by common name; many names have none."""
    import tomllib
    from importlib import resources

    text = resources.files("drivecomm.models").joinpath("plausible.toml").read_text(encoding="utf-8")
    content = tomllib.loads(text, parse_float=Decimal)
    return MappingProxyType(
        {
            name: Limits(
                minimum=Decimal(entry.get("minimum", -entry["maximum"])),
                maximum=Decimal(entry["maximum"]),
                of=entry.get("of", ""),
                times=Decimal(entry.get("times", 0)),
            )
            for name, entry in content.items()
        }
    )


@cache
def _rated() -> frozenset[str]:
    return frozenset(each.of for each in limits().values())


class Plausibility:
    """Judge of the readings of one drive; remembers the name plate values among them."""

    def __init__(self) -> None:
        self._plate: dict[str, Decimal] = {}

    def judged(self, reading: Reading) -> Reading:
        """Return a reading of a common name; marked uncertain, with the reason, if no drive can have such a value."""
        value, name = reading.value, reading.name
        if isinstance(value, str):
            return reading
        if name in _rated():
            self._plate[name] = Decimal(value)
        known = limits().get(name)
        if known is None:
            return reading
        rated = self._plate.get(known.of, Decimal(0))
        maximum = known.times * rated if rated > 0 else known.maximum
        minimum = -maximum if known.minimum == -known.maximum else known.minimum
        if minimum <= value <= maximum:
            return reading
        end, than = (maximum, "above") if value > maximum else (minimum, "below")
        why = f"{known.times} times its {known.of}" if rated > 0 else "what drives have"
        return reading.doubted(
            f"not plausible: {than} {end:f} {reading.unit}, {why}; check the model, or the value in the drive"
        )
