"""The blocking runner: carries out the effects of a link on a port, one after the other.

Real time or virtual time is the port's affair: a virtual line's port has a virtual clock.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

from drivecomm.link import Arrival, Configure, Receive, Send

if TYPE_CHECKING:
    from drivecomm.link import Effect, Steps
    from drivecomm.runners.port import Port

T = TypeVar("T")


def run(steps: Steps[T], port: Port) -> T:
    """Run a link's steps to their end on a port and return their result.

    An exception of the port, or Ctrl-C, closes the steps and passes through.
    """
    go_on = steps.send
    try:
        effect = next(steps)
        while True:
            # What nearly all effects are is carried out here: a processor that has just been woken takes several times
            # as long for each call as one that is at it, and most of this lies between a reply and the next request.
            if isinstance(effect, Receive):
                data = port.read(effect.until, effect.at_least)
                effect = go_on(Arrival(port.now(), data))
            else:
                effect = go_on(carry_out(effect, port))
    except StopIteration as finished:
        result: T = finished.value
        return result
    finally:
        steps.close()


def carry_out(effect: Effect, port: Port) -> Arrival:
    """Carry out one effect, waiting as long as it says, and return what came of it."""
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
