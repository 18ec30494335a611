"""What is done with a drive one after the other, as steps that a caller who blocks and one who awaits carry out alike.

A row of steps is a generator: it yields a step, is sent what came of it, and returns its result. What goes wrong is
thrown in at the yield. Between two steps others may use the line; what must not be cut in two is an exchange.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from dataclasses import dataclass, field
from inspect import isawaitable
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, TypeVar

from drivecomm.errors import DriveCommError

if TYPE_CHECKING:
    from drivecomm.bus.async_drive import AsyncDrive
    from drivecomm.bus.drive import Drive
    from drivecomm.protocol import Stop, Value

T = TypeVar("T")


class Step(Protocol):
    """Something that is done with a drive."""

    def on(self, drive: Drive | AsyncDrive) -> Any:
        """Do it and return what came of it, or return what is to be awaited."""
        ...


Steps: TypeAlias = Generator[Step, Any, T]
"""An operation of several steps, for both kinds of bus: it yields steps and is sent what came of them."""


@dataclass(frozen=True, slots=True)
class Read:
    """Read a parameter; a Reading is sent back."""

    parameter: str
    options: Mapping[str, Any] = field(default_factory=dict)

    def on(self, drive: Drive | AsyncDrive) -> Any:
        """Do it."""
        return drive.read(self.parameter, **self.options)


@dataclass(frozen=True, slots=True)
class Write:
    """Write a parameter."""

    parameter: str
    value: Value
    store: bool
    options: Mapping[str, Any] = field(default_factory=dict)

    def on(self, drive: Drive | AsyncDrive) -> Any:
        """Do it."""
        return drive.write(self.parameter, self.value, store=self.store, **self.options)


@dataclass(frozen=True, slots=True)
class CheckWrite:
    """See whether a write could be sent; sends nothing."""

    parameter: str
    value: Value
    store: bool
    options: Mapping[str, Any] = field(default_factory=dict)

    def on(self, drive: Drive | AsyncDrive) -> Any:
        """Do it."""
        return drive.check_write(self.parameter, self.value, store=self.store, **self.options)


@dataclass(frozen=True, slots=True)
class AskStatus:
    """Read the status; a DriveStatus is sent back."""

    def on(self, drive: Drive | AsyncDrive) -> Any:
        """Do it."""
        return drive.status()


@dataclass(frozen=True, slots=True)
class AskIdentity:
    """Read what the drive tells of itself; names and texts are sent back."""

    def on(self, drive: Drive | AsyncDrive) -> Any:
        """Do it."""
        return drive.identify()


@dataclass(frozen=True, slots=True)
class Watched:
    """Say how long the drive's watchdog waits, see `Drive.watched`."""

    silence_s: float | None

    def on(self, drive: Drive | AsyncDrive) -> Any:
        """Do it."""
        return drive.watched(self.silence_s)


@dataclass(frozen=True, slots=True)
class StopMotor:
    """Stop the motor."""

    how: Stop

    def on(self, drive: Drive | AsyncDrive) -> Any:
        """Do it."""
        return drive.stop(self.how)


def carry_out(drive: Drive, steps: Steps[T]) -> T:
    """Carry out steps with a drive, and return their result."""
    try:
        step = next(steps)
        while True:
            try:
                came = step.on(drive)
            except DriveCommError as error:
                step = steps.throw(error)
            else:
                step = steps.send(came)
    except StopIteration as end:
        result: T = end.value
        return result
    finally:
        steps.close()


async def carry_out_async(drive: AsyncDrive, steps: Steps[T]) -> T:
    """Carry out steps with a drive, awaiting each of them, and return their result."""
    try:
        step = next(steps)
        while True:
            try:
                came = step.on(drive)
                if isawaitable(came):
                    came = await came
            except DriveCommError as error:
                step = steps.throw(error)
            else:
                step = steps.send(came)
    except StopIteration as end:
        result: T = end.value
        return result
    finally:
        steps.close()
