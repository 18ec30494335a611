"""Concurrent tasks that end together, even if one of them misses its cancellation."""

import asyncio

import pytest

from drivecomm.server import run_concurrently


class LostCancellation:
    """Coroutine that loses a cancellation, like `wait_for` when its result arrives at the same moment."""

    def __init__(self, times):
        self.left, self.ended = times, False

    async def run(self):
        while True:
            try:
                await asyncio.sleep(60)
            except asyncio.CancelledError:
                self.left -= 1
                if self.left < 0:
                    self.ended = True
                    raise


async def fails():
    await asyncio.sleep(0)
    raise ValueError("the first")


@pytest.mark.soak
def test_first_failure_ends_all_tasks_even_after_a_lost_cancellation():
    deaf = LostCancellation(times=1)

    async def test():
        async with asyncio.timeout(10):
            with pytest.raises(ValueError, match="the first"):
                await run_concurrently(deaf.run(), fails())

    asyncio.run(test())
    assert deaf.ended


@pytest.mark.soak
def test_outer_cancellation_ends_all_tasks():
    parts = [LostCancellation(times=0), LostCancellation(times=1)]

    async def test():
        task = asyncio.create_task(run_concurrently(*(each.run() for each in parts)))
        await asyncio.sleep(0.01)
        task.cancel()
        async with asyncio.timeout(10):
            with pytest.raises(asyncio.CancelledError):
                await task

    asyncio.run(test())
    assert all(each.ended for each in parts)
