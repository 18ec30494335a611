"""Surveys on a line of the server: many requests in a row, which yield to other users but get a share of the turns."""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING, Any, TypeVar

from drivecomm.bus import BlockingCalls, DriveVerbs, ScanRequest, Search
from drivecomm.errors import OvertakenError, UsageError
from drivecomm.line import Rank

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from drivecomm.bus import AsyncBus, Found
    from drivecomm.line import Job
    from drivecomm.link import CommandCall, Peer, TraceEvent
    from drivecomm.protocol import Exchange, MachineUnit

T = TypeVar("T")


class SurveyedDrive(DriveVerbs["SurveyBus"], BlockingCalls):
    """A drive of a `SurveyBus`."""


class SurveyBus:
    """The bus of a line for use from a separate thread: every verb blocks, at the rank of a survey.

    After `close` every request raises UsageError, which ends the survey when its client has gone.
    """

    def __init__(self, bus: AsyncBus, loop: asyncio.AbstractEventLoop) -> None:
        self._bus = bus
        self._loop = loop
        self._closed = False
        self._is_asking = False

    def drive(
        self, protocol: str, address: int, *, machine: MachineUnit | None = None, **options: Any
    ) -> SurveyedDrive:
        """Return the drive at an address; nothing is sent."""
        return SurveyedDrive(self, *self._bus.member(protocol, address, **{"attempts": 1, **options}), machine)

    def scan(
        self,
        only: Iterable[str] | None = None,
        addresses: Iterable[int] | None = None,
        *,
        progress: Callable[[str, int, int], None] | None = None,
        **options: Any,
    ) -> Iterator[Found]:
        """Yield the drives that answer, as `Bus.scan` does; each address gets one request."""
        search = Search(only, addresses)
        for each in self._bus.questions(search, progress, {"attempts": 1, **options}):
            if isinstance(each, ScanRequest):
                each.found = self._asked(each)
            else:
                yield search.model_of(each)

    def run(self, job: Job[T]) -> T:
        """Carry out a job when the line is free, or when it is the turn of a survey."""
        if self._closed:
            raise UsageError("the examination was abandoned")
        asked = job._replace(exchange=self._marked(job.exchange), rank=Rank.SURVEY)
        return asyncio.run_coroutine_threadsafe(self._bus.run(asked), self._loop).result()

    def listen(self, listener: Callable[[TraceEvent], None]) -> Callable[[], None]:
        """Call a listener with the telegrams of this survey only; return a function that removes it."""
        return self._bus.listen(lambda event: listener(event) if self._is_asking else None)

    def now(self) -> float:
        """Return the time of the line's clock in seconds."""
        return self._bus.now()

    def sleep_until(self, until: float) -> None:
        """Wait until a time of the line's clock; other users can use the line meanwhile."""
        time.sleep(max(0.0, until - self.now()))

    def close(self) -> None:
        """End the survey at its next request."""
        self._closed = True

    def command(self, peer: Peer, check: Callable[[], None] | None = None) -> CommandCall:  # noqa: ARG002 - see `Bus`
        """Refuse: a survey sends no commands."""
        raise UsageError(f"{peer.name} is open for a survey, which sends no commands")

    def storing(self, peer: Peer, parameter: str) -> None:
        """Refuse: a survey writes nothing."""
        raise UsageError(f"{parameter} of {peer.name} is open for a survey, which writes nothing")

    def kept_in_ram(self, peer: Peer, parameter: str) -> None:
        """Refuse: a survey writes nothing."""
        raise UsageError(f"{parameter} of {peer.name} is open for a survey, which writes nothing")

    def in_ram_only(self, peer: Peer) -> frozenset[str]:  # noqa: ARG002 - see `Bus`
        """Return an empty set: a survey writes nothing."""
        return frozenset()

    def watched(self, peer: Peer, silence_s: float | None) -> None:
        """Do nothing: a survey changes no watchdog."""

    def wall_time(self) -> float:
        """Return the time in seconds since 1970."""
        return self._bus.wall_time()

    def _asked(self, question: ScanRequest) -> Found | None:
        """Send a request, again each time that a stop overtakes it."""
        while True:
            try:
                return self.run(question.job)
            except OvertakenError:
                continue

    def _marked(self, exchange: Exchange[T]) -> Exchange[T]:
        self._is_asking = True
        try:
            return (yield from exchange)
        finally:
            self._is_asking = False
