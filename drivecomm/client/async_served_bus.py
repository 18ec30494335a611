"""One line that a server owns, for callers that await: what `drivecomm.client.served_bus` offers, asked in threads."""

from __future__ import annotations

import asyncio
import time
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any, Self

from drivecomm.bus import carry_out_async, reaching
from drivecomm.client.line_of_server import LineOfServer
from drivecomm.client.line_streams import since, statistics
from drivecomm.client.line_trace import traced
from drivecomm.client.served_drive import SentDrive
from drivecomm.errors import LinkError
from drivecomm.transport import in_own_thread

if TYPE_CHECKING:
    from collections.abc import Coroutine, Mapping
    from pathlib import Path

    from drivecomm.bus import Goal
    from drivecomm.link import Statistics, TraceEvent
    from drivecomm.protocol import DriveStatus, Model

_COUNTED_EVERY_S = 1.0


class AsyncServedDrive(SentDrive["AsyncServedBus"]):
    """One drive on a line of a server, with all that `AsyncDrive` offers; made by `AsyncServedBus.drive`."""

    async def wait_for(self, goal: Goal, timeout_s: float = 10.0) -> DriveStatus:
        """Ask for the status until the drive is in a state, or "at_reference"; as `AsyncDrive.wait_for`."""
        reached: DriveStatus = await carry_out_async(self, reaching(self.name, goal, timeout_s, self.bus.now))
        return reached


class AsyncServedBus(LineOfServer):
    """A line that a server owns, an asynchronous context manager; for tasks of one event loop, which it never holds up.

    statistics: since it was entered, as they were a second ago at most.
    """

    def __init__(self, *given: Any, **options: Any) -> None:
        super().__init__(*given, **options)
        self._stack = ExitStack()
        self._counting: asyncio.Task[None] | None = None
        self.statistics: Mapping[str, Statistics] = {}

    def drive(
        self,
        protocol: str,
        address: int,
        *,
        model: str | Path | Model | None = None,
        set_up: Mapping[str, Any] | None = None,
        read_only: bool = False,
        **options: Any,
    ) -> AsyncServedDrive:
        """Return the drive at an address, as `AsyncBus.drive` does; nothing is sent."""
        return AsyncServedDrive(self, **self.described(protocol, address, model, set_up, options, read_only=read_only))

    def carry_out(self, of: Any, verb: str, arguments: Mapping[str, Any]) -> Coroutine[Any, Any, Any]:
        """Have the server carry out a verb; a stop waits for no thread that others use."""
        if verb == "stop":
            return in_own_thread(self.sent, of, verb, arguments)
        return asyncio.to_thread(self.sent, of, verb, arguments)

    def now(self) -> float:
        """Return the time of this machine's clock that nobody sets, in seconds."""
        return time.monotonic()

    async def sleep_until(self, until: float) -> None:
        """Let time pass."""
        await asyncio.sleep(max(0.0, until - time.monotonic()))

    async def close(self) -> None:
        """End what was begun through the server; it goes on."""
        if self._counting is not None:
            self._counting.cancel()
            await asyncio.gather(self._counting, return_exceptions=True)
            self._counting = None
        await asyncio.to_thread(self._stack.close)
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
                self.statistics = since(before, await asyncio.to_thread(statistics, self.server, self.line))
            except LinkError:
                # Those who ask the drives are told.
                before = {}
            await asyncio.sleep(_COUNTED_EVERY_S)
