"""Share of a drive's values that a parameter set holds, as far as the drive's model knows them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivecomm.commissioning.parameter_sets.reading_out import values_known
from drivecomm.protocol import installed, resolve_options

if TYPE_CHECKING:
    from drivecomm.commissioning.parameter_sets.parameter_set import ParameterSet
    from drivecomm.protocol import Model


@dataclass(frozen=True, slots=True, kw_only=True)
class Share:
    """Share of a model's values that a set holds. held: their number. of: number of all values, without commands."""

    model: str
    held: int
    of: int

    def __str__(self) -> str:
        return f"{self.held} of the {self.of} values that model {self.model} knows ({percent(self.held, self.of)})"


def percent(part: int, of: int) -> str:
    """Return a share as text, rounded down so that only a complete share shows as 100 %."""
    return f"{part * 100 // of if of else 100} %"


def share_of(known: ParameterSet, model: Model) -> Share:
    """Return the share of a model's values that a set holds. model: the model with which the set was read."""
    plugin = installed[known.protocol]
    _, options = resolve_options(plugin, model, {})
    values = values_known(model, plugin, options)
    addresses = [address for address, info, _ in values if "r" in info.access]
    held = sum(address in known.entries for address in addresses)
    return Share(model=model.name, held=held, of=len(addresses))
