"""The blocking and the asyncio API of a bus in one test: each awaited call is run to its end, as if it blocked."""

from __future__ import annotations

import asyncio
import atexit
import inspect
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace

import pytest

import drivecomm
from drivecomm.bus import AsyncBroadcast, AsyncBus, AsyncDrive, carry_out, carry_out_async, keep, keep_async
from drivecomm.client import AsyncServedBus
from drivecomm.plant import async_bus_of_server, bus_of_server

FACES = ("threads", "tasks")
each_face = pytest.mark.parametrize("face", FACES)


def open_on(face, port, **options):
    """Open a bus with one API; the result is used like a `Bus`."""
    if face == "threads":
        return drivecomm.open_bus(port, **options)
    bus = drivecomm.open_bus_async(port, **options)
    _run(bus.__aenter__())
    return _blocking(bus)


def reach_on(face, port, **options):
    """Reach a port's line through the server that owns it, with one API."""
    if face == "threads":
        return bus_of_server(port, **options)
    bus = async_bus_of_server(port, **options)
    _run(bus.__aenter__())
    return _blocking(bus)


@contextmanager
def own_threads():
    """Give the event loop threads that end with the block."""
    with ThreadPoolExecutor() as threads:
        _loop.set_default_executor(threads)
        yield
    _loop.set_default_executor(ThreadPoolExecutor())


@contextmanager
def keep_on(drive, *arguments, **options):
    """Keep a motor with the API of its drive."""
    if not isinstance(drive, _Awaited):
        with keep(drive, *arguments, **options) as kept:
            yield kept
        return
    keeping = keep_async(_inner(drive), *arguments, **options)
    kept = _run(keeping.__aenter__())
    try:
        yield _Awaited(kept)
    except BaseException as error:
        if not _run(keeping.__aexit__(type(error), error, error.__traceback__)):
            raise
    else:
        _run(keeping.__aexit__(None, None, None))


def carry_out_on(drive, procedure):
    """Carry out a procedure with the API of a drive."""
    if isinstance(drive, _Awaited):
        return _run(carry_out_async(_inner(drive), procedure))
    return carry_out(drive, procedure)


def poll_on(face, items, **options):
    """Yield the results of a poll plan for drives on any number of buses of one API."""
    if face == "threads":
        return drivecomm.poll(items, **options)
    return _generated(drivecomm.poll_async(_awaited_items(items), **options))


class _Awaited:
    """Wrapper of an object of the asyncio API that is used as if its calls blocked."""

    def __init__(self, inner):
        object.__setattr__(self, "_inner", inner)

    def __getattr__(self, name):
        return _blocking(getattr(self._inner, name))

    def __setattr__(self, name, value):
        setattr(self._inner, name, _awaited(value) if callable(value) else value)

    def __eq__(self, other):
        return self._inner is _inner(other)

    def __repr__(self):
        return repr(self._inner)

    __hash__ = None


class _AwaitedBus(_Awaited):
    def poll(self, items, **options):
        return _generated(self._inner.poll(_awaited_items(items), **options))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


def _awaited_items(items):
    return [replace(item, drive=_inner(item.drive)) for item in items]


def _inner(value):
    return object.__getattribute__(value, "_inner") if isinstance(value, _Awaited) else value


def _blocking(value):
    if inspect.iscoroutine(value):
        return _blocking(_run(value))
    if inspect.isasyncgen(value):
        return _generated(value)
    if isinstance(value, AsyncBus | AsyncServedBus):
        return _AwaitedBus(value)
    if isinstance(value, AsyncDrive | AsyncBroadcast):
        return _Awaited(value)
    if inspect.isroutine(value):
        return lambda *arguments, **options: _blocking(value(*arguments, **options))
    return value


def _awaited(call):
    async def called(*arguments, **options):
        return call(*arguments, **options)

    return called


def _generated(results):
    try:
        while True:
            try:
                result = _run(anext(results))
            except StopAsyncIteration:
                return
            yield result
    finally:
        _run(results.aclose())


# Created before any test counts the resources that it leaves behind.
_loop = asyncio.new_event_loop()
atexit.register(_loop.close)


def _run(awaitable):
    async def run():
        return await awaitable

    return _loop.run_until_complete(run())
