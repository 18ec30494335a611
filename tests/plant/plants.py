"""Virtual plants to be watched, in virtual time."""

import asyncio
from dataclasses import replace

from drivecomm.plant import Plant, PlantLine, PowerCutStep, TripStep
from drivecomm.plant.watching import Watcher, lines_of
from drivecomm.protocol import DriveConfig
from drivecomm.virtual import VirtualPlant

HALL = PlantLine(name="hall", port="/dev/ttyUSB0")
YARD = PlantLine(name="yard", port="/dev/ttyUSB1")
PUMP = DriveConfig(protocol="vabus", address=1, line="hall", name="pump", options={"model": "agile"})
FAN = DriveConfig(protocol="danfoss-fc", address=3, line="hall", name="fan", options={"model": "fc300"})
WELL = DriveConfig(protocol="vabus", address=1, line="yard", name="well", options={"model": "agile"})


def plant_of(*drives, script=(), lines=(HALL, YARD)):
    there = {drive.line for drive in drives}
    return VirtualPlant(
        Plant(lines=tuple(line for line in lines if line.name in there), drives=drives, script=tuple(script))
    )


def tripped(drive, code, at_s):
    return TripStep(drive=drive, code=code, at_s=at_s)


def dark(drive, off_at_s, back_at_s=None):
    return PowerCutStep(drive=drive, off_at_s=off_at_s, back_at_s=back_at_s)


def virtual_lines(plant, **changes):
    """Return the watched lines of a virtual plant. changes: facts for all drives, such as armed=True."""
    return [
        replace(
            line,
            port=plant.line(line.name).port,
            drives=tuple(replace(drive, **changes) for drive in line.drives),
        )
        for line in lines_of(plant.plant)
    ]


def watched(plant, seconds, **options):
    """Watch a plant for the given number of seconds; return the closed watcher."""

    async def watch():
        async with Watcher(virtual_lines(plant), **options) as watcher:
            await watcher.run(duration_s=seconds)
            return watcher

    return asyncio.run(watch())
