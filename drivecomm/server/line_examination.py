"""Examinations of a whole line: scan, doctor, trace and statistics."""

from __future__ import annotations

import asyncio
from collections import deque
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any

from drivecomm.bus import LineChoices
from drivecomm.client import drive_options, plain
from drivecomm.commissioning.doctor import IdleObservation, ask, judge, listen, measured_content
from drivecomm.errors import LeaseError, LinkDownError, UsageError
from drivecomm.line import in_own_thread
from drivecomm.server.survey import SurveyBus
from drivecomm.transport import SerialPort

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable, Mapping, Sequence

    from drivecomm.commissioning.doctor import Measurements
    from drivecomm.link import Echo, Port, TraceEvent
    from drivecomm.protocol import DriveConfig
    from drivecomm.server.core import Core
    from drivecomm.server.door import Examination
    from drivecomm.server.served_line import ServedLine
    from drivecomm.transport import PortReport

_PROBES = 24

MOST_WAITING = 10_000
"""Telegrams of a trace that are queued for a slow reader; later ones are dropped and counted."""


def examination(core: Core, line: str, what: Examination, choices: Mapping[str, Any]) -> AsyncIterator[dict[str, Any]]:
    """Return an iterator over the findings of an examination, for the core's event loop. Raises UsageError."""
    served = core.line(line)
    if what == "scan":
        return _scan(served, choices)
    if what == "doctor":
        if kept := [each.name for each in served.drives if each.name in core.kept]:
            raise LeaseError(f"{kept[0]} is kept running on line {line}, whose port is needed for this; stop it first")
        place = core.plant.line(line)
        return _doctor(served, [place.reached(each) for each in core.plant.on_line(line)], choices)
    if what == "trace":
        return _trace(served)
    if what == "statistics":
        return _statistics(served)
    raise UsageError(f"a line does not support {what!r}; it supports scan, doctor, trace and statistics")


async def _scan(line: ServedLine, choices: Mapping[str, Any]) -> AsyncIterator[dict[str, Any]]:
    """Yield the drives found by a scan, and its progress in between."""
    given = dict(choices)
    tried = given.pop("choices", None)
    if tried is not None:
        tried = LineChoices(**{name: tuple(some) for name, some in tried.items()})
    progress: list[tuple[str, int, int]] = []
    await line.opened()
    found = line.bus.scan(
        given.pop("only", None),
        given.pop("addresses", None),
        choices=tried,
        progress=lambda *step: progress.append(step),
        **drive_options(given.pop("options", None) or {}),
    )
    coming = asyncio.ensure_future(anext(found, None))
    try:
        while True:
            await asyncio.wait([coming], timeout=0.2)
            if progress:
                asking, done, total = progress[-1]
                progress.clear()
                yield {"progress": [asking, done, total]}
            if coming.done():
                if (one := coming.result()) is None:
                    return
                yield {"found": plain(one)}
                coming = asyncio.ensure_future(anext(found, None))
    finally:
        coming.cancel()
        await asyncio.gather(coming, return_exceptions=True)
        await found.aclose()  # type: ignore[attr-defined]


async def _trace(line: ServedLine) -> AsyncIterator[dict[str, Any]]:
    """Yield every telegram on a line."""
    waiting: deque[TraceEvent] = deque(maxlen=MOST_WAITING)
    came, lost = asyncio.Event(), 0

    def hear(event: TraceEvent) -> None:
        nonlocal lost
        lost += len(waiting) == MOST_WAITING
        waiting.append(event)
        came.set()

    end = line.bus.listen(hear)
    try:
        # Sent before the first telegram, so that the reader knows when listening began.
        yield {"listening": line.line.name}
        while True:
            await came.wait()
            came.clear()
            while waiting:
                event = waiting.popleft()
                yield {
                    "time": event.time,
                    "what": event.what,
                    "drive": event.drive,
                    "data": plain(event.data),
                    "detail": event.detail,
                    "lost": lost,
                }
    finally:
        end()


async def _statistics(line: ServedLine) -> AsyncIterator[dict[str, Any]]:
    """Yield the counters and reply times of each drive that requests were sent to."""
    for name, each in line.bus.statistics.items():
        times = plain(each.reply_times)
        shortest = times["shortest_s"] if each.reply_times.count else None
        yield {
            "drive": name,
            "counters": dict(each.counters),
            "reply_times": {**times, "shortest_s": shortest},
        }


async def _doctor(line: ServedLine, drives: Sequence[DriveConfig], choices: Mapping[str, Any]) -> AsyncIterator[Any]:
    """Examine a line as `drivecomm doctor` does; its port is lent only during the second in which it listens.

    All requests to drives are surveys on the line: stops, commands, reads and polls go between them.
    """
    told: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
    loop, only = asyncio.get_running_loop(), choices.get("only")
    echo: Echo = "expect" if line.line.echo else "off"
    facts = drive_options(choices.get("options") or {})

    def progress(*step: Any) -> None:
        loop.call_soon_threadsafe(told.put_nowait, {"progress": list(step)})

    def listening(port: Port, lent: Port) -> tuple[PortReport | None, IdleObservation]:
        report = port.report() if isinstance(port, SerialPort) else None
        return report, listen(lent, only=only, echo=echo, progress=progress, **facts)

    async def work() -> tuple[PortReport | None, Measurements]:
        report, heard = None, IdleObservation(paced=True, carries_settings=True, echo=echo)
        # A stop takes the port back; noise and echo are not judged then.
        with suppress(LinkDownError):
            report, heard = await line.bus.lend(listening)
        return report, await in_own_thread(
            partial(
                ask,
                survey,
                heard,
                only=only,
                addresses=choices.get("addresses"),
                expected=[each for each in drives if not only or each.protocol in only],
                probes=int(choices.get("probes") or _PROBES),
                search=bool(choices.get("search", True)),
                rates=bool(choices.get("rates", False)) and heard.carries_settings,
                progress=progress,
                **facts,
            )
        )

    await line.opened()
    survey = SurveyBus(line.bus, loop)
    examining = asyncio.ensure_future(work())
    try:
        while not examining.done():
            await asyncio.wait([examining], timeout=0.1)
            while not told.empty():
                yield told.get_nowait()
        report, found = examining.result()
    finally:
        survey.close()
        examining.cancel()
        await asyncio.gather(examining, return_exceptions=True)
    for finding in judge(found, report):
        yield {"finding": plain(finding)}
    yield {"measured": plain(measured_content(report, found))}


class Crossing:
    """Items of a source in one event loop, for a reader in another loop; made and used in the reader's loop."""

    def __init__(self, source: Callable[[], AsyncIterator[Mapping[str, Any]]], loop: asyncio.AbstractEventLoop) -> None:
        self._source, self._loop = source, loop
        self._here = asyncio.get_running_loop()
        self._items: asyncio.Queue[Mapping[str, Any] | BaseException | None] = asyncio.Queue()

    async def items(self) -> AsyncIterator[Mapping[str, Any]]:
        """Yield the items of the source; raise its errors."""
        work = asyncio.run_coroutine_threadsafe(self._pass_on(), self._loop)
        try:
            while (item := await self._items.get()) is not None:
                if isinstance(item, BaseException):
                    raise item
                yield item
        finally:
            work.cancel()

    async def _pass_on(self) -> None:
        end: BaseException | None = None
        try:
            async for item in self._source():
                self._here.call_soon_threadsafe(self._items.put_nowait, item)
                # Wait for a slow reader in this task, which does not delay the line.
                while self._items.qsize() > MOST_WAITING:  # noqa: ASYNC110 - the queue belongs to another loop
                    await asyncio.sleep(0.01)
        except Exception as error:  # noqa: BLE001 - the reader gets the error
            end = error
        self._here.call_soon_threadsafe(self._items.put_nowait, end)
