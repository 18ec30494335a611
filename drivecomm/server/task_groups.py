"""Groups of tasks that end together."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Coroutine

_AGAIN_S = 1.2
"""Pause before a cancellation is repeated; longer than a cancelled connection needs for its farewell."""


async def run_concurrently(*parts: Coroutine[Any, Any, None]) -> None:
    """Run coroutines concurrently until one ends or fails, or this call is cancelled; then cancel the others.

    Raises the error of the first coroutine that failed.
    """
    tasks = [asyncio.create_task(each) for each in parts]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        await cancel_and_wait(*tasks)


async def cancel_and_wait(*tasks: asyncio.Task[None]) -> None:
    """Cancel tasks and wait until all of them have ended, successfully or not.

    The cancellation is repeated, because before Python 3.12 it is lost if it comes at the moment in which `wait_for`,
    which aiomqtt uses, has its result.
    """
    while left := [task for task in tasks if not task.done()]:
        for task in left:
            task.cancel()
        await asyncio.wait(left, timeout=_AGAIN_S)
    await asyncio.gather(*tasks, return_exceptions=True)
