"""Event loop whose time passes only while it is idle: hours of a server take only as long as its work.

A program gets all its time from here: `time.monotonic`, `time.time`, and through them every event loop. Work for a
thread is done in the loop after a random delay, so the same script runs the same way each time. Before time passes, the
loop waits for real threads that it still awaits, and for data sent into a socket, whose other end is in the same loop.
"""

import asyncio
import concurrent.futures
import random
import selectors
import socket
import time
from contextlib import contextmanager

import drivecomm.line.own_thread as own_thread_module

_LONGEST_THREAD_S = 5.0
"""Limit in real seconds for a thread; time passes without a thread that takes longer."""

_ARRIVES_S, _LOOKS = 0.0003, 3
"""Time in real seconds within which data sent into a socket arrives, and the number of checks in it."""
_LOOK_S = 1e-6
_THREADS_S = (0.0002, 0.0002, 0.001, 0.001, 0.005, 0.02, 0.2)

_SENDS = ("send", "sendmsg", "connect", "connect_ex", "shutdown", "close")
_real_monotonic, _real_sleep = time.monotonic, time.sleep


class Clocks:
    """The monotonic clock, and the wall clock, which can be set."""

    def __init__(self, seed="", begins=1000.0, wall=1_750_000_000.0):
        self.now, self._wall = begins, wall - begins
        self._chance = random.Random(seed)

    def monotonic(self):
        # Some code waits a few microseconds by polling the clock.
        self.now += _LOOK_S
        return self.now

    def wall(self):
        return self.now + self._wall

    def thread_s(self):
        """Return a random duration in seconds for work in a thread."""
        return self._chance.choice(_THREADS_S)

    def step_wall(self, seconds):
        """Step the wall clock forward or back."""
        self._wall += seconds


class _Selector:
    """Selector that, if nothing is ready, advances the time to the loop's next timer."""

    def __init__(self, clocks):
        self._selector, self._clocks = selectors.DefaultSelector(), clocks
        self.handed_over, self.on_its_way = 0, False

    def __getattr__(self, name):
        return getattr(self._selector, name)

    def select(self, timeout=None):
        ready = self._selector.select(0)
        if ready or (timeout is not None and timeout <= 0):
            return ready
        if self.on_its_way:
            for _ in range(_LOOKS):
                # A timeout of a selector is at least one millisecond, so sleep instead.
                _real_sleep(_ARRIVES_S / _LOOKS)
                if ready := self._selector.select(0):
                    return ready
            self.on_its_way = False
        until = _real_monotonic() + _LONGEST_THREAD_S
        while self.handed_over and _real_monotonic() < until:
            if ready := self._selector.select(0.05):
                return ready
        if timeout is None:
            # Without timers, only a real thread can wake the loop, such as one that ends by itself.
            if ready := self._selector.select(_LONGEST_THREAD_S):
                return ready
            raise RuntimeError("nothing would ever happen again in this loop")
        self._clocks.now += timeout
        return self._selector.select(0)


class CompressedLoop(asyncio.SelectorEventLoop):
    def __init__(self, clocks):
        self._waits = _Selector(clocks)
        super().__init__(self._waits)
        self._clock_resolution = 1e-7
        self.clocks = clocks

    def run_in_executor(self, executor, call, *values):
        del executor
        future = self.create_future()
        self.call_later(self.clocks.thread_s(), _carry_out, future, call, values, {})
        return future

    def handed(self, future):
        """Count a future that a thread completes."""
        if not future.done():
            self._waits.handed_over += 1
            future.add_done_callback(self._returned)

    def _returned(self, _):
        self._waits.handed_over -= 1


class InLoopThread:
    """Replacement of an executor with one thread."""

    def __init__(self, *_, **__):
        self._loop = asyncio.get_running_loop()

    def submit(self, call, *values, **options):
        future = concurrent.futures.Future()
        future.of_the_loop = True
        self._loop.call_later(self._loop.clocks.thread_s(), _carry_out, future, call, values, options)
        return future

    def shutdown(self, **_):
        pass


def _carry_out(future, call, values, options):
    if future.cancelled():
        return
    try:
        result = call(*values, **options)
    except Exception as error:  # noqa: BLE001 - raised where the future is awaited
        future.set_exception(error)
    else:
        future.set_result(result)


@contextmanager
def _noting_what_is_sent():
    """Make the running loop check its sockets again after data was sent into one."""
    before = {name: getattr(socket.socket, name) for name in _SENDS}
    own = set(_SENDS) & set(vars(socket.socket))

    def noting(call):
        def noted(self, *given):
            loop = asyncio._get_running_loop()
            if loop is not None:
                loop._waits.on_its_way = True
            return call(self, *given)

        return noted

    for name, call in before.items():
        setattr(socket.socket, name, noting(call))
    try:
        yield
    finally:
        for name, call in before.items():
            if name in own:
                setattr(socket.socket, name, call)
            else:
                delattr(socket.socket, name)


def run(clocks, work):
    """Run a coroutine with these clocks."""
    before = time.monotonic, time.time, time.thread_time, asyncio.wrap_future, asyncio.futures.wrap_future
    wrap, threadsafe = asyncio.wrap_future, asyncio.run_coroutine_threadsafe

    def wrap_future(future, *, loop=None):
        wrapped = wrap(future, loop=loop)
        # Time must not pass while a real thread works; futures completed by the loop itself are not counted.
        if wrapped is not future and not hasattr(future, "of_the_loop"):
            wrapped.get_loop().handed(wrapped)
        return wrapped

    def run_coroutine_threadsafe(coroutine, loop):
        future = threadsafe(coroutine, loop)
        future.of_the_loop = True
        return future

    own_threads = own_thread_module.ThreadPoolExecutor
    own_thread_module.ThreadPoolExecutor = InLoopThread
    time.monotonic, time.time, time.thread_time = clocks.monotonic, clocks.wall, clocks.monotonic
    asyncio.wrap_future = asyncio.futures.wrap_future = wrap_future
    asyncio.run_coroutine_threadsafe = run_coroutine_threadsafe
    try:
        with _noting_what_is_sent(), asyncio.Runner(loop_factory=lambda: CompressedLoop(clocks)) as runner:
            return runner.run(work)
    finally:
        time.monotonic, time.time, time.thread_time, asyncio.wrap_future, asyncio.futures.wrap_future = before
        asyncio.run_coroutine_threadsafe = threadsafe
        own_thread_module.ThreadPoolExecutor = own_threads
