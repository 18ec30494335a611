"""The asyncio runners: carry out the effects of a link while other tasks go on.

Three kinds, by what the port offers: a descriptor that the event loop watches, nothing but blocking calls, or a virtual
clock on which waiting takes no time. One runner serves one open port and runs one exchange at a time.
"""

from __future__ import annotations

import asyncio
from concurrent.futures import ThreadPoolExecutor
from threading import Event
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from drivecomm.errors import LinkDownError
from drivecomm.link import Arrival, PortProxy, Receive, Talk, Wait, taken_apart
from drivecomm.transport.alarm import open_alarm
from drivecomm.transport.blocking_runner import carry_out, run as run_blocking

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.link import Effect, Port, Steps

T = TypeVar("T")

# Less than it costs to go to sleep and be woken.
_NOT_WORTH_SLEEPING_S = 0.00003
# About what passes between an alarm and its being heard.
_LEAD_S = 0.000025
# More than a line can leave behind between two exchanges; who talks without end is not kept.
_MOST_UNASKED = 4096
_SLICE_S = 0.05


def _never() -> bool:
    return False


class Runner(Protocol):
    """Runs the steps of a link on one port."""

    async def run(self, begin: Callable[[float], Steps[T]], stop_waits: Callable[[], bool] = _never) -> T:
        """Run them to their end and return their result; cancelling closes them.

        begin: returns the steps, given the time. stop_waits: tells whether a stop waits for the line; waiting that
        gives way then ends early.
        """

    def look(self) -> None:
        """Look whether a stop waits for the line."""

    def close(self) -> None:
        """Let go of the port, without closing it."""


def runner_for(port: Port) -> Runner:
    """Return the runner that suits this port, in the running event loop."""
    if not port.real_time:
        return VirtualTimeRunner(port)
    if port.descriptor is None:
        return ThreadRunner(port)
    try:
        return ReadinessRunner(port, port.descriptor)
    except NotImplementedError:
        # An event loop that watches no descriptors, as one of Windows.
        return ThreadRunner(port)


class VirtualTimeRunner:
    """For ports whose waiting takes no time; lets other tasks go on between any two effects."""

    def __init__(self, port: Port) -> None:
        self._port = port

    async def run(self, begin: Callable[[float], Steps[T]], stop_waits: Callable[[], bool] = _never) -> T:  # noqa: ARG002 - it never waits
        """Run the steps of a link to their end."""
        # Others run before the first telegram, too, so that a stop of theirs goes before it.
        await asyncio.sleep(0)
        now = self._port.now()
        steps = taken_apart(begin(now), now)
        try:
            effect = next(steps)
            while True:
                await asyncio.sleep(0)
                effect = steps.send(carry_out(effect, self._port))
        except StopIteration as finished:
            result: T = finished.value
            return result
        finally:
            steps.close()

    def look(self) -> None:
        """Nothing to look for: waiting takes no time."""

    def close(self) -> None:
        """Nothing to let go of."""


class ThreadRunner:
    """For ports that know only blocking calls: a thread of its own carries out the effects."""

    def __init__(self, port: Port) -> None:
        self._port = port
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="drivecomm")

    async def run(self, begin: Callable[[float], Steps[T]], stop_waits: Callable[[], bool] = _never) -> T:
        """Run the steps of a link to their end."""
        stop = Event()
        running = asyncio.get_running_loop().run_in_executor(
            self._thread, run_blocking, begin, _Interruptible(self._port, stop), stop_waits
        )
        try:
            return await asyncio.shield(running)
        except asyncio.CancelledError:
            stop.set()
            while not running.done():
                # The line is handed on only when the thread has let go of it, however often somebody cancels.
                try:
                    await asyncio.wait([running])
                except asyncio.CancelledError:
                    continue
            if not running.cancelled():
                running.exception()
            raise

    def look(self) -> None:
        """Nothing to do: the thread looks by itself."""

    def close(self) -> None:
        """End the thread."""
        self._thread.shutdown(wait=False)


class _StoppedError(Exception):
    """Somebody cancelled the exchange that a thread carries out."""


class _Interruptible(PortProxy):
    """A port whose waiting ends when an event is set."""

    def __init__(self, port: Port, stop: Event) -> None:
        super().__init__(port)
        self._stop = stop

    def read(self, until: float, at_least: int) -> bytes:
        """Return what comes."""
        came = b""
        while True:
            self._check()
            came += self._port.read(min(until, self.now() + _SLICE_S), at_least - len(came))
            if len(came) >= at_least or self.now() >= until:
                return came

    def wait(self, until: float) -> None:
        """Let time pass."""
        while self.now() < until:
            self._check()
            self._port.wait(min(until, self.now() + _SLICE_S))

    def _check(self) -> None:
        if self._stop.is_set():
            raise _StoppedError


class ReadinessRunner:
    """For ports with a descriptor: the event loop watches it, and a whole exchange wakes the caller's task once."""

    def __init__(self, port: Port, descriptor: int) -> None:
        self._port = port
        self._descriptor = descriptor
        self._loop = asyncio.get_running_loop()
        self._steps: Steps[Any] | None = None
        self._stop_waits: Callable[[], bool] = _never
        self._result: asyncio.Future[Any] | None = None
        self._inbox = b""
        self._waiting: Receive | Wait | None = None
        self._talk: Talk | None = None
        self._lost: LinkDownError | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._alarm = open_alarm()
        if self._alarm is not None:
            self._loop.add_reader(self._alarm.descriptor, self._alarmed)
        self._loop.add_reader(descriptor, self._readable)
        self._watched = True

    async def run(self, begin: Callable[[float], Steps[T]], stop_waits: Callable[[], bool] = _never) -> T:
        """Run the steps of a link to their end."""
        if self._lost is not None:
            raise self._lost
        steps = begin(self._port.now())
        self._steps, self._stop_waits = steps, stop_waits
        self._result = result = self._loop.create_future()
        self._go_on(None)
        try:
            answer: T = await result
            return answer
        finally:
            self._steps = self._waiting = self._talk = self._result = None
            steps.close()

    def look(self) -> None:
        """Look whether a stop waits for the line, as soon as whoever calls this does."""
        self._loop.call_soon(self._give_way)

    def _give_way(self) -> None:
        waiting = self._waiting
        if waiting is not None and waiting.gives_way and self._stop_waits():
            self._go_on(self._arrival() if isinstance(waiting, Receive) else Arrival(self._port.now()))

    def close(self) -> None:
        """Watch the port no more."""
        if self._watched:
            self._loop.remove_reader(self._descriptor)
            self._watched = False
        if self._timer is not None:
            self._timer.cancel()
        if self._alarm is not None:
            self._loop.remove_reader(self._alarm.descriptor)
            self._alarm.close()
            self._alarm = None

    def _go_on(self, arrival: Arrival | None) -> None:
        """Carry out effects until one must wait."""
        steps, result, port = self._steps, self._result, self._port
        if steps is None or result is None or result.done():
            return
        self._waiting = None
        try:
            while True:
                effect: Effect = self._talk or steps.send(arrival)  # type: ignore[arg-type]
                self._talk = None
                if isinstance(effect, Talk):
                    if effect.free_at - port.now() > _NOT_WORTH_SLEEPING_S:
                        self._talk, self._waiting = effect, Wait(effect.free_at)
                        self._wake_precisely(effect.free_at)
                        return
                    arrival = self._begin(effect)
                    if arrival is not None:
                        continue
                    effect = Receive(effect.until, effect.at_least, effect.gives_way)
                if isinstance(effect, Receive):
                    until, at_least, gives_way = effect
                    if port.now() >= until:
                        # Mostly there is nothing, and `read` finds that out without an exception.
                        self._inbox += port.read(until, 1)
                    elif len(self._inbox) < at_least and not (gives_way and self._stop_waits()):
                        port.hold_back(at_least - len(self._inbox))
                        self._waiting = effect
                        self._wake_at(until)
                        return
                    arrival = self._arrival()
                elif not isinstance(effect, Wait):
                    arrival = carry_out(effect, port)
                else:
                    until = effect.until
                    left = until - port.now()
                    if effect.gives_way and self._stop_waits():
                        arrival = Arrival(port.now())
                        continue
                    if left > _NOT_WORTH_SLEEPING_S:
                        self._waiting = effect
                        self._wake_precisely(until)
                        return
                    while port.now() < until:
                        pass
                    arrival = Arrival(port.now())
        except StopIteration as finished:
            result.set_result(finished.value)
        except Exception as error:  # noqa: BLE001 - it belongs to the task that waits for the result
            if isinstance(error, LinkDownError):
                self._lost = error
            result.set_exception(error)

    def _begin(self, talk: Talk) -> Arrival | None:
        """Send a request when the line is free; return what came of it where no reply is waited for."""
        port = self._port
        while (now := port.now()) < talk.free_at:
            pass
        self._inbox += port.read(now, 1)
        if self._inbox:
            return self._arrival()
        talk.begun = port.now()
        port.write(talk.data)
        return None if talk.at_least else Arrival(port.now())

    def _arrival(self) -> Arrival:
        data, self._inbox = self._inbox, b""
        return Arrival(self._port.now(), data)

    def _readable(self) -> None:
        try:
            self._inbox += self._port.take()
        except LinkDownError as error:
            self._loop.remove_reader(self._descriptor)
            self._watched = False
            self._lost = error
            if self._result is not None and not self._result.done():
                self._result.set_exception(error)
            return
        waiting = self._waiting
        if isinstance(waiting, Receive):
            if len(self._inbox) >= waiting.at_least:
                self._go_on(self._arrival())
        elif len(self._inbox) > _MOST_UNASKED:
            self._inbox = self._inbox[-_MOST_UNASKED:]

    def _wake_at(self, until: float) -> None:
        # An earlier timer is left to fire and then set anew: most replies come long before it.
        if self._timer is not None:
            if self._timer.when() <= until:
                return
            self._timer.cancel()
        self._timer = self._loop.call_at(until, self._timed)

    def _timed(self) -> None:
        self._timer = None
        waiting = self._waiting
        if waiting is None:
            return
        if self._port.now() < waiting.until:
            self._wake_at(waiting.until)
        elif isinstance(waiting, Receive):
            try:
                # What is there may be less than was waited for.
                self._inbox += self._port.take()
            except LinkDownError:
                self._readable()
                return
            self._go_on(self._arrival())
        else:
            self._go_on(Arrival(self._port.now()))

    def _wake_precisely(self, until: float) -> None:
        if self._alarm is None:
            self._wake_at(until)
        else:
            self._alarm.set(until - _LEAD_S)

    def _alarmed(self) -> None:
        if self._alarm is None:
            return
        waiting = self._waiting
        if isinstance(waiting, Wait):
            now = self._port.now()
            if waiting.until - now > _NOT_WORTH_SLEEPING_S:
                self._alarm.set(waiting.until - _LEAD_S)
                return
            # On a busy loop, whose time is precious, the alarm is heard too late for this to go round even once.
            while now < waiting.until:
                now = self._port.now()
            self._go_on(Arrival(now))
            if isinstance(self._waiting, Wait):
                # It has been set anew.
                return
        if self._alarm is not None:
            self._alarm.clear()
