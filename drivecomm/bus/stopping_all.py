"""Stop of all drives of a line: the broadcasts that reach them, the order of the stops, and the results.

A broadcast reaches every drive with one telegram, but no drive confirms it. So each drive is then stopped by itself:
all of them once, without waiting for a silent drive longer than one reply takes, and those that have not confirmed
again with all their attempts. At the end each drive is checked against the model by which it was stopped: the stop of
one series starts another (1 is the stop of Delta and the forward run of INVT: MS300 manual p. 789, Goodrive350 manual
p. 317).
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

from drivecomm.bus.valid_options import make_despite_errors
from drivecomm.errors import (
    DriveCommError,
    LinkError,
    NotSupported,
    ReplyError,
    ServerLostError,
    WrongDriveError,
)
from drivecomm.line import Job, Rank
from drivecomm.protocol import (
    ABOUT_THE_DRIVE,
    LINE_FACT_NAMES,
    Stop,
    commanded_by_model,
    one_stop_fits_all,
    way_to_stop,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from drivecomm.bus.line_interface import LineInterface
    from drivecomm.bus.procedures import Procedure
    from drivecomm.protocol import DriveConfig, StopName

E = TypeVar("E")

_SHARED = {*LINE_FACT_NAMES, "model", *ABOUT_THE_DRIVE}


@dataclass(frozen=True, slots=True, kw_only=True)
class StopResult:
    """The result of a stop, either of a drive or, if its name is empty, of a broadcast.

    protocol: protocol of the broadcast. how: the stop that was sent, which differs from the requested one if that is
    not possible. error: why a drive has not confirmed, or a broadcast was not sent. line: its name in the plant.
    without: which options were left out because they are invalid.
    """

    line: str = ""
    drive: str = ""
    protocol: str = ""
    how: Stop
    error: Exception | None = None
    without: str = ""

    @property
    def confirmed(self) -> bool:
        """Whether a drive has confirmed its stop; a broadcast is never confirmed."""
        return bool(self.drive) and self.error is None


OnResult: TypeAlias = "Callable[[StopResult], None]"
"""Function that is called with each result of a stop as it comes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DrivesToStop:
    """Drives to stop on a line."""

    name: str = ""
    drives: tuple[DriveConfig, ...] = ()
    also: tuple[str, ...] = ()
    """Protocols of further drives that may be on the line."""

    by_name: bool = False
    """Whether to stop only the named drives, without any broadcast."""

    told: frozenset[str] = frozenset()
    """Protocols whose broadcast was sent already over a connection that was lost afterwards."""

    answered: frozenset[str] = frozenset()
    """Names of drives whose result is known from that connection."""

    @property
    def left(self) -> tuple[DriveConfig, ...]:
        """The drives that must still be stopped one by one."""
        return tuple(drive for drive in self.drives if drive.name not in self.answered)


def stopping_all(
    bus: LineInterface[Any, Any],
    drives: Iterable[DriveConfig],
    how: Stop | StopName,
    on_result: OnResult | None = None,
    *,
    by_name: bool = False,
) -> Procedure[list[StopResult]]:
    """Stop the drives of a line, and return all results; errors of a drive or of the line are in the results.

    on_result: called with each result as it comes. by_name: whether to stop only these drives, without any broadcast.
    """
    how = way_to_stop(how)
    there = tuple(drives)
    asked = DrivesToStop(name=there[0].line if there else "", drives=there, by_name=by_name)
    results: list[StopResult] = []

    def tell(result: StopResult) -> None:
        results.append(result)
        if on_result is not None:
            on_result(result)

    try:
        yield from stopping_line(bus, asked, how, tell)
    except DriveCommError as error:
        known = frozenset(each.drive for each in results)
        for drive in replace(asked, answered=known).left:
            tell(StopResult(line=asked.name, drive=drive.name, how=how, error=error))
    return results


def stopping_line(
    bus: LineInterface[Any, Any],
    asked: DrivesToStop,
    how: Stop,
    tell: OnResult,
    hurries: Callable[[], bool] = lambda: False,
) -> Procedure[None]:
    """Stop a line. Raises LinkError.

    hurries: called before a silent drive is tried again; if it returns True, that attempt is left out.
    """
    if not asked.by_name:
        yield from broadcasting(bus, asked, how, tell)
    stopped = yield from _stopping_each(bus, asked, how, tell, hurries)
    if not asked.by_name:
        yield from broadcasting_to_others(bus, asked, how, tell)
    if any(commanded_by_model(drive.protocol) for drive in stopped):
        yield from _checking_right_drives(bus, stopped, how, tell)


def broadcasting(bus: LineInterface[Any, Any], asked: DrivesToStop, how: Stop, tell: OnResult) -> Procedure[None]:
    """Send the stop of each protocol to all its drives, once for each of the settings that they have on this line."""

    def failed(protocol: str, error: Exception) -> None:
        if isinstance(error, ServerLostError):
            # The caller has another way to reach the drives.
            raise error
        tell(StopResult(line=asked.name, protocol=protocol, how=how, error=error))

    # A damaged plant file may hide drives of other series, and more drives of a protocol.
    may_be_more = bool(asked.also)
    for protocol, everybody in broadcasts_of(bus, asked.drives, failed, told=asked.told, may_be_more=may_be_more):
        used = stop_of_all(everybody, how, may_be_more=may_be_more)
        if used is None:
            continue
        try:
            yield _stop(everybody, used)
        except NotSupported:
            # The protocol has no broadcast; its drives are stopped one by one.
            continue
        except Exception as error:  # noqa: BLE001 - its drives are stopped one by one
            failed(protocol, error)
        else:
            tell(StopResult(line=asked.name, protocol=protocol, how=used))


def broadcasting_to_others(
    bus: LineInterface[Any, Any], asked: DrivesToStop, how: Stop, tell: OnResult
) -> Procedure[None]:
    """Send a stop to all drives of each further protocol that may be on the line."""
    for protocol in asked.also:
        if protocol not in {drive.protocol for drive in asked.drives} | asked.told:
            with suppress(NotSupported):
                tell((yield from stopping_everybody(bus.broadcast(protocol), asked.name, protocol, how)))


def stopping_everybody(everybody: Any, line: str, protocol: str, how: Stop) -> Procedure[StopResult]:
    """Stop all drives of a protocol, in the way nearest to the requested one. Raises NotSupported."""
    used = _nearest(everybody, how)
    yield _stop(everybody, used)
    return StopResult(line=line, protocol=protocol, how=used)


def broadcasts_of(
    bus: LineInterface[Any, E],
    drives: Sequence[DriveConfig],
    on_error: Callable[[str, Exception], None],
    *,
    told: frozenset[str] = frozenset(),
    may_be_more: bool = False,
) -> Iterator[tuple[str, E]]:
    """Yield the protocols of these drives, each with an object for all its drives, once for each of their settings.

    If the stop of one drive could start another (Modbus drives of several series), the drives are left to be stopped
    one by one. on_error: called with a protocol that cannot broadcast, and the reason. told: protocols that are left
    out. may_be_more: whether drives of other series may be there that are not named.
    """
    made = []
    for drive in (each for each in drives if each.protocol not in told):
        own = {name: value for name, value in drive.options.items() if name not in _SHARED}
        alike = (each.options for each in drives if each.protocol == drive.protocol)
        try:
            everybody: Any = make_despite_errors(partial(bus.broadcast, drive.protocol), drive.options)[0]
            key = (drive.protocol, everybody.peer.facts.settings, own)
            fits = not (may_be_more and commanded_by_model(drive.protocol))
            if key in made or not (fits and one_stop_fits_all(drive.protocol, alike)):
                continue
        except NotSupported:
            # The protocol has no broadcast; its drives are stopped one by one.
            continue
        except Exception as error:  # noqa: BLE001 - a broken package must not prevent other stops
            on_error(drive.protocol, error)
            continue
        made.append(key)
        yield drive.protocol, everybody


def stop_of_all(everybody: Any, how: Stop, *, may_be_more: bool = False) -> Stop | None:
    """Return the stop that is sent to all drives of a protocol; None if none is sent.

    Drives that could only coast by a broadcast (VABus) are stopped one by one, unless coasting was requested.
    may_be_more: whether more drives may be there than are named; then they coast nevertheless.
    """
    used = _nearest(everybody, how)
    coasts = used is Stop.COAST is not how
    return None if used not in everybody.capabilities.stops or (coasts and not may_be_more) else used


def _nearest(everybody: Any, how: Stop) -> Stop:
    able = everybody.capabilities.stops
    return next((each for each in (how, Stop.RAMP, Stop.COAST) if each in able), how)


def _stopping_each(
    bus: LineInterface[Any, Any], asked: DrivesToStop, how: Stop, tell: OnResult, hurries: Callable[[], bool]
) -> Procedure[list[DriveConfig]]:
    """Stop each drive by itself, first once, then silent ones with all attempts; return the confirmed drives."""
    silent: dict[str, tuple[DriveConfig, Exception]] = {}
    stopped = []
    for drive in asked.left:
        try:
            tell((yield from _stopping_one(bus, drive, how, attempts=1)))
            stopped.append(drive)
        except ServerLostError:
            raise
        except (ReplyError, LinkError) as error:
            silent[drive.name] = drive, error
        except Exception as error:  # noqa: BLE001 - an error of one drive must not prevent other stops
            tell(StopResult(line=asked.name, drive=drive.name, how=how, error=error))
    for drive, first in silent.values():
        wrong = first
        if not hurries():
            try:
                tell((yield from _stopping_one(bus, drive, how)))
                stopped.append(drive)
                continue
            except LinkError:
                raise
            except Exception as error:  # noqa: BLE001 - as above
                wrong = error
        tell(StopResult(line=asked.name, drive=drive.name, how=how, error=wrong))
    return stopped


def _stopping_one(
    bus: LineInterface[Any, Any], drive: DriveConfig, how: Stop, **attempts: int
) -> Procedure[StopResult]:
    one, without = make_despite_errors(partial(bus.drive, drive.protocol, drive.address), {**drive.options, **attempts})
    used = how if how in one.capabilities.stops else Stop.RAMP
    yield _stop(one, used)
    return StopResult(line=drive.line, drive=drive.name, how=used, without=without)


def _checking_right_drives(
    bus: LineInterface[Any, Any], stopped: Sequence[DriveConfig], how: Stop, tell: OnResult
) -> Procedure[None]:
    """Report the drives that are not of the models by which they were stopped."""
    for drive in stopped:
        with suppress(Exception):
            one, _ = make_despite_errors(partial(bus.drive, drive.protocol, drive.address), drive.options)
            try:
                yield from checking_right_drive(one)
            except WrongDriveError as error:
                tell(StopResult(line=drive.line, drive=drive.name, how=how, error=error))


def checking_right_drive(drive: Any) -> Procedure[None]:
    """Raise WrongDriveError for a drive that is not of the model by which it was stopped.

    The check comes afterwards, so that no stop waits for it; nothing is raised if the check has no result.
    """
    run, check = getattr(drive.bus, "run", None), drive.peer.check_series
    if run is None or check is None:
        return
    try:
        yield lambda _: run(Job(drive.peer, check(), Rank.READ))
    except WrongDriveError as error:
        if not error.found:
            return
        raise WrongDriveError(
            f"{drive.name} was sent the stop of model {error.model}, and is not a drive of that model, or not set up "
            f"as one: {error.found}; look whether its motor stands",
            model=error.model,
            found=error.found,
            candidates=error.candidates,
        ) from error
    except DriveCommError:
        return


def _stop(whom: Any, how: Stop) -> Callable[[Any], Any]:
    return lambda _: whom.stop(how)
