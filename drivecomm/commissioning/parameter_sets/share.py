"""How much of a drive a parameter set holds, as far as the drive's model knows it."""

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
    """held: how many values of a model's parameters a set holds. of: how many there are, without commands."""

    model: str
    held: int
    of: int

    def __str__(self) -> str:
        return f"{self.held} of the {self.of} values that model {self.model} knows ({percent(self.held, self.of)})"


def percent(part: int, of: int) -> str:
    """Return a share for people: 100 % is all, and nothing less is shown as that."""
    return f"{part * 100 // of if of else 100} %"


def share_of(known: ParameterSet, model: Model) -> Share:
    """Return how much a set holds of what a model knows; model: that which the set was read with."""
    plugin = installed[known.protocol]
    _, options = resolve_options(plugin, model, {})
    values = values_known(model, plugin, options)
    addresses = [address for address, info, _ in values if "r" in info.access]
    held = sum(address in known.entries for address in addresses)
    return Share(model=model.name, held=held, of=len(addresses))
