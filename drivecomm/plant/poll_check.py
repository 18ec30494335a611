"""Poll plan of a served plant: default values for drives without a plan, and a check that all values are readable."""

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
"""Limit of drives that one sentence names."""

USUALLY_POLLED = ("output_frequency", "output_current")
"""Common names that a server polls every second from a drive without `poll` in the plant file."""


def read_served_plant(path: Path) -> Plant:
    """Read a plant file for a server that polls it, with default polls for drives without `poll`.

    Raises FileFormatError as `read_plant` does, and for values and confirmed facts that the model of a drive does not
    have or that cannot be read.
    """
    plant = with_usual_polls(read_plant(path))
    if wrong := [*_unknown_facts(plant), *unreadable_polls(plant)]:
        raise FileFormatError(f"{path}: {'; '.join(wrong)}")
    return plant


def with_usual_polls(plant: Plant) -> Plant:
    """Return the plant with default polls for each drive without `poll`, limited to names that its model maps.

    A newly scanned plant then shows values in addition to states.
    """
    usual = {}
    for config, drive in _drives_of(plant):
        names = [] if drive.model is None else [name for name in USUALLY_POLLED if name in drive.model.quantities]
        if names and not config.poll:
            usual[config.name] = (PollGroup(parameters=tuple(names)),)
    return replace(plant, drives=tuple(replace(each, poll=usual.get(each.name, each.poll)) for each in plant.drives))


def unreadable_polls(plant: Plant) -> Sequence[str]:
    """Return a sentence for each polled value that the model of a drive does not have, or that cannot be read.

    Drives with the same problem share a sentence, because a plant may have many drives of one series.
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
    """Return a note on each polled value that no document confirms, by drive and name."""
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
    """Yield an error for each drive whose model does not have the facts that the file confirms."""
    for config, drive in _drives_of(plant):
        if config.confirmed:
            try:
                with_confirmed(drive.model, config.confirmed)
            except UsageError as error:
                yield f"drive {config.name}: {in_one_line(error)}"


def _drives_of(plant: Plant) -> Iterator[tuple[DriveConfig, AsyncDrive]]:
    """Yield the drives of a plant, without opening a port or confirming a fact.

    A drive that cannot be made is left out; the error is reported when the drive is made for use.
    """
    for line in plant.lines:
        bus = open_bus_async(_no_port, **line.opening)
        for config in plant.on_line(line.name):
            try:
                drive = replace(config, confirmed=()).build(bus.drive)
            except Exception:  # noqa: BLE001, S112 - the server reports any error of a package later
                continue
            yield config, drive


def _no_port() -> Port:
    raise LinkError("a bus that only checks has no port")
