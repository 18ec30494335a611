"""Stopping everything, or all drives of a protocol, as fast as it can be: all lines at once, broadcasts first.

A broadcast reaches every drive with one telegram, and nobody confirms it. So each drive of the plant is then stopped by
itself: all of them once, without waiting for those that are silent any longer than one reply takes, and those that have
not confirmed once more with all the attempts that they may have.
"""

from __future__ import annotations

from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from queue import SimpleQueue
from threading import Thread
from typing import TYPE_CHECKING, Any, TypeAlias, cast

from drivecomm import bus as buses
from drivecomm.cli.control.client import StopRequest, StopResult, broadcasts, stop_by_holder
from drivecomm.cli.output import complain, emit, say, sentence
from drivecomm.cli.signals import until_stopped
from drivecomm.cli.stop.one_drive import as_far_as_possible
from drivecomm.cli.stop.served import all_stopped_by_server
from drivecomm.errors import (
    DriveCommError,
    DriveError,
    FileFormatError,
    LinkError,
    NotSupported,
    ReplyError,
    ServerLostError,
    UsageError,
)
from drivecomm.protocol import (
    LINE_FACT_NAMES,
    Stop,
    commanded_by_model,
    installed,
    one_stop_fits_all,
    unknown_protocol,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
    from pathlib import Path
    from threading import Event

    from drivecomm.bus import Broadcast, Bus
    from drivecomm.cli.line_options import LineOptions
    from drivecomm.plant import Plant
    from drivecomm.protocol import DriveConfig


_Item: TypeAlias = StopResult | BaseException | None
_Tell: TypeAlias = "Callable[[StopResult], None]"


def stop_all(line: LineOptions, path: Path | None, how: Stop) -> int:
    """Stop what is behind the port or in the plant file, and say what was confirmed; returns the exit code.

    A drive that cannot stop this way is stopped down its ramp. Line facts of the command line go before what the plant
    says.
    """
    served = all_stopped_by_server(path, line.port, how, as_json=line.json)
    if served:
        for news in served:
            _show(news, how, as_json=line.json)
        return 0 if all(news.error is None for news in served if news.drive) else DriveError.exit_code
    if path is None:
        return _without_a_plant(line, how)
    try:
        plant, whole = _plant(path, as_json=line.json)
    except FileFormatError as error:
        if line.port is None:
            raise
        _without_a_plant(line, how)
        complain(error, as_json=line.json)
        return error.exit_code
    lines = list(_lines_of(plant, line, () if whole else tuple(installed)))
    if not lines:
        raise UsageError(f"{path}: there is no drive in this plant, so there is nothing to stop")
    return _stop_lines(lines, line, how, whole=whole)


def stop_protocol(line: LineOptions, path: Path, protocol: str, model: str | None, how: Stop) -> int:
    """Stop the drives of a protocol that a plant has, on all its lines, as `stop_all` does; returns the exit code.

    Through the server where one has a line's port. A protocol that the plant has no drive of is told all on each line,
    which nobody confirms. Raises UsageError for a plant without lines.
    """
    if protocol not in installed:
        raise unknown_protocol(protocol, installed)
    plant, whole = _plant(path, as_json=line.json)
    chosen = {"model": model} if model else {}
    drives = tuple(replace(each, options={**each.options, **chosen}) for each in plant.drives)
    asked = replace(plant, drives=tuple(each for each in drives if each.protocol == protocol))
    lines = list(_lines_of(asked, line, () if whole and asked.drives else (protocol,)))
    if not lines:
        raise UsageError(f"{path}: this plant has no line; give --port to stop all {protocol} drives on one")
    these = [replace(each, everything=False, open_bus=_by_whom_it_has) for each in lines]
    return _stop_lines(these, line, how, whole=whole)


def _stop_lines(lines: Sequence[_Line], line: LineOptions, how: Stop, *, whole: bool) -> int:
    if line.record is not None and len(lines) > 1:
        raise UsageError("--record is for one line, and this plant has several; leave it out")
    confirmed = whole and any(each.drives for each in lines)
    for news in _at_once(lines, how):
        if news.drive:
            confirmed = confirmed and news.error is None
        _show(news, how, as_json=line.json)
    return 0 if confirmed else DriveError.exit_code


def _plant(path: Path, *, as_json: bool) -> tuple[Plant, bool]:
    """Return the plant of a file, and whether it is all of it. Raises FileFormatError when nothing can be read."""
    # Only who has a plant file needs the reader of it.
    from drivecomm.plant import read_plant  # noqa: PLC0415

    try:
        return read_plant(path), True
    except FileFormatError as error:
        from drivecomm.plant import salvaged  # noqa: PLC0415 - only who has a broken one needs this

        try:
            plant, lost = salvaged(path)
        except FileFormatError:
            raise error from None
        complain(f"{error}; what else can be read of it is stopped", as_json=as_json)
        for sentence_of_one in lost:
            complain(sentence_of_one, as_json=as_json)
        return plant, False


def _without_a_plant(line: LineOptions, how: Stop) -> int:
    tell = partial(_show, wanted=how, as_json=line.json)
    all_of_them = StopRequest(how=how, protocols=tuple((name, {}) for name in installed), everything=True)
    if stop_by_holder(line.port, all_of_them, tell, line.opening) is not None:
        return DriveError.exit_code
    unreached = []
    with _bus(_Line(port=line.port, opening=line.opening)) as bus:
        for name in installed:
            try:
                # One after the other: the first has been stopped before the second is loaded.
                everybody = bus.broadcast(name)
            except DriveCommError as error:
                tell(StopResult(protocol=name, how=how, error=error))
                continue
            try:
                told = _tell_all("", everybody, name, how)
            except NotSupported as error:
                # Such as Modbus: how its drives are stopped, their model says.
                unreached.append(name)
                if not line.json:
                    continue
                told = StopResult(protocol=name, how=how, error=error)
            except DriveCommError as error:
                told = StopResult(protocol=name, how=how, error=error)
            tell(told)
    if not line.json:
        say(
            "sent with each protocol's usual line settings, which is the best that can be done without --plant: nobody "
            "confirms a broadcast, so look at the motors"
        )
        for name in unreached:
            say(
                f"{name}: not stopped, because that needs the models of its drives; name them in a plant file, or stop "
                f"each by itself: drivecomm stop {name}:ADDRESS,model=MODEL --port {line.port}"
            )
    return DriveError.exit_code


@dataclass(frozen=True, slots=True, kw_only=True)
class _Line:
    name: str = ""
    port: str | None
    opening: Mapping[str, Any]
    drives: tuple[DriveConfig, ...] = ()
    also: tuple[str, ...] = ()
    """Protocols of drives that may be there besides."""

    everything: bool = True
    """Whether all that is there is to be stopped, also what is not named here."""

    open_bus: Callable[..., Bus] = buses.open_bus


def _lines_of(plant: Plant, line: LineOptions, also: tuple[str, ...]) -> Iterator[_Line]:
    # What is said on the command line goes before what the plant says of a line or a drive.
    said = line.said_facts
    for each in plant.lines:
        drives = plant.on_line(each.name)
        if drives or also:
            yield _Line(
                name=each.name,
                port=each.reached_at or (line.port if len(plant.lines) == 1 else None),
                opening={**line.opening, **each.opening, **said},
                drives=tuple(replace(drive, options={**drive.options, **said}) for drive in drives),
                also=also,
            )


@contextmanager
def _bus(line: _Line) -> Iterator[Bus]:
    """Open a line for the time of the block; errors then name the port."""
    if line.port is None:
        raise UsageError("no port: give --port or set DRIVECOMM_PORT, and in a plant of several lines each its port")
    try:
        with line.open_bus(line.port, **line.opening) as bus:
            yield bus
    except DriveCommError as error:
        error.args = (sentence(str(error), where=line.port), *error.args[1:])
        raise


def _by_whom_it_has(port: str, **opening: Any) -> Bus:
    """Open a line through the server that has it, and itself where none has."""
    from drivecomm.plant import bus_of_server  # noqa: PLC0415 - only who has a plant file comes here

    # What goes through a server offers what a bus offers.
    return cast("Bus | None", bus_of_server(port, **opening)) or buses.open_bus(port, **opening)


def _at_once(lines: Iterable[_Line], how: Stop) -> Iterator[StopResult]:
    """Stop all lines at the same time, and yield what comes of it as it comes.

    A signal does not break it off: then those that are silent are not asked again.
    """
    news: SimpleQueue[_Item] = SimpleQueue()
    fallen: list[BaseException] = []
    with until_stopped() as hurry:
        threads = [Thread(target=_stop_line, args=(line, how, news, hurry), daemon=True) for line in lines]
        for thread in threads:
            thread.start()
        working = len(threads)
        while working:
            item = news.get()
            if item is None:
                working -= 1
            elif isinstance(item, BaseException):
                fallen.append(item)
            else:
                yield item
    if fallen:
        raise fallen[0]


def _stop_line(line: _Line, how: Stop, news: SimpleQueue[_Item], hurry: Event) -> None:
    left = {drive.name: drive for drive in line.drives}

    def tell(item: StopResult) -> None:
        left.pop(item.drive, None)
        news.put(item)

    drives = tuple((drive.name, drive.protocol, drive.address, drive.options) for drive in line.drives)
    protocols = (*broadcasts(drives), *((name, {}) for name in line.also))
    what = StopRequest(how=how, drives=drives, protocols=protocols, everything=line.everything)
    try:
        if stop_by_holder(line.port, what, lambda each: tell(replace(each, line=line.name)), line.opening) is not None:
            return
        try:
            _stop_bus(line, how, tell, hurry)
        except ServerLostError as error:
            complain(f"{error}; the port itself is tried now", as_json=False)
            _stop_bus(replace(line, open_bus=buses.open_bus), how, tell, hurry)
    except DriveCommError as error:
        for name in list(left):
            tell(StopResult(line=line.name, drive=name, how=how, error=error))
    except BaseException as error:  # noqa: BLE001 - handed to the thread that waits, which raises it after all others
        news.put(error)
    finally:
        news.put(None)


def _stop_bus(line: _Line, how: Stop, tell: _Tell, hurry: Event) -> None:
    with _bus(line) as bus:
        _broadcast(bus, line, how, tell)
        _each(bus, line, how, tell, hurry)
        _broadcast_to_others(bus, line, how, tell)


def _broadcast(bus: Bus, line: _Line, how: Stop, tell: _Tell) -> None:
    """Send each protocol's stop to all, once for each of the settings that its drives have on this line.

    Where drives could all at once only coast (VABus), and that was not asked for, each of them is stopped by itself; so
    it is where what stops one could start another (Modbus drives of several series).
    """
    sent = []
    for drive in line.drives:
        own = {key: value for key, value in drive.options.items() if key not in {*LINE_FACT_NAMES, "model"}}
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
            # The port itself is left.
            raise
        except DriveCommError as error:
            tell(StopResult(line=line.name, protocol=drive.protocol, how=how, error=error))


def _broadcast_to_others(bus: Bus, line: _Line, how: Stop, tell: _Tell) -> None:
    for protocol in line.also:
        if protocol not in {drive.protocol for drive in line.drives}:
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


def _each(bus: Bus, line: _Line, how: Stop, tell: _Tell, hurry: Event) -> None:
    """Stop each drive by itself: in the first round once, in the second with all its attempts."""
    silent = {}
    for drive in line.drives:
        try:
            tell(_stop_one(bus, drive, how, attempts=1))
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
        except (ReplyError, DriveError, UsageError) as error:
            tell(StopResult(line=line.name, drive=drive.name, how=how, error=error))


def _stop_one(bus: Bus, drive: DriveConfig, how: Stop, **attempts: int) -> StopResult:
    one, without = as_far_as_possible(partial(bus.drive, drive.protocol, drive.address), {**drive.options, **attempts})
    used = how if how in one.capabilities.stops else Stop.RAMP
    one.stop(used)
    return StopResult(line=drive.line, drive=drive.name, how=used, without=without)


def _show(news: StopResult, wanted: Stop, *, as_json: bool) -> None:
    who = news.drive or f"{news.protocol}:*"
    confirmed = bool(news.drive) and news.error is None
    if as_json:
        error = "" if news.error is None else str(news.error)
        told = {"stop": news.how, "confirmed": confirmed, "error": error, "without": news.without}
        emit(line=news.line, drive=who, drive_name=who, **told)
        return
    where = f"{news.line}: " if news.line else ""
    if news.error is not None:
        complain(news.error, as_json=False, where=f"{where}{who} has not confirmed its stop")
        return
    instead = "" if news.how is wanted else f", because it cannot by {wanted.value}"
    what = "confirmed" if confirmed else "sent to all"
    say(f"{where}{who}  stop ({news.how.value}{instead}) {what}{f', {news.without}' if news.without else ''}")
