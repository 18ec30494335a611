"""Exploration for blocking callers and for asyncio callers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.bus import carry_out, carry_out_async
from drivecomm.commissioning.exploring.exploring import exploring, unseen
from drivecomm.commissioning.exploring.identity import lasting_identity, read_identity
from drivecomm.commissioning.exploring.logbook import NoAnswerRecord

if TYPE_CHECKING:
    from drivecomm.bus import AsyncDrive, Drive, Procedure
    from drivecomm.commissioning.exploring.answers import AddressAnswer
    from drivecomm.commissioning.exploring.exploration_plan import ExplorationPlan
    from drivecomm.commissioning.exploring.exploring import Asks, Progress
    from drivecomm.commissioning.exploring.logbook import AnswerRecord


def explore(
    drive: Drive, way: ExplorationPlan, asks: Asks, logbook: AnswerRecord | None = None, *, progress: Progress = unseen
) -> list[AddressAnswer]:
    """Request all addresses of an exploration plan from a drive; return the answers in its order.

    asks: returns the request for an address, such as `drivecomm.bus.read_parameter`. logbook: record of the answers,
    from which a later call resumes after an interruption. Raises FileFormatError for a logbook of another drive,
    NoReplyError if the drive stays silent, LinkError if the line is lost.
    """
    return carry_out(drive, _exploring(way, asks, logbook or NoAnswerRecord(), progress))


async def explore_async(
    drive: AsyncDrive,
    way: ExplorationPlan,
    asks: Asks,
    logbook: AnswerRecord | None = None,
    *,
    progress: Progress = unseen,
) -> list[AddressAnswer]:
    """Request all addresses of an exploration plan from a drive; see `explore`."""
    return await carry_out_async(drive, _exploring(way, asks, logbook or NoAnswerRecord(), progress))


def _exploring(
    way: ExplorationPlan, asks: Asks, logbook: AnswerRecord, progress: Progress
) -> Procedure[list[AddressAnswer]]:
    logbook.begin(lasting_identity((yield from read_identity())))
    return (yield from exploring(way, asks, logbook, progress))
