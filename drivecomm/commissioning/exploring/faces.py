"""Exploration for blocking callers and for asyncio callers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.bus import carry_out, carry_out_async
from drivecomm.commissioning.exploring.exploring import exploring, unseen
from drivecomm.commissioning.exploring.identity import identity_told, lasting
from drivecomm.commissioning.exploring.logbook import Forgetful

if TYPE_CHECKING:
    from drivecomm.bus import AsyncDrive, Drive, Procedure
    from drivecomm.commissioning.exploring.answers import Answer
    from drivecomm.commissioning.exploring.course import Course
    from drivecomm.commissioning.exploring.exploring import Asks, Progress
    from drivecomm.commissioning.exploring.logbook import Remembers


def explore(
    drive: Drive, way: Course, asks: Asks, logbook: Remembers | None = None, *, progress: Progress = unseen
) -> list[Answer]:
    """Request all addresses of a course from a drive; return the answers in its order.

    asks: returns the request for an address, such as `drivecomm.bus.read_parameter`. logbook: record of the answers,
    from which a later call resumes after an interruption. Raises FileFormatError for a logbook of another drive,
    NoReplyError if the drive stays silent, LinkError if the line is lost.
    """
    return carry_out(drive, _exploring(way, asks, logbook or Forgetful(), progress))


async def explore_async(
    drive: AsyncDrive, way: Course, asks: Asks, logbook: Remembers | None = None, *, progress: Progress = unseen
) -> list[Answer]:
    """Request all addresses of a course from a drive; see `explore`."""
    return await carry_out_async(drive, _exploring(way, asks, logbook or Forgetful(), progress))


def _exploring(way: Course, asks: Asks, logbook: Remembers, progress: Progress) -> Procedure[list[Answer]]:
    logbook.begin(lasting((yield from identity_told())))
    return (yield from exploring(way, asks, logbook, progress))
