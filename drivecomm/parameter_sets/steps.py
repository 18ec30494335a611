"""What parameter sets ask of a drive, as steps that a caller who blocks and one who awaits carry out alike.

A plan is a generator: it yields a step, is sent what came of it, and returns its result. What goes wrong is thrown in
at the yield.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

from drivecomm.errors import DriveCommError

if TYPE_CHECKING:
    from drivecomm.async_drive import AsyncDrive
    from drivecomm.drive import Drive
    from drivecomm.reading import Value

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Read:
    """Read a parameter; a Reading is sent back."""

    address: str
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Write:
    """Write a parameter."""

    address: str
    value: Value
    store: bool


@dataclass(frozen=True, slots=True)
class CheckWrite:
    """See whether a write could be sent; sends nothing."""

    address: str
    value: Value
    store: bool


@dataclass(frozen=True, slots=True)
class AskStatus:
    """Read the status; a DriveStatus is sent back."""


@dataclass(frozen=True, slots=True)
class AskIdentity:
    """Read what the drive tells of itself; names and texts are sent back."""


Step: TypeAlias = Read | Write | CheckWrite | AskStatus | AskIdentity
Steps: TypeAlias = Generator[Step, Any, T]


def carry_out(steps: Steps[T], drive: Drive) -> T:
    """Carry out a plan with a drive."""
    try:
        step = next(steps)
        while True:
            try:
                came = _ask(step, drive)
            except DriveCommError as error:
                step = steps.throw(error)
            else:
                step = steps.send(came)
    except StopIteration as end:
        result: T = end.value
        return result
    finally:
        steps.close()


async def carry_out_awaiting(steps: Steps[T], drive: AsyncDrive) -> T:
    """Carry out a plan with a drive, awaiting each step."""
    try:
        step = next(steps)
        while True:
            try:
                came = _ask(step, drive)
                if not isinstance(step, CheckWrite):
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


def _ask(step: Step, drive: Drive | AsyncDrive) -> Any:
    """Return what came of a step, or what is to be awaited for it."""
    if isinstance(step, Read):
        return drive.read(step.address, **step.options)
    if isinstance(step, Write):
        return drive.write(step.address, step.value, store=step.store)
    if isinstance(step, CheckWrite):
        drive.check_write(step.address, step.value, store=step.store)
        return None
    return drive.status() if isinstance(step, AskStatus) else drive.identify()
