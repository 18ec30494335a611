"""Runner of coroutines that a signal can end in order at any time, even while the event loop starts."""

from __future__ import annotations

import asyncio
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

from drivecomm.cli import signals

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

T = TypeVar("T")


def run(begin: Callable[[], Coroutine[Any, Any, T]]) -> T:
    """Run a coroutine and return its result; a signal cancels it, and then KeyboardInterrupt is raised."""
    cancel: Callable[[], object] | None = None

    def interrupt() -> None:
        if cancel is not None:
            cancel()

    async def interruptible() -> T:
        nonlocal cancel
        loop, task = asyncio.get_running_loop(), asyncio.current_task()
        assert task is not None  # noqa: S101 - this coroutine runs in a task
        cancel = partial(loop.call_soon_threadsafe, task.cancel)
        try:
            if signals.interrupted():
                raise KeyboardInterrupt
            return await begin()
        finally:
            # A closing loop accepts no calls.
            cancel = None

    with signals.calling(interrupt):
        try:
            return asyncio.run(interruptible())
        except asyncio.CancelledError:
            if signals.interrupted():
                raise KeyboardInterrupt from None
            raise
