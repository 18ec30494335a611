"""Stopping the drives of one line over a bus: broadcasts first, then each drive by itself.

Over a bus of one's own or through another program that has the port, both offer the same.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

from drivecomm.cli.stop.results import StopResult
from drivecomm.client import as_far_as_possible
from drivecomm.errors import (
    DriveCommError,
    DriveError,
    LinkError,
    NotSupported,
    ReplyError,
    ServerLostError,
    UsageError,
    WrongDriveError,
)
from drivecomm.protocol import CONFIRMED, LINE_FACT_NAMES, Stop, commanded_by_model, one_stop_fits_all

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from threading import Event

    from drivecomm.bus import BlockingLine, Broadcast
    from drivecomm.cli.stop.results import Tell
    from drivecomm.protocol import DriveConfig


@dataclass(frozen=True, slots=True, kw_only=True)
class StoppedLine:
    """What is to be stopped on a line."""

    name: str = ""
    port: str | None
    opening: Mapping[str, Any]
    drives: tuple[DriveConfig, ...] = ()
    also: tuple[str, ...] = ()
    """Protocols of drives that may be there besides."""

    by_name: bool = False
    """Whether only the drives that are named are to be stopped, so that no broadcast goes out."""

    told: frozenset[str] = frozenset()
    """Protocols of which all drives were told already, by a way that was lost afterwards."""

    answered: frozenset[str] = frozenset()
    """Names of drives of which the outcome is known from such a way."""

    file: str = ""
    """The real path of the plant file that says so: its server needs to be told what was said here only."""

    said: Mapping[str, Any] = field(default_factory=dict)
    """What was said here: line facts of the command line."""

    @property
    def left(self) -> tuple[DriveConfig, ...]:
        """The drives that are still to be stopped by themselves."""
        return tuple(drive for drive in self.drives if drive.name not in self.answered)


def stop_bus(bus: BlockingLine, line: StoppedLine, how: Stop, tell: Tell, hurry: Event) -> None:
    """Stop a line. hurry: once it is set, drives that are silent are not asked again. Raises LinkError."""
    if not line.by_name:
        broadcast(bus, line, how, tell)
    stopped = _each(bus, line, how, tell, hurry)
    if not line.by_name:
        broadcast_to_others(bus, line, how, tell)
    if any(commanded_by_model(drive.protocol) for drive in stopped):
        _check_right_drives(bus, stopped, how, tell)


def broadcast(bus: BlockingLine, line: StoppedLine, how: Stop, tell: Tell) -> None:
    """Send each protocol's stop to all, once for each of the settings that its drives have on this line.

    Where drives could all at once only coast (VABus), and that was not asked for, each of them is stopped by itself; so
    it is where what stops one could start another (Modbus drives of several series).
    """
    sent = []
    for drive in (each for each in line.drives if each.protocol not in line.told):
        shared = {*LINE_FACT_NAMES, "model", CONFIRMED}
        own = {key: value for key, value in drive.options.items() if key not in shared}
        try:
            everybody, _ = as_far_as_possible(partial(bus.broadcast, drive.protocol), drive.options)
            key = (drive.protocol, everybody.peer.facts.settings, own)
            alike = (each.options for each in line.drives if each.protocol == drive.protocol)
            # Of a damaged plant file nobody knows which other series there are.
            fits = not (line.also and commanded_by_model(drive.protocol))
            if key in sent or not (fits and one_stop_fits_all(drive.protocol, alike)):
                continue
            sent.append(key)
            # Where the plant file could not be read as a whole, there may be more of them than are named.
            if not line.also and _way(everybody, how) is Stop.COAST is not how:
                continue
            tell(_tell_all(line.name, everybody, drive.protocol, how))
        except NotSupported:
            # It has no broadcast; its drives are stopped one by one.
            continue
        except ServerLostError:
            # Another way is left.
            raise
        except DriveCommError as error:
            tell(StopResult(line=line.name, protocol=drive.protocol, how=how, error=error))


def broadcast_to_others(bus: BlockingLine, line: StoppedLine, how: Stop, tell: Tell) -> None:
    """Send a stop to all of each protocol that drives may be of besides."""
    for protocol in line.also:
        if protocol not in {drive.protocol for drive in line.drives} | line.told:
            with suppress(NotSupported):
                tell(_tell_all(line.name, bus.broadcast(protocol), protocol, how))


def _tell_all(line: str, everybody: Broadcast, protocol: str, how: Stop) -> StopResult:
    used = _way(everybody, how)
    everybody.stop(used)
    return StopResult(line=line, protocol=protocol, how=used)


def _way(everybody: Broadcast, how: Stop) -> Stop:
    """Return the way to stop that is nearest to what was asked for."""
    able = everybody.capabilities.stops
    return next((each for each in (how, Stop.RAMP, Stop.COAST) if each in able), how)


def _each(bus: BlockingLine, line: StoppedLine, how: Stop, tell: Tell, hurry: Event) -> list[DriveConfig]:
    """Stop each drive by itself: in the first round once, in the second with all its attempts; return who confirmed."""
    silent, stopped = {}, []
    for drive in line.left:
        try:
            tell(_stop_one(bus, drive, how, attempts=1))
            stopped.append(drive)
        except ServerLostError:
            raise
        except (ReplyError, LinkError) as error:
            silent[drive.name] = drive, error
        except Exception as error:  # noqa: BLE001 - nothing that is wrong with one drive keeps the others running
            tell(StopResult(line=line.name, drive=drive.name, how=how, error=error))
    for drive, first in silent.values():
        try:
            if hurry.is_set():
                raise first
            tell(_stop_one(bus, drive, how))
            stopped.append(drive)
        except (ReplyError, DriveError, UsageError) as error:
            tell(StopResult(line=line.name, drive=drive.name, how=how, error=error))
    return stopped


def _check_right_drives(bus: BlockingLine, stopped: Sequence[DriveConfig], how: Stop, tell: Tell) -> None:
    """Tell which drives are not of the models by which they were stopped."""
    from drivecomm.cli.stop.afterwards import check_right_drive  # noqa: PLC0415 - loaded when the stops are out

    for drive in stopped:
        with suppress(Exception):
            one, _ = as_far_as_possible(partial(bus.drive, drive.protocol, drive.address), drive.options)
            try:
                check_right_drive(bus, one)
            except WrongDriveError as error:
                tell(StopResult(line=drive.line, drive=drive.name, how=how, error=error))


def _stop_one(bus: BlockingLine, drive: DriveConfig, how: Stop, **attempts: int) -> StopResult:
    one, without = as_far_as_possible(partial(bus.drive, drive.protocol, drive.address), {**drive.options, **attempts})
    used = how if how in one.capabilities.stops else Stop.RAMP
    one.stop(used)
    return StopResult(line=drive.line, drive=drive.name, how=used, without=without)


def stop_protocol_of(bus: BlockingLine, name: str, how: Stop, tell: Tell, *, as_json: bool) -> list[str]:
    """Stop all drives of a protocol; return its name where it cannot be done without their models."""
    unreached = []
    try:
        # One after the other: the first has been stopped before the second is loaded.
        everybody = bus.broadcast(name)
        try:
            told = _tell_all("", everybody, name, how)
        except NotSupported as error:
            # Such as Modbus: how its drives are stopped, their model says.
            unreached.append(name)
            if not as_json:
                return unreached
            told = StopResult(protocol=name, how=how, error=error)
    except ServerLostError:
        # Another way is left.
        raise
    except Exception as error:  # noqa: BLE001 - a package that is broken keeps no drive of another one running
        told = StopResult(protocol=name, how=how, error=error)
    tell(told)
    return unreached
