"""Turns of threads on one line: waiting, giving up, interruption, and waking."""

import threading
import time
from collections import Counter

import pytest

from drivecomm.line import Rank, ThreadTurn, ThreadTurns


def wait_for(condition):
    until = time.monotonic() + 10
    while not condition():
        assert time.monotonic() < until, "nothing happens"
        time.sleep(0.001)


class Interrupted:
    """A lock whose acquire() is interrupted by Ctrl-C."""

    def locked(self):
        return True

    def acquire(self, timeout=None):
        if timeout is not None:
            raise KeyboardInterrupt


def has_turn(turns, turn, seconds):
    """Request a turn whose lock is held and wait for it, as a bus does; return whether it came in time."""
    return turns.ask(turn) or turns.wait(turn, seconds)


def take(turns, rank, seconds=0.0):
    """Take a turn as a bus does; return None if it has not come in time."""
    turn = ThreadTurn(rank)
    # One thread plays several callers.
    turn.caller = object()
    turn.held.acquire()
    if has_turn(turns, turn, seconds):
        return turn
    turn.held.release()
    return None


def give_back(turns, turn):
    turn.held.release()
    turns.hand_on()


class Crowd:
    """Threads that take turns; each records its turn and gives it back."""

    def __init__(self, turns):
        self.turns = turns
        self.called = []
        self.threads = []

    def join(self, name, rank, seconds=10.0):
        """Start one more thread, and return when it waits for its turn."""
        waiting = len(self.turns.queue.waiting)

        def wait():
            if turn := take(self.turns, rank, seconds):
                self.called.append(name)
                give_back(self.turns, turn)
            else:
                self.called.append(f"not {name}")

        thread = threading.Thread(target=wait)
        thread.start()
        self.threads.append(thread)
        wait_for(lambda: len(self.turns.queue.waiting) > waiting)

    def leave(self):
        for thread in self.threads:
            thread.join(10)
            assert not thread.is_alive()


def test_threads_that_give_up_while_being_woken_lose_no_turn():
    turns, inside, most, served = ThreadTurns(), [], [], Counter()

    def work(name):
        for number in range(150):
            turn = take(turns, Rank.READ, 0.0005 * (number % 3))
            if turn is None:
                served["gave up"] += 1
                continue
            inside.append(name)
            most.append(len(inside))
            if number % 5 == 0:
                time.sleep(0.0005)
            inside.pop()
            served["served"] += 1
            give_back(turns, turn)

    threads = [threading.Thread(target=work, args=(name,)) for name in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(30)
        assert not thread.is_alive()
    assert max(most) == 1
    assert served["gave up"] > 0
    assert served["served"] > 0
    assert take(turns, Rank.READ)


def test_interrupted_turn_is_over_without_a_hand_on():
    crowd = Crowd(ThreadTurns())
    turn = take(crowd.turns, Rank.READ)
    crowd.join("next", Rank.READ)
    turn.held.release()
    crowd.leave()
    assert crowd.called == ["next"]


def test_interrupted_waiting_thread_is_passed_over():
    crowd = Crowd(ThreadTurns())
    turn, gone = take(crowd.turns, Rank.READ), ThreadTurn(Rank.STOP)
    gone.caller = object()
    gone.called = Interrupted()
    with pytest.raises(KeyboardInterrupt), gone.held:
        has_turn(crowd.turns, gone, 10.0)
    assert not crowd.turns.stop_waits()
    crowd.join("next", Rank.READ)
    give_back(crowd.turns, turn)
    crowd.leave()
    assert crowd.called == ["next"]
