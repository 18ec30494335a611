"""Backups of a core while a block lasts, as a server makes them."""

import asyncio
from contextlib import asynccontextmanager

from drivecomm.server.backups.backing_up import Backups
from drivecomm.server.backups.settings import PlantBackups


@asynccontextmanager
async def backing(core, folder, clock, drives):
    """Back up drives, by name with their settings, until the block ends; yield what does it."""
    settings = PlantBackups(folder=folder / "backups", git=False, drives=drives)
    backups = Backups(core, settings, state=folder / "state", clock=clock)
    task = asyncio.create_task(backups.run())
    try:
        yield backups
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
