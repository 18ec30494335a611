"""Stop of several lines concurrently, each by the first way that works."""

from __future__ import annotations

from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from queue import SimpleQueue
from threading import Thread
from typing import TYPE_CHECKING, Any, TypeAlias

from drivecomm import bus as buses
from drivecomm.bus import StopResult, broadcasting, broadcasting_to_others, carry_out, stopping_line
from drivecomm.cli.output import sentence
from drivecomm.cli.signals import until_stopped
from drivecomm.cli.stop.results import show
from drivecomm.cli.stop.stop_ways import StopWays
from drivecomm.client import check_alive
from drivecomm.errors import DriveCommError, DriveError, LinkError, NotSupported, UsageError
from drivecomm.protocol import Stop

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from threading import Event

    from drivecomm.bus import BlockingLine, Bus, OnResult
    from drivecomm.cli.line_options import LineArguments
    from drivecomm.cli.stop.over_bus import StoppedLine
    from drivecomm.cli.stop.safe_lookups import SafeLookups
    from drivecomm.client import Registration
    from drivecomm.protocol import DriveConfig

_BROADCASTS_S = 0.3

_Item: TypeAlias = StopResult | BaseException | None


def stop_lines(lines: Sequence[StoppedLine], line: LineArguments, how: Stop, spite: SafeLookups, *, whole: bool) -> int:
    """Stop lines and print the results; return the exit code. whole: whether these are all lines."""
    if line.record is not None and len(lines) > 1:
        spite.note("--record is for one line, and this plant has several; nothing is recorded")
        lines = [replace(each, opening={**each.opening, "record": None}) for each in lines]
    confirmed = whole and any(each.drives for each in lines)
    for news in stop_at_once(lines, how, spite):
        if news.drive:
            confirmed = confirmed and news.error is None
        show(news, how, as_json=line.json)
    return 0 if confirmed else DriveError.exit_code


@contextmanager
def own_bus(line: StoppedLine, ways: StopWays) -> Iterator[Bus]:
    """Open the port of a line directly for the time of the block; errors then name the port."""
    if line.port is None:
        raise UsageError("no port: give --port or set DRIVECOMM_PORT, and in a plant of several lines each its port")
    recorded = [partial(buses.open_bus, line.port, **line.opening)] if line.opening.get("record") else []
    plain = partial(buses.open_bus, line.port, **{**line.opening, "record": None})
    try:
        with ways.itself(*recorded, plain) as bus:
            yield bus
    except DriveCommError as error:
        error.args = (sentence(str(error), where=line.port), *error.args[1:])
        raise


def bus_of(program: Registration, name: str, opening: Mapping[str, Any]) -> BlockingLine:
    """Return the bus of a line through the program that has its port, with the interface of a direct bus."""
    from drivecomm.client import ServedBus

    return ServedBus(program, name, **{**opening, "trace": None, "record": None})


def stop_at_once(lines: Iterable[StoppedLine], how: Stop, spite: SafeLookups) -> Iterator[StopResult]:
    """Stop all lines concurrently, and yield the results as they arrive.

    A signal does not interrupt the stops; it only skips the second round for silent drives.
    """
    news: SimpleQueue[_Item] = SimpleQueue()
    fallen: list[BaseException] = []
    with until_stopped() as hurry:
        threads = [Thread(target=_stop_line, args=(line, how, news, hurry, spite), daemon=True) for line in lines]
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


def _stop_line(line: StoppedLine, how: Stop, news: SimpleQueue[_Item], hurry: Event, spite: SafeLookups) -> None:
    told: set[str] = set()
    answered: set[str] = set()

    def tell(item: StopResult) -> None:
        answered.add(item.drive)
        if item.error is None:
            told.add(item.protocol)
        news.put(item)

    def rest() -> StoppedLine:
        return replace(line, told=frozenset(told), answered=frozenset(answered))

    try:
        ways = StopWays(line.port, spite)
        for program, name in ways.programs:
            try:
                if program.plant:
                    _stop_through(program, name, rest(), how, tell)
                else:
                    with bus_of(program, name, line.opening) as bus:
                        carry_out(None, stopping_line(bus, rest(), how, tell, hurry.is_set))
            except LinkError as error:
                spite.note(f"{error}; trying another way")
            else:
                return
        with own_bus(line, ways) as bus:
            carry_out(None, stopping_line(bus, rest(), how, tell, hurry.is_set))
    except DriveCommError as error:
        for drive in rest().left:
            tell(StopResult(line=line.name, drive=drive.name, how=how, error=error))
    except BaseException as error:  # noqa: BLE001 - raised again by the waiting thread, after all stops
        news.put(error)
    finally:
        news.put(None)


def _stop_through(program: Registration, name: str, line: StoppedLine, how: Stop, tell: OnResult) -> None:
    """Stop a line through its server, all drives concurrently, so that a silent drive delays no other report.

    Raises LinkError after all drives were tried, if the server does not respond or no longer has the port.
    """
    check_alive(program)
    lost: list[LinkError] = []

    def to_all() -> None:
        with suppress(LinkError), bus_of(program, name, line.opening) as bus:
            carry_out(None, broadcasting(bus, line, how, tell))
            carry_out(None, broadcasting_to_others(bus, line, how, tell))

    def stop(drive: DriveConfig) -> None:
        try:
            tell(_stop_at(program, name, line, drive, how))
        except LinkError as error:
            lost.append(error)
        except Exception as error:  # noqa: BLE001 - an error of one drive must not prevent other stops
            tell(StopResult(line=line.name, drive=drive.name, how=how, error=error))

    everybody = Thread(target=to_all, daemon=True)
    if not line.by_name:
        everybody.start()
        # The broadcasts reach most drives first, and the limit keeps them from delaying the other stops.
        everybody.join(_BROADCASTS_S)
    each = [Thread(target=stop, args=(drive,), daemon=True) for drive in line.left]
    for thread in each:
        thread.start()
    for thread in (*each, *([] if line.by_name else [everybody])):
        thread.join()
    if lost:
        raise lost[0]


def _stop_at(program: Registration, name: str, line: StoppedLine, drive: DriveConfig, how: Stop) -> StopResult:
    """Stop a drive through a server; down its ramp if it does not support this kind of stop."""
    from drivecomm.client import place_on_line, request_stop

    place = place_on_line(name, str(drive))
    options = line.said if program.plant == line.file else drive.options
    try:
        request_stop(program, place, how, options)
    except NotSupported:
        if how is Stop.RAMP:
            raise
        request_stop(program, place, Stop.RAMP, options)
        how = Stop.RAMP
    return StopResult(line=line.name, drive=drive.name, how=how)
