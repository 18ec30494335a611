"""Waiting for work that continues when its caller is cancelled."""

from __future__ import annotations

import asyncio
from typing import Any, TypeVar

T = TypeVar("T")


async def result_of(work: asyncio.Future[T]) -> T:
    """Return the result of a task or future, which continues if the caller is cancelled; its error is then dropped.

    From Python 3.14 on, `asyncio.shield` reports such an error to the event loop, as one that nothing handles.
    """
    try:
        await asyncio.wait([work])
    except asyncio.CancelledError:
        work.add_done_callback(_drop_error)
        raise
    return work.result()


def _drop_error(work: asyncio.Future[Any]) -> None:
    if not work.cancelled():
        work.exception()
