"""`result_of` waits for work that continues when its caller is cancelled."""

import asyncio
import gc

import pytest

from drivecomm.line import result_of


async def fails_after_release(release):
    await release.wait()
    raise ValueError("too late")


def test_result_of_returns_the_result_and_raises_the_error():
    async def main():
        assert await result_of(asyncio.ensure_future(asyncio.sleep(0, "done"))) == "done"
        release = asyncio.Event()
        release.set()
        with pytest.raises(ValueError, match="too late"):
            await result_of(asyncio.ensure_future(fails_after_release(release)))

    asyncio.run(main())


def test_cancelled_caller_leaves_the_work_running_and_its_error_unreported():
    reported = []

    async def main():
        asyncio.get_running_loop().set_exception_handler(lambda _, context: reported.append(context))
        release = asyncio.Event()
        work = asyncio.ensure_future(fails_after_release(release))
        caller = asyncio.ensure_future(result_of(work))
        await asyncio.sleep(0)
        caller.cancel()
        with pytest.raises(asyncio.CancelledError):
            await caller
        assert not work.done()
        release.set()
        await asyncio.wait([work])
        del work
        gc.collect()

    asyncio.run(main())
    assert not reported


def test_cancelled_work_cancels_the_caller():
    async def main():
        work = asyncio.ensure_future(asyncio.sleep(60))
        caller = asyncio.ensure_future(result_of(work))
        await asyncio.sleep(0)
        work.cancel()
        with pytest.raises(asyncio.CancelledError):
            await caller

    asyncio.run(main())
