"""What is done with a drive step by step, written once for callers that block and callers that await.

A procedure is a generator: it yields a step, is sent what came of it, and returns its result. What goes wrong is thrown
in at the yield. Between two steps others may use the line; what must not be cut in two is an exchange.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from inspect import isawaitable
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

if TYPE_CHECKING:
    from drivecomm.bus.faces import Awaited, Blocking
    from drivecomm.protocol import Stop, Value

T = TypeVar("T")

Action: TypeAlias = Callable[[Any], Any]
"""Does something with a drive, and returns what came of it or what is to be awaited."""

Procedure: TypeAlias = Generator[Action, Any, T]
"""An operation of several steps, for both kinds of bus: it yields steps and is sent what came of them."""

_NO_OPTIONS: Mapping[str, Any] = {}


def read_parameter(parameter: str, options: Mapping[str, Any] = _NO_OPTIONS) -> Action:
    """Read a parameter; a Reading is sent back."""
    return lambda drive: drive.read(parameter, **options)


def write_parameter(parameter: str, value: Value, *, store: bool, options: Mapping[str, Any] = _NO_OPTIONS) -> Action:
    """Write a parameter."""
    return lambda drive: drive.write(parameter, value, store=store, **options)


def check_write(parameter: str, value: Value, *, store: bool, options: Mapping[str, Any] = _NO_OPTIONS) -> Action:
    """See whether a write could be sent; sends nothing."""
    return lambda drive: drive.check_write(parameter, value, store=store, **options)


def ask_status() -> Action:
    """Read the status; a DriveStatus is sent back."""
    return lambda drive: drive.status()


def ask_identity() -> Action:
    """Read what the drive tells of itself; names and texts are sent back."""
    return lambda drive: drive.identify()


def note_watchdog(silence_s: float | None) -> Action:
    """Say how long the drive's watchdog waits, see `Drive.watched`."""
    return lambda drive: drive.watched(silence_s)


def stop_motor(how: Stop) -> Action:
    """Stop the motor."""
    return lambda drive: drive.stop(how)


def sleep_until(until: float) -> Action:
    """Let time pass on the clock of the drive's line."""
    return lambda drive: drive.bus.sleep_until(until)


def carry_out(drive: Blocking, procedure: Procedure[T]) -> T:
    """Carry out a procedure with a drive, and return its result."""
    try:
        step = next(procedure)
        while True:
            try:
                came = step(drive)
            except Exception as error:  # noqa: BLE001 - the procedure decides what to do about it
                step = procedure.throw(error)
            else:
                step = procedure.send(came)
    except StopIteration as end:
        result: T = end.value
        return result
    finally:
        procedure.close()


async def carry_out_async(drive: Awaited, procedure: Procedure[T]) -> T:
    """Carry out a procedure with a drive, awaiting each step, and return its result."""
    try:
        step = next(procedure)
        while True:
            try:
                came = step(drive)
                if isawaitable(came):
                    came = await came
            except Exception as error:  # noqa: BLE001 - the procedure decides what to do about it
                step = procedure.throw(error)
            else:
                step = procedure.send(came)
    except StopIteration as end:
        result: T = end.value
        return result
    finally:
        procedure.close()
