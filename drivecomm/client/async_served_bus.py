"""Line that a server owns, for asyncio callers: the interface of `drivecomm.client.served_bus`, run in threads."""

from __future__ import annotations

import asyncio
import time
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any, Self

from drivecomm.bus import AsyncBroadcast, AsyncDrive, carry_out_async
from drivecomm.client.line_of_server import LineOfServer
from drivecomm.client.line_streams import since, statistics
from drivecomm.client.line_trace import traced
from drivecomm.client.served_drive import RemoteBroadcastBase, RemoteDriveBase
from drivecomm.client.stopping_lines import stopping_served_line
from drivecomm.errors import LinkError
from drivecomm.line import in_own_thread, poll_async
from drivecomm.protocol import Stop

if TYPE_CHECKING:
    from collections import Counter
    from collections.abc import AsyncGenerator, Callable, Coroutine, Iterable, Mapping
    from pathlib import Path

    from drivecomm.bus import OnResult, StopResult
    from drivecomm.line import PollItem, PollResult
    from drivecomm.link import Statistics, TraceEvent
    from drivecomm.protocol import DriveConfig, MachineUnit, Model, StopName

_COUNTED_EVERY_S = 1.0


class AsyncServedDrive(RemoteDriveBase, AsyncDrive):
    """One drive on a line of a server; made by `AsyncServedBus.drive`."""

    _bus: AsyncServedBus


class AsyncServedBroadcast(RemoteBroadcastBase, AsyncBroadcast):
    """All drives of one protocol on a line of a server, addressed together; the counterpart of `AsyncBroadcast`."""

    _bus: AsyncServedBus


class AsyncServedBus(LineOfServer):
    """Line that a server owns, an `AwaitedLine`; for tasks of one event loop, which it never blocks."""

    def __init__(self, *given: Any, **options: Any) -> None:
        super().__init__(*given, **options)
        self._stack = ExitStack()
        self._counting: asyncio.Task[None] | None = None
        self._statistics: Mapping[str, Statistics] = {}

    def drive(
        self,
        protocol: str,
        address: int,
        *,
        model: str | Path | Model | None = None,
        set_up: Mapping[str, Any] | None = None,
        read_only: bool = False,
        machine: MachineUnit | None = None,
        **options: Any,
    ) -> AsyncServedDrive:
        """Return the drive at an address; see `AsyncBus.drive`. Nothing is sent."""
        said = self.described(protocol, address, model, set_up, options, read_only=read_only, machine=machine)
        return AsyncServedDrive(self, **said)

    def broadcast(
        self, protocol: str, *, model: str | Path | Model | None = None, **options: Any
    ) -> AsyncServedBroadcast:
        """Return all drives of a protocol, addressed together; see `AsyncBus.broadcast`."""
        return AsyncServedBroadcast(self, *self.all_made_here(protocol, model, options))

    def poll(
        self, items: Iterable[PollItem[AsyncDrive]], *, duration_s: float | None = None, cycles: int | None = None
    ) -> AsyncGenerator[PollResult, None]:
        """Yield the results of a poll plan for drives on this bus; see `drivecomm.poll_async`."""
        return poll_async(self.on_this_line(items, "drivecomm.poll_async"), duration_s=duration_s, cycles=cycles)

    async def stop_all(
        self,
        how: Stop | StopName = Stop.RAMP,
        *,
        drives: Iterable[DriveConfig] | None = None,
        on_result: OnResult | None = None,
    ) -> list[StopResult]:
        """Stop all motors of the server's plant on this line, and return the result of each stop; see `Bus.stop_all`.

        drives: further drives on this line.
        """
        return await carry_out_async(None, stopping_served_line(self, drives, how, on_result))

    @property
    def counters(self) -> Mapping[str, Counter[str]]:
        """Counts of line events since the bus was entered, by drive, at most one second old."""
        return {name: each.counters for name, each in self._statistics.items()}

    @property
    def statistics(self) -> Mapping[str, Statistics]:
        """Counters and reply times since the bus was entered, by drive, at most one second old."""
        return self._statistics

    def at_server(self, do: Callable[[], Any]) -> Coroutine[Any, Any, Any]:
        """Run a request to the server in its own thread, so that a lease never waits for a busy thread pool."""
        self._check_open()
        return in_own_thread(do)

    def carry_out(self, of: Any, verb: str, arguments: Mapping[str, Any]) -> Coroutine[Any, Any, Any]:
        """Run a verb at the server; a stop gets its own thread, so that it never waits for a busy pool."""
        self._check_open()
        if verb == "stop":
            return in_own_thread(self.sent, of, verb, arguments)
        return asyncio.to_thread(self.sent, of, verb, arguments)

    def now(self) -> float:
        """Return the monotonic time of this machine in seconds."""
        self._check_open()
        return time.monotonic()

    async def sleep_until(self, until: float) -> None:
        """Sleep until this time of the monotonic clock."""
        await asyncio.sleep(max(0.0, until - time.monotonic()))

    async def close(self) -> None:
        """End all activity of this bus at the server; the server continues."""
        if self._counting is not None:
            self._counting.cancel()
            await asyncio.gather(self._counting, return_exceptions=True)
            self._counting = None
        self._closed = True
        try:
            await asyncio.to_thread(self._stack.close)
        finally:
            self.server.close()

    async def __aenter__(self) -> Self:
        loop, trace = asyncio.get_running_loop(), self._trace

        def tell(event: TraceEvent) -> None:
            if trace is not None and not loop.is_closed():
                loop.call_soon_threadsafe(trace, event)

        def begin() -> Mapping[str, Statistics]:
            if trace is not None or self._record is not None:
                self._stack.enter_context(traced(self, tell, self._record))
            return statistics(self.server, self.line)

        before = await asyncio.to_thread(begin)
        self._counting = asyncio.create_task(self._count(before), name=f"counting on {self.line}")
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def _count(self, before: Mapping[str, Statistics]) -> None:
        while True:
            try:
                self._statistics = since(before, await asyncio.to_thread(statistics, self.server, self.line))
            except LinkError:
                # Requests to the drives report the lost server.
                before = {}
            await asyncio.sleep(_COUNTED_EVERY_S)
