"""What a plant polls although it can never be read, found without opening a port."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.bus import open_bus_async
from drivecomm.errors import LinkError, UsageError, in_one_line
from drivecomm.polling import items_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.link import Port
    from drivecomm.plant.plant import Plant


def unreadable_polls(plant: Plant) -> Sequence[str]:
    """Return a sentence for each polled quantity that its drive's model does not have, or that cannot be read.

    Drives that cannot be made at all are left to whoever makes them.
    """
    found = []
    for line in plant.lines:
        bus = open_bus_async(_no_port, **line.opening)
        for config in plant.on_line(line.name):
            try:
                drive = config.build(bus.drive)
            except Exception:  # noqa: BLE001, S112 - whatever a package raises here, the server reports it
                continue
            for item in items_of(config.poll, drive):
                try:
                    drive.check_read(item.parameter, **item.options)
                except UsageError as error:
                    found.append(f"{config.name} {item.parameter} can never be read: {in_one_line(error)}")
    return found


def _no_port() -> Port:
    raise LinkError("a bus that only checks has no port")
