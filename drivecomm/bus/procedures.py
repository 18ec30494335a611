"""What is done with a drive step by step, written once for callers that block and callers that await.

A procedure is a generator: it yields a step, is sent what came of it, and returns its result. What goes wrong is thrown
in at the yield. Between two steps others may use the line; what must not be cut in two is an exchange.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from inspect import isawaitable
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypeVar

from drivecomm.errors import DriveCommError, NotSupported, OvertakenError, StateError, UsageError, meant, shortened
from drivecomm.line import Rank
from drivecomm.protocol import DriveState, is_duration

if TYPE_CHECKING:
    from decimal import Decimal

    from drivecomm.bus.faces import Awaited, Blocking, Sent
    from drivecomm.protocol import DriveStatus, Model, StateName, Stop, Value

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


def ask_status_first() -> Action:
    """Read the status before whatever others read; a DriveStatus is sent back."""
    return lambda drive: drive.bus.run(drive.to_status(Rank.COMMAND))


def ask_identity() -> Action:
    """Read what the drive tells of itself; names and texts are sent back."""
    return lambda drive: drive.identify()


def note_watchdog(silence_s: float | None) -> Action:
    """Say how long the drive's watchdog waits, see `Drive.watched`."""
    return lambda drive: drive.watched(silence_s)


def in_ram_only() -> Action:
    """Ask which parameters this program wrote without storing them; their addresses are sent back."""
    return lambda drive: drive.in_ram_only


def stop_motor(how: Stop) -> Action:
    """Stop the motor."""
    return lambda drive: drive.stop(how)


def sleep_until(until: float) -> Action:
    """Let time pass on the clock of the drive's line."""
    return lambda drive: drive.bus.sleep_until(until)


def carry_out(drive: Blocking | Sent | None, procedure: Procedure[T]) -> T:
    """Carry out a procedure with a drive, None for one that names its drives itself, and return its result."""
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


async def carry_out_async(drive: Awaited | Sent | None, procedure: Procedure[T]) -> T:
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


def _nothing() -> None:
    """Check nothing."""


def starting(
    *, reverse: bool, percent: Decimal | None, hz: Decimal | None, check: Callable[[], None] = _nothing
) -> Procedure[None]:
    """Start a motor, at a reference where one is given.

    check: called right before each telegram that commands, and when a stop has overtaken what is asked before; what it
    raises keeps all that follows from being sent.
    """
    given = percent is not None or hz is not None
    # Some drives take a reference only from whoever commands them, so a motor that runs is commanded first.
    try:
        runs = given and (yield ask_status()).running
    except OvertakenError:
        check()
        raise
    if given and not runs:
        check()
        yield _set_reference(percent, hz)
    check()
    yield lambda drive: drive.start(reverse=reverse)
    if runs:
        check()
        yield _set_reference(percent, hz)


def starting_by(verb: str, arguments: Mapping[str, Any], check: Callable[[], None] = _nothing) -> Procedure[Any]:
    """Start a motor by another verb of the drive, such as jog, call or write; returns what the verb returns.

    check: called right before it; what it raises keeps it from being sent.
    """
    check()
    return (yield lambda drive: getattr(drive, verb)(**arguments))


def telling_speed(model: Model | None, now: Callable[[], float], *, waits: bool = False) -> Procedure[str]:
    """Return where a motor that was just started runs to, in words; empty if the drive does not tell.

    waits: the speed is no reference, such as a jog speed; the output frequency is told that the motor has within 2 s.
    """
    quantities = model.quantities if model is not None else {}
    names = ("output_frequency",) if waits else ("reference_frequency", "reference_percent")
    name = next((each for each in names if each in quantities), "")
    if not name:
        return ""
    try:
        until = now() + _SETTLES_S
        while waits and now() < until and not (yield ask_status()).at_reference:
            yield sleep_until(now() + POLL_S)
        reading = yield read_parameter(name)
    except DriveCommError:
        # It runs all the same, and what comes next says more.
        return ""
    return f"turns at {reading}" if waits else f"runs to {reading}"


def _set_reference(percent: Decimal | None, hz: Decimal | None) -> Action:
    return lambda drive: drive.set_reference(percent=percent, hz=hz)


Goal: TypeAlias = "DriveState | StateName | Literal['at_reference']"
"""A state or its text, or a motor that runs at its reference."""

_SETTLES_S = 2.0

POLL_S = 0.1
"""How often a drive is asked meanwhile."""


def reaching(name: str, goal: Goal, timeout_s: float, now: Callable[[], float]) -> Procedure[DriveStatus]:
    """Ask the drive with this name for its status until it is where it shall be, and return that status."""
    waiting = Waiting(name, goal, timeout_s, now())
    while True:
        try:
            status: DriveStatus = yield ask_status()
            if waiting.over(status, now()):
                return status
        except OvertakenError as error:
            waiting.overtaken(error, now())
        yield sleep_until(now() + POLL_S)


def _state(goal: DriveState | StateName) -> DriveState:
    try:
        return DriveState(goal)
    except ValueError:
        known = meant(goal, [*(state.value for state in DriveState), "at_reference"], "use")
        raise UsageError(f"cannot wait for {shortened(goal)}; {known}") from None


class Waiting:
    """Waits from a time on for a goal, for so many seconds. Raises UsageError for a goal or a time that cannot be."""

    def __init__(self, name: str, goal: Goal, timeout_s: float, now: float) -> None:
        wanted = goal if goal == "at_reference" else _state(goal)
        if not is_duration(timeout_s):
            raise UsageError(f"timeout_s cannot be {shortened(timeout_s)}; give seconds, 0 or more")
        self._name = name
        self._goal: DriveState | Literal["at_reference"] = wanted
        self._timeout_s = timeout_s
        self._until = now + timeout_s

    def over(self, status: DriveStatus, now: float) -> bool:
        """Whether the drive is where it shall be; called with its status again and again.

        Raises StateError when the time is over, and at once for a fault that nobody waits for; NotSupported where the
        status word does not say whether the reference is reached.
        """
        if self._met(status):
            return True
        shown = self._goal if isinstance(self._goal, str) else self._goal.value
        if status.fault and self._goal is not DriveState.FAULT:
            code = "" if status.fault_code is None else f" {status.fault_code} {status.fault_text}".rstrip()
            raise StateError(f"{self._name} has a fault{code} and will not reach {shown!r}; reset it first")
        if now >= self._until:
            raise StateError(
                f"{self._name} did not reach {shown!r} within {self._timeout_s:g} s; it is {status.state.value}"
            )
        return False

    def overtaken(self, error: OvertakenError, now: float) -> None:
        """Take note of a status that a stop has kept from being read: it is asked again until the time is over."""
        if now >= self._until:
            raise error

    def _met(self, status: DriveStatus) -> bool:
        if isinstance(self._goal, DriveState):
            return status.state is self._goal
        if status.at_reference is None and status.running:
            raise NotSupported(f"the status of {self._name} does not say whether the reference is reached")
        return bool(status.running and status.at_reference)
