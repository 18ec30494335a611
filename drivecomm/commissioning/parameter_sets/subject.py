"""The drive that a parameter set is taken from or given to, as far as its parameters go."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivecomm.errors import UsageError
from drivecomm.models import quantities
from drivecomm.protocol import installed, resolve_options

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from drivecomm.bus import AsyncDrive, Drive
    from drivecomm.commissioning.parameter_sets.parameter_set import ParameterSet, Part
    from drivecomm.protocol import Capabilities, Model, ParameterInfo, Protocol


@dataclass(frozen=True, slots=True)
class Subject:
    """A drive's name, its model and what it can. Its options of the protocol are those of the model."""

    name: str
    plugin: Protocol
    model: Model
    options: Any
    capabilities: Capabilities

    @property
    def protocol(self) -> str:
        """The name of its protocol."""
        return self.plugin.name

    def addresses_of(self, info: ParameterInfo) -> tuple[str, ...]:
        """Return the addresses of a parameter's values, one by one."""
        return self.plugin.element_addresses(info, self.options)

    def info(self, address: str) -> ParameterInfo | None:
        """Return what the model knows of the parameter that an address names."""
        return self.model.parameters.get(address) or self.model.parameters.get(address.partition("[")[0])

    def common_names(self) -> Mapping[str, str]:
        """Return the common name by the address, for all addresses that the model maps."""
        known = quantities()
        return {address: name for name, address in self.model.quantities.items() if name in known}


def subject(drive: Drive | AsyncDrive) -> Subject:
    """Return a drive as parameter sets see it. Raises UsageError for one without a model."""
    if drive.model is None:
        raise UsageError(f"{drive.name}: which parameters it has is said by its model; name one, such as with --model")
    protocol = drive.name.partition(":")[0]
    plugin = installed[protocol]
    _, options = resolve_options(plugin, drive.model, {})
    return Subject(drive.name, plugin, drive.model, options, drive.capabilities)


def part_of(info: ParameterInfo) -> Part | None:
    """Return the part of a parameter set that a parameter belongs to; None for what is a command."""
    if "w" not in info.access:
        return "measured"
    if info.kind == "command":
        return None
    if info.kind == "communication":
        return "communication"
    # What is gone without power is a reference or a command of the bus, and no setting.
    return "measured" if info.storage == "volatile" else "settings"


# What a drive tells of itself and what may change while it stays the same drive.
_PASSING = ("state", "software", "firmware", "version", "hours")


def of_another_drive(known: ParameterSet, to: Subject, identity: Mapping[str, str]) -> str:
    """Return how one sees that a parameter set is of another drive; empty when nothing says so."""
    if known.protocol != to.protocol:
        return f"it is of a {known.protocol} drive, and {to.name} is none"
    if known.model != to.model.name:
        return f"it is of model {known.model}, and {to.name} is opened as {to.model.name}"
    if known.drive != to.name:
        return f"it is of {known.drive}, and the drive is {to.name}"
    return next(_differences(known.identity, identity), "")


def changes_told(before: ParameterSet, after: ParameterSet) -> list[str]:
    """Return what two sets of one drive say of it differently, as sentences."""
    told = list(_differences(before.identity, after.identity, "there"))
    if before.firmware != after.firmware and before.protocol == after.protocol:
        told.append(f"firmware is {before.firmware or 'not known'} here and {after.firmware or 'not known'} there")
    return told


def _differences(before: Mapping[str, str], after: Mapping[str, str], where: str = "on this drive") -> Iterator[str]:
    for key, text in before.items():
        if key in after and after[key] != text and not any(word in key.lower() for word in _PASSING):
            yield f"its {key} is {text!r}, and {after[key]!r} {where}"
