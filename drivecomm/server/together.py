"""Several things at once that end together."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Coroutine

_AGAIN_S = 1.2
"""Longer than who is cancelled takes to say good-bye."""


async def together(*parts: Coroutine[Any, Any, None]) -> None:
    """Do all of this at once until one of it ends or fails, or this is cancelled; then the others are cancelled.

    Raises what the first one raised that failed.
    """
    tasks = [asyncio.create_task(each) for each in parts]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        await ended(*tasks)


async def ended(*tasks: asyncio.Task[None]) -> None:
    """Cancel what goes on, and wait until it has ended, however it ends.

    Before Python 3.12 a cancellation is lost that comes in the moment in which `wait_for` has its result, which aiomqtt
    waits by; so it is repeated.
    """
    while left := [task for task in tasks if not task.done()]:
        for task in left:
            task.cancel()
        await asyncio.wait(left, timeout=_AGAIN_S)
    await asyncio.gather(*tasks, return_exceptions=True)
