"""Backups of a core during a block, made as in a server."""

import asyncio
from contextlib import asynccontextmanager

from drivecomm.server.backups.backing_up import Backups
from drivecomm.server.backups.settings import PlantBackups


@asynccontextmanager
async def backing(core, folder, clock, drives):
    """Back up drives until the block ends; yield the backups object.

    drives: backup settings by name of the drive.
    """
    settings = PlantBackups(folder=folder / "backups", git=False, drives=drives)
    backups = Backups(core, settings, state=folder / "state", clock=clock)
    task = asyncio.create_task(backups.run())
    try:
        yield backups
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
