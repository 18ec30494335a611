"""What is done with a drive step by step, written once for callers that block and callers that await.

A procedure is a generator: it yields a step, is sent what came of it, and returns its result. What goes wrong is thrown
in at the yield. Between two steps others may use the line; what must not be cut in two is an exchange.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass, field
from inspect import isawaitable
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

if TYPE_CHECKING:
    from drivecomm.bus.faces import Awaited, Blocking
    from drivecomm.protocol import Stop, Value

T = TypeVar("T")

Step: TypeAlias = Callable[[Any], Any]
"""Does something with a drive, and returns what came of it or what is to be awaited."""

Procedure: TypeAlias = Generator[Step, Any, T]


@dataclass(frozen=True, slots=True)
class Read:
    """Read a parameter; a Reading is sent back."""

    parameter: str
    options: Mapping[str, Any] = field(default_factory=dict)

    def __call__(self, drive: Any) -> Any:
        """Do it with this drive."""
        return drive.read(self.parameter, **self.options)


@dataclass(frozen=True, slots=True)
class Write:
    """Write a parameter."""

    parameter: str
    value: Value
    store: bool
    options: Mapping[str, Any] = field(default_factory=dict)

    def __call__(self, drive: Any) -> Any:
        """Do it with this drive."""
        return drive.write(self.parameter, self.value, store=self.store, **self.options)


@dataclass(frozen=True, slots=True)
class CheckWrite:
    """See whether a write could be sent; sends nothing."""

    parameter: str
    value: Value
    store: bool
    options: Mapping[str, Any] = field(default_factory=dict)

    def __call__(self, drive: Any) -> Any:
        """Do it with this drive."""
        return drive.check_write(self.parameter, self.value, store=self.store, **self.options)


@dataclass(frozen=True, slots=True)
class AskStatus:
    """Read the status; a DriveStatus is sent back."""

    def __call__(self, drive: Any) -> Any:
        """Do it with this drive."""
        return drive.status()


@dataclass(frozen=True, slots=True)
class AskIdentity:
    """Read what the drive tells of itself; names and texts are sent back."""

    def __call__(self, drive: Any) -> Any:
        """Do it with this drive."""
        return drive.identify()


@dataclass(frozen=True, slots=True)
class Watched:
    """Say how long the drive's watchdog waits, see `Drive.watched`."""

    silence_s: float | None

    def __call__(self, drive: Any) -> Any:
        """Do it with this drive."""
        return drive.watched(self.silence_s)


@dataclass(frozen=True, slots=True)
class StopMotor:
    """Stop the motor."""

    how: Stop

    def __call__(self, drive: Any) -> Any:
        """Do it with this drive."""
        return drive.stop(self.how)


@dataclass(frozen=True, slots=True)
class SleepUntil:
    """Let time pass on the clock of the drive's line."""

    until: float

    def __call__(self, drive: Any) -> Any:
        """Do it with this drive."""
        return drive.bus.sleep_until(self.until)


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
