"""Exploring for callers that block and callers that await."""

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
    """Ask a drive for all addresses of a way; return the answers in its order.

    asks: how, such as `drivecomm.bus.read_parameter`. logbook: what remembers the answers, so that a later call goes on
    where this one is cut off. Raises FileFormatError for a logbook of another drive, NoReplyError when the drive stays
    silent, LinkError when the line is lost.
    """
    return carry_out(drive, _exploring(way, asks, logbook or Forgetful(), progress))


async def explore_async(
    drive: AsyncDrive, way: Course, asks: Asks, logbook: Remembers | None = None, *, progress: Progress = unseen
) -> list[Answer]:
    """Ask a drive for all addresses of a way, as `explore` does."""
    return await carry_out_async(drive, _exploring(way, asks, logbook or Forgetful(), progress))


def _exploring(way: Course, asks: Asks, logbook: Remembers, progress: Progress) -> Procedure[list[Answer]]:
    logbook.begin(lasting((yield from identity_told())))
    return (yield from exploring(way, asks, logbook, progress))
