"""Execution of a link's steps in the caller's own thread, without a switch between threads.

The port decides between real and virtual time: the port of a virtual line has a virtual clock.
"""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, TypeVar

from drivecomm.line.effects import carry_out
from drivecomm.link import Arrival, Receive, Transaction, Wait

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.link import LinkSteps, Port

T = TypeVar("T")


# The constructor of a NamedTuple is a Python function, and slower.
_new = tuple.__new__

_LOOK_S, _LOOK_ALONE_S = 0.01, 0.05
"""Poll intervals in seconds of a wait that gives way to stops: usually, and while this is the only thread.

With a single thread only a signal handler, or a thread that Python has not made, could stop anything; and on an idle
processor the wake-up for one poll takes as long as a whole read.
"""


def run_steps(steps: LinkSteps[T], port: Port, stop_waits: Callable[[], bool]) -> T:
    """Run the steps of a link to their end on a port and return their result.

    stop_waits: returns whether a stop waits for the line; a wait that gives way then ends early. An exception of the
    port, or Ctrl-C, closes the steps and is passed on.
    """
    go_on, now_on_port = steps.send, port.now
    # On a virtual clock no stop can arrive during a wait.
    looks = port.real_time
    try:
        effect = next(steps)
        while True:
            if isinstance(effect, Transaction):
                # The same code is in `LineRunner`: a shared function would make a read 10 % slower.
                now = now_on_port()
                if now < effect.free_at:
                    port.wait(effect.free_at)
                    now = now_on_port()
                data = port.read(now, 1)
                if not data:
                    effect.begun = now = now_on_port()
                    port.write(effect.data)
                    if effect.at_least:
                        if looks and effect.gives_way:
                            data = _receive(effect, now, port, stop_waits)
                        else:
                            data = port.read(effect.until, effect.at_least)
                effect = go_on(_new(Arrival, (now_on_port(), data, "")))
            elif looks and isinstance(effect, Receive) and effect.gives_way:
                data = _receive(effect, now_on_port(), port, stop_waits)
                effect = go_on(Arrival(now_on_port(), data))
            elif looks and isinstance(effect, Wait) and effect.gives_way:
                effect = go_on(_stay(effect.until, port, stop_waits))
            else:
                effect = go_on(carry_out(effect, port))
    except StopIteration as finished:
        result: T = finished.value
        return result
    finally:
        steps.close()


def _receive(effect: Receive | Transaction, now: float, port: Port, stop_waits: Callable[[], bool]) -> bytes:
    data, until, at_least = b"", effect.until, effect.at_least
    while True:
        data += port.read(min(until, _next_look(now)), at_least - len(data))
        now = port.now()
        if len(data) >= at_least or now >= until or stop_waits():
            return data


def _stay(until: float, port: Port, stop_waits: Callable[[], bool]) -> Arrival:
    while (now := port.now()) < until and not stop_waits():
        port.wait(min(until, _next_look(now)))
    return Arrival(now)


def _next_look(now: float) -> float:
    return now + (_LOOK_S if threading.active_count() > 1 else _LOOK_ALONE_S)
