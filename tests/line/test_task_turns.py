"""Turns of tasks on one line: waiting, giving up, cancellation, and waking."""

import asyncio
import time
from functools import wraps

import pytest

from drivecomm.line import Rank, TaskTurn, TaskTurns


def awaited(test):
    @wraps(test)
    def run(*values, **options):
        asyncio.run(test(*values, **options))

    return run


def turn(rank=Rank.READ):
    made = TaskTurn(rank, lambda: None)
    # One task plays several callers.
    made.caller = object()
    return made


async def took(turns, mine, seconds=10.0):
    """Take a turn in a separate task; return whether it came."""
    return await asyncio.create_task(turns.take(mine, seconds))


@awaited
async def test_turn_that_comes_at_the_end_of_its_wait_is_not_lost():
    turns, first, second, third = TaskTurns(), turn(), turn(), turn()
    assert await took(turns, first)
    waiting = asyncio.create_task(turns.take(second, 0.01))
    await asyncio.sleep(0)
    # The next round of the loop hands the line on, and sees then that the wait is over.
    time.sleep(0.02)  # noqa: ASYNC251 - on purpose
    asyncio.get_running_loop().call_soon(turns.give_back, first)
    if await waiting:
        turns.give_back(second)
    assert await took(turns, third, 0.0)


@pytest.mark.parametrize("seconds", [0.0, 0.01])
@awaited
async def test_task_leaves_the_queue_when_its_wait_is_over(seconds):
    turns, first = TaskTurns(), turn()
    assert await took(turns, first, seconds)
    assert not await took(turns, turn(Rank.STOP), seconds)
    assert turns.queue.waiting == []
    turns.give_back(first)
    assert await took(turns, turn(Rank.POLL), seconds)


@pytest.mark.parametrize("called_first", [False, True])
@pytest.mark.parametrize("times", [1, 2])
@awaited
async def test_task_cancelled_while_waiting_keeps_no_turn(called_first, times):
    """Cancelled once or twice, also while the task is being woken."""
    turns, first, second, third = TaskTurns(), turn(), turn(), turn(Rank.POLL)
    assert await took(turns, first)
    waiting = asyncio.create_task(turns.take(second, 10.0))
    behind = asyncio.create_task(turns.take(third, 10.0))
    await asyncio.sleep(0)
    if called_first:
        turns.give_back(first)
    for _ in range(times):
        waiting.cancel()
    with pytest.raises(asyncio.CancelledError):
        await waiting
    if not called_first:
        assert not behind.done()
        turns.give_back(first)
    assert await behind
    turns.give_back(third)
    assert await took(turns, turn(), 0.0)


@awaited
async def test_line_is_not_handed_to_a_task_cancelled_immediately_before():
    turns, first, third = TaskTurns(), turn(), turn()
    assert await took(turns, first)
    waiting = asyncio.create_task(turns.take(turn(), 10.0))
    behind = asyncio.create_task(turns.take(third, 10.0))
    await asyncio.sleep(0)
    waiting.cancel()
    turns.give_back(first)
    with pytest.raises(asyncio.CancelledError):
        await waiting
    assert await behind
    turns.give_back(third)
    assert await took(turns, turn(), 0.0)
