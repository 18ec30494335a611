"""Hosts that wait for a port while other tasks of an event loop continue.

There are three kinds, by what the port offers: a descriptor that the event loop watches, only blocking calls, or a
virtual clock on which waiting takes no time. One host serves one open port and runs one exchange at a time.
"""

from __future__ import annotations

import asyncio
from concurrent.futures import ThreadPoolExecutor
from threading import Event
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from drivecomm.errors import LinkDownError
from drivecomm.line.effects import carry_out
from drivecomm.line.lent_port import LentPort
from drivecomm.line.runner import LineRunner
from drivecomm.line.thread_host import run_steps
from drivecomm.line.uncancelled import result_of
from drivecomm.link import split_transactions
from drivecomm.transport import open_timer

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.link import LinkSteps, Port

T = TypeVar("T")

# Typical delay between the end of the kernel timer and the wake-up of the event loop.
_LEAD_S = 0.000025


def _never() -> bool:
    return False


class TaskHost(Protocol):
    """Host that runs the steps of a link on one port."""

    async def run(self, begin: Callable[[float], LinkSteps[T]], stop_waits: Callable[[], bool] = _never) -> T:
        """Run steps to their end and return their result; a cancellation closes them.

        begin: returns the steps, given the time. stop_waits: returns whether a stop waits for the line; a wait that
        gives way then ends early.
        """

    def look(self) -> None:
        """Check whether a stop waits for the line."""

    def close(self) -> None:
        """Stop using the port, without closing it."""


def task_host_for(port: Port) -> TaskHost:
    """Return a host that suits this port, in the running event loop."""
    if not port.real_time:
        return VirtualTimeHost(port)
    if port.descriptor is None:
        return OwnThreadHost(port)
    try:
        return ReadinessHost(port, port.descriptor)
    except NotImplementedError:
        # Some event loops, such as one of Windows, cannot watch descriptors.
        return OwnThreadHost(port)


class VirtualTimeHost:
    """Host of ports on which waiting takes no time; other tasks run between any two effects."""

    def __init__(self, port: Port) -> None:
        self._port = port

    async def run(self, begin: Callable[[float], LinkSteps[T]], stop_waits: Callable[[], bool] = _never) -> T:  # noqa: ARG002 - it never waits
        """Run the steps of a link to their end."""
        # Let other tasks run before the first telegram, too, so that a stop of theirs goes first.
        await asyncio.sleep(0)
        now = self._port.now()
        steps = split_transactions(begin(now), now)
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
        """Do nothing, because waiting takes no time."""

    def close(self) -> None:
        """Do nothing, because this host holds no resources."""


class OwnThreadHost:
    """Host of ports with blocking calls only: a thread of its own carries out the effects."""

    def __init__(self, port: Port) -> None:
        self._port = port
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="drivecomm")

    async def run(self, begin: Callable[[float], LinkSteps[T]], stop_waits: Callable[[], bool] = _never) -> T:
        """Run the steps of a link to their end."""
        stop = Event()

        def check() -> None:
            if stop.is_set():
                raise _StoppedError

        running = asyncio.get_running_loop().run_in_executor(
            self._thread, run_steps, begin(self._port.now()), LentPort(self._port, check), stop_waits
        )
        try:
            return await result_of(running)
        except asyncio.CancelledError:
            stop.set()
            while not running.done():
                # Pass on the line only after the thread has released it, even after repeated cancellation.
                try:
                    await asyncio.wait([running])
                except asyncio.CancelledError:
                    continue
            raise

    def look(self) -> None:
        """Do nothing, because the thread polls for stops."""

    def close(self) -> None:
        """End the thread."""
        self._thread.shutdown(wait=False)


class _StoppedError(Exception):
    """Raised in the thread of a host when its exchange was cancelled."""


class ReadinessHost:
    """Host of ports with a descriptor: the event loop watches it, and a whole exchange wakes the caller's task once."""

    def __init__(self, port: Port, descriptor: int) -> None:
        self._port = port
        self._descriptor = descriptor
        self._loop = asyncio.get_running_loop()
        self._runner = LineRunner(port, self._wake_at, self._wake_precisely, self._ended, self._port_lost)
        self._result: asyncio.Future[Any] | None = None
        self._lost: LinkDownError | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._alarm = open_timer()
        self._alarm_set = False
        if self._alarm is not None:
            self._loop.add_reader(self._alarm.descriptor, self._alarmed)
        self._loop.add_reader(descriptor, self._readable)
        self._watched = True

    async def run(self, begin: Callable[[float], LinkSteps[T]], stop_waits: Callable[[], bool] = _never) -> T:
        """Run the steps of a link to their end."""
        if self._lost is not None:
            raise self._lost
        self._result = result = self._loop.create_future()
        self._runner.begin(begin(self._port.now()), stop_waits)
        try:
            answer: T = await result
            return answer
        finally:
            self._result = None
            self._runner.cut_off()

    def look(self) -> None:
        """Check whether a stop waits for the line, as soon as the calling task pauses."""
        self._loop.call_soon(self._give_way)

    def _give_way(self) -> None:
        self._look_whether_cancelled()
        self._runner.give_way()

    def close(self) -> None:
        """Stop watching the port."""
        self._watch_no_more()
        if self._timer is not None:
            self._timer.cancel()
        if self._alarm is not None:
            self._loop.remove_reader(self._alarm.descriptor)
            self._alarm.close()
            self._alarm = None

    def _ended(self, result: Any, error: Exception | None) -> None:
        if isinstance(error, LinkDownError):
            self._lost = error
        waiting = self._result
        if waiting is None or waiting.done():
            return
        if error is None:
            waiting.set_result(result)
        else:
            waiting.set_exception(error)

    def _look_whether_cancelled(self) -> None:
        # A cancelled task does not run before its turn in the event loop; send nothing more for it until then.
        if self._result is not None and self._result.cancelled():
            self._runner.cut_off()

    def _readable(self) -> None:
        self._look_whether_cancelled()
        self._runner.readable()

    def _port_lost(self, error: LinkDownError) -> None:
        self._watch_no_more()
        self._lost = error

    def _watch_no_more(self) -> None:
        if self._watched:
            self._loop.remove_reader(self._descriptor)
            self._watched = False

    def _wake_at(self, until: float) -> None:
        # Keep an earlier timer, and set it anew when it fires: most replies come long before it.
        if self._timer is not None:
            if self._timer.when() <= until:
                return
            self._timer.cancel()
        self._timer = self._loop.call_at(until, self._timed)

    def _timed(self) -> None:
        self._timer = None
        self._look_whether_cancelled()
        self._runner.time_passed()

    def _wake_precisely(self, until: float) -> None:
        if self._alarm is None:
            self._wake_at(until)
        else:
            self._alarm_set = True
            self._alarm.set(until - _LEAD_S)

    def _alarmed(self) -> None:
        self._alarm_set = False
        self._look_whether_cancelled()
        self._runner.time_passed()
        if self._alarm is not None and not self._alarm_set:
            # The timer stays readable until it is cleared or set again.
            self._alarm.clear()
