"""Running what awaits, so that a signal ends it in order wherever it comes, also while the event loop is being made."""

from __future__ import annotations

import asyncio
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

from drivecomm.cli import signals

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

T = TypeVar("T")


def run(begin: Callable[[], Coroutine[Any, Any, T]]) -> T:
    """Run a coroutine to its end and return what it returns; a signal cancels it, and raises KeyboardInterrupt then."""
    cancel: Callable[[], object] | None = None

    def interrupt() -> None:
        if cancel is not None:
            cancel()

    async def interruptible() -> T:
        nonlocal cancel
        loop, task = asyncio.get_running_loop(), asyncio.current_task()
        assert task is not None  # noqa: S101 - this is one
        cancel = partial(loop.call_soon_threadsafe, task.cancel)
        try:
            if signals.interrupted():
                raise KeyboardInterrupt
            return await begin()
        finally:
            # Nothing can be told to a loop that is closing.
            cancel = None

    with signals.calling(interrupt):
        try:
            return asyncio.run(interruptible())
        except asyncio.CancelledError:
            if signals.interrupted():
                raise KeyboardInterrupt from None
            raise
