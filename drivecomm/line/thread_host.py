"""Carries out the steps of a link in the caller's own thread: nothing passes from thread to thread.

Real time or virtual time is the port's affair: a virtual line's port has a virtual clock.
"""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, TypeVar

from drivecomm.line.effects import carry_out
from drivecomm.link import Arrival, Receive, Talk, Wait

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.link import Port, Steps

T = TypeVar("T")


# A NamedTuple's own constructor is a function of Python's.
_new = tuple.__new__

_LOOK_S, _LOOK_ALONE_S = 0.01, 0.05
"""How often a wait that gives way looks whether a stop waits for the line; alone: while there is no other thread.

Then nobody but a signal's handler or a thread that Python has not made could stop anything, and an idle processor takes
as long to wake up for a look as for a whole read.
"""


def run_steps(steps: Steps[T], port: Port, stop_waits: Callable[[], bool]) -> T:
    """Run the steps of a link to their end on a port and return their result.

    stop_waits: tells whether a stop waits for the line; waiting that gives way then ends early. An exception of the
    port, or Ctrl-C, closes the steps and passes through.
    """
    go_on, now_on_port = steps.send, port.now
    # Where time does not pass by itself, nobody can come meanwhile.
    looks = port.real_time
    try:
        effect = next(steps)
        while True:
            if isinstance(effect, Talk):
                # `LineRunner` does the same; calling one function for both costs a tenth of a read.
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


def _receive(effect: Receive | Talk, now: float, port: Port, stop_waits: Callable[[], bool]) -> bytes:
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
