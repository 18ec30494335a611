"""Operations with a drive in several steps, written once for blocking and asynchronous callers.

A procedure is a generator: it yields a step, receives its result, and finally returns its own result. An error of a
step is raised at the yield. Between two steps others may use the line; an operation that must not be interrupted is an
exchange instead.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from inspect import isawaitable
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypeVar

from drivecomm.errors import DriveCommError, NotSupported, OvertakenError, StateError, UsageError, shortened, suggestion
from drivecomm.line import Rank
from drivecomm.protocol import DriveState, is_duration

if TYPE_CHECKING:
    from decimal import Decimal

    from drivecomm.bus.call_styles import AwaitedCalls, BlockingCalls, RemoteCalls
    from drivecomm.protocol import DriveStatus, Model, StateName, Stop, Value

T = TypeVar("T")

Action: TypeAlias = Callable[[Any], Any]
"""Step that does something with a drive, and returns its result or an awaitable."""

Procedure: TypeAlias = Generator[Action, Any, T]
"""An operation of several steps, for both kinds of bus: it yields steps and receives their results."""

_NO_OPTIONS: Mapping[str, Any] = {}


def read_parameter(parameter: str, options: Mapping[str, Any] = _NO_OPTIONS) -> Action:
    """Read a parameter; the result is a Reading."""
    return lambda drive: drive.read(parameter, **options)


def write_parameter(parameter: str, value: Value, *, store: bool, options: Mapping[str, Any] = _NO_OPTIONS) -> Action:
    """Write a parameter."""
    return lambda drive: drive.write(parameter, value, store=store, **options)


def check_write(parameter: str, value: Value, *, store: bool, options: Mapping[str, Any] = _NO_OPTIONS) -> Action:
    """Check whether a write could be sent; sends nothing."""
    return lambda drive: drive.check_write(parameter, value, store=store, **options)


def ask_status() -> Action:
    """Read the status; the result is a DriveStatus."""
    return lambda drive: drive.status()


def ask_status_first() -> Action:
    """Read the status before the reads of other callers; the result is a DriveStatus."""
    return lambda drive: drive.bus.run(drive.to_status(Rank.COMMAND))


def ask_identity() -> Action:
    """Read the identity of the drive; the result maps names to texts."""
    return lambda drive: drive.identify()


def note_watchdog(silence_s: float | None) -> Action:
    """Record how many seconds the drive's watchdog waits, see `Drive.watched`."""
    return lambda drive: drive.watched(silence_s)


def in_ram_only() -> Action:
    """Get the addresses of the parameters that this program wrote without storing them."""
    return lambda drive: drive.in_ram_only


def stop_motor(how: Stop) -> Action:
    """Stop the motor."""
    return lambda drive: drive.stop(how)


def sleep_until(until: float) -> Action:
    """Wait until this time on the clock of the drive's line."""
    return lambda drive: drive.bus.sleep_until(until)


def carry_out(drive: BlockingCalls | RemoteCalls | None, procedure: Procedure[T]) -> T:
    """Carry out a procedure with a drive, and return its result.

    drive: None for a procedure that names its drives itself.
    """
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


async def carry_out_async(drive: AwaitedCalls | RemoteCalls | None, procedure: Procedure[T]) -> T:
    """Carry out a procedure with a drive, awaiting each step, and return its result.

    drive: None for a procedure that names its drives itself.
    """
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
    """Accept everything; the default check."""


def starting(
    *, reverse: bool, percent: Decimal | None, hz: Decimal | None, check: Callable[[], None] = _nothing
) -> Procedure[None]:
    """Start a motor, at a reference if one is given.

    check: called right before each commanding telegram, and when a stop has overtaken the status request before them;
    if it raises, no further telegram is sent.
    """
    given = percent is not None or hz is not None
    # Some drives accept a reference only from their commander, so a running motor is commanded first.
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
    """Start a motor by another verb of the drive, such as jog, call or write; return the verb's result.

    check: called right before the verb; if it raises, the verb is not sent.
    """
    check()
    return (yield lambda drive: getattr(drive, verb)(**arguments))


def reading_speed(model: Model | None, now: Callable[[], float], *, waits: bool = False) -> Procedure[str]:
    """Return the speed of a motor that was just started, in words; empty if the drive does not report it.

    waits: whether the speed is not a reference, such as a jog speed; the result is then the output frequency that the
    motor reaches within 2 s.
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
        # The motor runs nevertheless, and the next request reports the error.
        return ""
    return f"turns at {reading}" if waits else f"runs to {reading}"


def _set_reference(percent: Decimal | None, hz: Decimal | None) -> Action:
    return lambda drive: drive.set_reference(percent=percent, hz=hz)


Goal: TypeAlias = "DriveState | StateName | Literal['at_reference']"
"""A state or its text, or "at_reference" for a motor that runs at its reference."""

_SETTLES_S = 2.0

POLL_S = 0.1
"""Interval in seconds between status requests."""


def reaching(name: str, goal: Goal, timeout_s: float, now: Callable[[], float]) -> Procedure[DriveStatus]:
    """Poll the status of the drive with this name until it reaches the goal; return that status."""
    waiting = GoalWait(name, goal, timeout_s, now())
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
        known = suggestion(goal, [*(state.value for state in DriveState), "at_reference"], "use")
        raise UsageError(f"cannot wait for {shortened(goal)}; {known}") from None


class GoalWait:
    """A limited wait for a goal, of `timeout_s` from `now` on. Raises UsageError for an invalid goal or time."""

    def __init__(self, name: str, goal: Goal, timeout_s: float, now: float) -> None:
        wanted = goal if goal == "at_reference" else _state(goal)
        if not is_duration(timeout_s):
            raise UsageError(f"invalid timeout_s = {shortened(timeout_s)}; give seconds, 0 or more")
        self._name = name
        self._goal: DriveState | Literal["at_reference"] = wanted
        self._timeout_s = timeout_s
        self._until = now + timeout_s

    def over(self, status: DriveStatus, now: float) -> bool:
        """Return whether the drive has reached the goal; called repeatedly with its status.

        Raises StateError when the time is over, and immediately for a fault that is not the goal; NotSupported if the
        status word does not show whether the reference is reached.
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
        """Ignore that a stop has overtaken a status request, which is repeated; raise its error if the time is over."""
        if now >= self._until:
            raise error

    def _met(self, status: DriveStatus) -> bool:
        if isinstance(self._goal, DriveState):
            return status.state is self._goal
        if status.at_reference is None and status.running:
            raise NotSupported(f"the status of {self._name} does not report whether the reference is reached")
        return bool(status.running and status.at_reference)
