"""What a server polls of a plant: the usual values where the file says nothing, and nothing that cannot be read."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from drivecomm.bus import open_bus_async
from drivecomm.errors import FileFormatError, LinkError, UsageError, in_one_line
from drivecomm.line import items_of
from drivecomm.models import parameter_at, with_confirmed
from drivecomm.plant.files import read_plant
from drivecomm.protocol import PollGroup

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from drivecomm.bus import AsyncDrive
    from drivecomm.link import Port
    from drivecomm.plant.plant import Plant
    from drivecomm.protocol import DriveConfig

_NAMED = 5
"""How many drives a sentence names."""

USUALLY_POLLED = ("output_frequency", "output_current")
"""Common names that a server polls every second of a drive for which the plant file has no `poll`."""


def read_served_plant(path: Path) -> Plant:
    """Read a plant file for a server that polls it, with the usual polls of drives that have none.

    Raises FileFormatError as `read_plant` does, and for what the model of a drive does not have: each quantity that
    cannot be read, and each fact to confirm.
    """
    plant = with_usual_polls(read_plant(path))
    if wrong := [*_unknown_facts(plant), *unreadable_polls(plant)]:
        raise FileFormatError(f"{path}: {'; '.join(wrong)}")
    return plant


def with_usual_polls(plant: Plant) -> Plant:
    """Return the plant with the usual polls of each drive that has none, as far as its model knows their common names.

    A freshly scanned plant then shows more than states.
    """
    usual = {}
    for config, drive in _drives_of(plant):
        names = [] if drive.model is None else [name for name in USUALLY_POLLED if name in drive.model.quantities]
        if names and not config.poll:
            usual[config.name] = (PollGroup(parameters=tuple(names)),)
    return replace(plant, drives=tuple(replace(each, poll=usual.get(each.name, each.poll)) for each in plant.drives))


def unreadable_polls(plant: Plant) -> Sequence[str]:
    """Return a sentence for each polled quantity that models of drives do not have, or that cannot be read.

    Drives of which the same is to be said share a sentence: a hall may have forty of one series.
    """
    found: dict[tuple[str, str], list[str]] = {}
    for config, drive in _drives_of(plant):
        for item in items_of(config.poll, drive):
            try:
                drive.check_read(item.parameter, **item.options)
            except UsageError as error:
                found.setdefault((item.parameter, in_one_line(error)), []).append(config.name)
    return [
        f"drive{'s' if len(names) > 1 else ''} {_several(names)} cannot be polled for {parameter}: {reason}"
        for (parameter, reason), names in found.items()
    ]


def _several(names: Sequence[str]) -> str:
    more = len(names) - _NAMED
    return ", ".join([*names[:_NAMED], *([f"and {more} more"] if more > 0 else [])])


def notes_of_polls(plant: Plant) -> Mapping[tuple[str, str], str]:
    """Return how sure the model of a drive is of each polled quantity that no document prints, by drive and name."""
    found = {}
    for config, drive in _drives_of(plant):
        if drive.model is None:
            continue
        model = with_confirmed(drive.model, config.confirmed)
        for item in items_of(config.poll, drive):
            info = parameter_at(model.quantities.get(item.parameter, item.parameter), model)
            if info is not None and info.note:
                found[config.name, item.parameter] = info.note
    return found


def _unknown_facts(plant: Plant) -> Iterator[str]:
    """Yield why the facts that the file confirms are not those of each drive's model."""
    for config, drive in _drives_of(plant):
        if config.confirmed:
            try:
                with_confirmed(drive.model, config.confirmed)
            except UsageError as error:
                yield f"drive {config.name}: {in_one_line(error)}"


def _drives_of(plant: Plant) -> Iterator[tuple[DriveConfig, AsyncDrive]]:
    """Yield the drives of a plant, without opening a port or confirming a fact.

    A drive that cannot be made is left to whoever makes it.
    """
    for line in plant.lines:
        bus = open_bus_async(_no_port, **line.opening)
        for config in plant.on_line(line.name):
            try:
                drive = replace(config, confirmed=()).build(bus.drive)
            except Exception:  # noqa: BLE001, S112 - whatever a package raises here, the server reports it
                continue
            yield config, drive


def _no_port() -> Port:
    raise LinkError("a bus that only checks has no port")
