"""Blocking calls in a thread of their own, for callers that must not wait for a free pool thread."""

from __future__ import annotations

import asyncio
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, ParamSpec, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

P = ParamSpec("P")
T = TypeVar("T")


async def in_own_thread(call: Callable[P, T], *values: P.args, **options: P.kwargs) -> T:
    """Run a blocking call in a new thread and return its result.

    The threads of `asyncio.to_thread` are few. Calls that hang for seconds, such as connecting to serial servers that
    are off, use them up, and then all other calls wait.
    """
    thread = ThreadPoolExecutor(1, thread_name_prefix="drivecomm")
    # Not in the executor of the loop; this thread ends with the call, even if the result is no longer awaited.
    running = asyncio.wrap_future(thread.submit(call, *values, **options))
    thread.shutdown(wait=False)
    return await running
