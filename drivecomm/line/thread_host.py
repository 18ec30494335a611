"""The blocking runner: carries out the effects of a link on a port, one after the other.

Real time or virtual time is the port's affair: a virtual line's port has a virtual clock.
"""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, TypeVar

from drivecomm.link import Arrival, Configure, Receive, Send, Talk, Wait

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.link import Effect, Port, Steps

T = TypeVar("T")


# A NamedTuple's own constructor is a function of Python's.
_new = tuple.__new__

_LOOK_S, _LOOK_ALONE_S = 0.01, 0.05
"""How often a wait that gives way looks whether a stop waits for the line; alone: while there is no other thread.

Then nobody but a signal's handler or a thread that Python has not made could stop anything, and an idle processor takes
as long to wake up for a look as for a whole read.
"""


def run(begin: Callable[[float], Steps[T]], port: Port, stop_waits: Callable[[], bool] = lambda: False) -> T:
    """Run a link's steps to their end on a port and return their result.

    begin: returns the steps, given the time. stop_waits: tells whether a stop waits for the line; waiting that gives
    way then ends early. An exception of the port, or Ctrl-C, closes the steps and passes through.
    """
    return run_steps(begin(port.now()), port, stop_waits)


def run_steps(steps: Steps[T], port: Port, stop_waits: Callable[[], bool]) -> T:
    """Run steps that have just begun, as `run` does."""
    go_on = steps.send
    # Where time does not pass by itself, nobody can come meanwhile.
    looks = port.real_time
    try:
        effect = next(steps)
        while True:
            if type(effect) is Talk:
                effect = go_on(_talk(effect, port, stop_waits if looks else None))
            elif looks and isinstance(effect, Receive) and effect.gives_way:
                data = _receive(effect, port.now(), port, stop_waits)
                effect = go_on(Arrival(port.now(), data))
            elif looks and isinstance(effect, Wait) and effect.gives_way:
                effect = go_on(_stay(effect.until, port, stop_waits))
            else:
                effect = go_on(carry_out(effect, port))
    except StopIteration as finished:
        result: T = finished.value
        return result
    finally:
        steps.close()


def _talk(talk: Talk, port: Port, stop_waits: Callable[[], bool] | None = None) -> Arrival:
    now = port.now()
    if now < talk.free_at:
        port.wait(talk.free_at)
        now = port.now()
    data = port.read(now, 1)
    if not data:
        talk.begun = now = port.now()
        port.write(talk.data)
        if talk.at_least:
            if stop_waits is not None and talk.gives_way:
                data = _receive(talk, now, port, stop_waits)
            else:
                data = port.read(talk.until, talk.at_least)
    return _new(Arrival, (port.now(), data, ""))


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


def carry_out(effect: Effect, port: Port) -> Arrival:
    """Carry out one effect, waiting as long as it says, and return what came of it."""
    if isinstance(effect, Talk):
        return _talk(effect, port)
    if isinstance(effect, Receive):
        data = port.read(effect.until, effect.at_least)
        return Arrival(port.now(), data)
    if isinstance(effect, Send):
        port.write(effect.data)
        return Arrival(port.now())
    if isinstance(effect, Configure):
        note = port.configure(effect.settings)
        return Arrival(port.now(), b"", note)
    now = port.now()
    if now < effect.until:
        port.wait(effect.until)
        now = port.now()
    return Arrival(now)
