"""A blocking call in a thread of its own, for those who must not wait until others have left one free."""

from __future__ import annotations

import asyncio
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, ParamSpec, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

P = ParamSpec("P")
T = TypeVar("T")


async def in_own_thread(call: Callable[P, T], *values: P.args, **options: P.kwargs) -> T:
    """Return what a blocking call returns.

    The threads of `asyncio.to_thread` are few: calls that hang for seconds, such as connecting to serial servers that
    are off, use them up, and then all others wait.
    """
    thread = ThreadPoolExecutor(1, thread_name_prefix="drivecomm")
    # Begun here, and not in the executor of the loop; the thread ends with the call, also where nobody awaits it more.
    running = asyncio.wrap_future(thread.submit(call, *values, **options))
    thread.shutdown(wait=False)
    return await running
