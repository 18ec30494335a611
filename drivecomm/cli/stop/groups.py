"""Groups of drives to stop: from the plant file, its server, or the readable part of a damaged file."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any, TypeAlias

from drivecomm.cli.stop.damaged_file import readable_plant
from drivecomm.cli.stop.one_drive import the_plant_file

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from drivecomm.cli.line_options import LineArguments
    from drivecomm.cli.stop.safe_lookups import SafeLookups
    from drivecomm.cli.stop.server_drives import ServedDrives, ServerDrives
    from drivecomm.plant import Plant
    from drivecomm.protocol import DriveConfig

Place: TypeAlias = "tuple[str, Mapping[str, Any], DriveConfig]"
"""Port of a drive, the options for opening it, and the drive."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedDrives:
    """Drives that a word names, and their places.

    unreached: errors for the named drives that cannot be reached, by their names. whole: whether these are certainly
    all of them.
    """

    places: Sequence[Place] = ()
    unreached: Mapping[str, Exception] = field(default_factory=dict)
    whole: bool = True


def group_to_stop(line: LineArguments, text: str, servers: ServerDrives, spite: SafeLookups) -> PlacedDrives | None:
    """Return the drives of a group; None if neither the plant file nor a server has such a group.

    For a damaged file, these are the readable drives and those that its server knows. A note then warns that the group
    may have more drives. Raises UsageError if several servers know the name.
    """
    path = the_plant_file(line, spite)
    plant, wrong = _read(path)
    found = PlacedDrives() if plant is None else _of_plant(line, plant, text)
    has_group = bool(found.places or found.unreached)
    if has_group and not wrong:
        return found
    ask = partial(servers.named, text)
    known = spite.of(ask, None, "the server of the group is not known") if has_group else ask()
    if known is not None and not known.is_group:
        known = None
    is_own = known is not None and path is not None and spite.of(partial(_is_of, known, path), False, str(path))
    # A damaged file and another plant may have groups of the same name.
    told = known.places(line) if known is not None and (is_own or not has_group) else []
    places = {(place[2].line, str(place[2])): place for place in (*told, *found.places)}
    if not places and not found.unreached:
        return None
    for sentence in wrong:
        spite.note(sentence)
    # If the file is completely unreadable, the server's copy is all there is.
    whole = not wrong or (plant is None and is_own)
    if not whole:
        spite.note(
            f"{path}: the group {text.partition(',')[0]!r} may have more drives than can be read there; look at the "
            "motors, or stop everything with drivecomm stop --all"
        )
    return replace(found, places=tuple(places.values()), whole=whole)


def _read(path: Path | None) -> tuple[Plant | None, list[str]]:
    """Return the readable part of a plant file, None if there is none, and the faults of the file."""
    if path is None:
        return None, []
    try:
        plant, wrong = readable_plant(path)
    except Exception as error:  # noqa: BLE001 - its server may know the group
        return None, [str(error)]
    return replace(plant, file=str(path)), wrong


def _of_plant(line: LineArguments, plant: Plant, text: str) -> PlacedDrives:
    """Return the drives of a group of a plant.

    In a damaged file a drive may have the name of the group. As the meaning is then unclear, both are stopped.
    """
    word, *behind = text.split(",")
    places: list[Place] = []
    unreached: dict[str, Exception] = {}
    for member in plant.drives if word in plant.groups else ():
        if word in member.groups or word == member.name:
            try:
                reached, drive = replace(line, arm=False).reaching_in(plant, member, behind)
                places.append((reached.named_port, reached.opening, drive))
            except Exception as error:  # noqa: BLE001 - the other drives must still be stopped
                unreached[member.name] = error
    return PlacedDrives(places=places, unreached=unreached)


def _is_of(known: ServedDrives, path: Path) -> bool:
    return known.server.plant == str(path.resolve())
