"""One line and its drives for asynchronous callers, with the same verbs as `drivecomm.bus.bus`."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any, Self, TypeVar, Unpack

from drivecomm.bus.drives import AsyncBroadcast, AsyncDrive
from drivecomm.bus.line_options import lists_line_options
from drivecomm.bus.opening import opened_with
from drivecomm.bus.procedures import carry_out_async
from drivecomm.bus.scanning import Found, Search
from drivecomm.bus.shared_bus import SharedBus
from drivecomm.bus.stopping_all import stopping_all
from drivecomm.errors import OvertakenError
from drivecomm.line import TaskLine, poll_async
from drivecomm.protocol import Stop

if TYPE_CHECKING:
    from collections.abc import AsyncGenerator, AsyncIterator, Callable, Iterable

    from drivecomm.bus.likely_settings import LineChoices
    from drivecomm.bus.line_drives import LineDrives
    from drivecomm.bus.line_options import LineOptions
    from drivecomm.bus.scanning import ScanRequest
    from drivecomm.bus.stopping_all import OnResult, StopResult
    from drivecomm.line import Job, PollItem, PollResult
    from drivecomm.link import Port
    from drivecomm.protocol import DriveConfig, StopName

T = TypeVar("T")


class AsyncBus(SharedBus[AsyncDrive, AsyncBroadcast]):
    """The master's side of one line, an asynchronous context manager; may be used by many tasks of one event loop.

    open_port: opens the port, on entering and again after it was lost; it may block, so it runs in a thread. roster:
    the drives and the settings that all of them share. on_close: called when the bus has been closed.
    """

    _drive = AsyncDrive
    _broadcast = AsyncBroadcast
    line: TaskLine

    def __init__(
        self, open_port: Callable[[], Port], roster: LineDrives, on_close: Callable[[], None] | None = None
    ) -> None:
        super().__init__(roster)
        self.line = TaskLine(open_port, roster.link, roster.commands, self._was_opened, on_close)

    async def scan(
        self,
        only: Iterable[str] | None = None,
        addresses: Iterable[int] | None = None,
        *,
        choices: LineChoices | None = None,
        progress: Callable[[str, int, int], None] | None = None,
        **options: Any,
    ) -> AsyncIterator[Found]:
        """Yield the drives that answer, as `Bus.scan` does; sends only requests that cannot move a motor."""
        search = Search(only, addresses, choices)
        for each in self.questions(search, progress, options):
            if isinstance(each, Found):
                # Reading the model files blocks the first time.
                yield await asyncio.to_thread(search.model_of, each)
            else:
                each.found = await self._asked(each)

    async def _asked(self, question: ScanRequest) -> Found | None:
        """Carry out a request of a scan, and repeat it while a stop goes first."""
        while True:
            try:
                return await self.run(question.job)
            except OvertakenError:
                continue

    def poll(
        self, items: Iterable[PollItem[AsyncDrive]], *, duration_s: float | None = None, cycles: int | None = None
    ) -> AsyncGenerator[PollResult, None]:
        """Yield the results of a poll plan for drives on this bus; see `drivecomm.poll_async`."""
        return poll_async(self._on_this_bus(items, "drivecomm.poll_async"), duration_s=duration_s, cycles=cycles)

    async def stop_all(
        self,
        how: Stop | StopName = Stop.RAMP,
        *,
        drives: Iterable[DriveConfig] | None = None,
        on_result: OnResult | None = None,
    ) -> list[StopResult]:
        """Stop all motors of this line, and return the result of each stop, as `Bus.stop_all` does."""
        there = self._roster.drives if drives is None else drives
        return await carry_out_async(None, stopping_all(self, there, how, on_result))

    async def run(self, job: Job[T]) -> T:
        """Carry out a job when its turn comes, as `Bus.run` does."""
        return await self.line.run(job)

    async def sleep_until(self, until: float) -> None:
        """Wait until this time on the line's clock; others may use the line meanwhile."""
        await self.line.sleep_until(until)

    async def lend(self, work: Callable[[Port, Port], T]) -> T:
        """Lend the port to a function in a thread, as `Bus.lend` does; a cancellation takes the port back."""
        return await self.line.lend(work)

    async def close(self) -> None:
        """Close the port for good; the bus cannot be used any more."""
        await self.line.close()

    async def __aenter__(self) -> Self:
        await self.line.open()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()


@lists_line_options
def open_bus_async(port: str | Callable[[], Port], **options: Unpack[LineOptions]) -> AsyncBus:
    """Return the bus of a line for `async with`, which opens it; the arguments are those of `open_bus`.

    Entering raises PortError when the port does not exist or is in use.
    """
    return AsyncBus(*opened_with(port, options))
