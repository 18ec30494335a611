"""Interface of a line that every bus offers, whether its port is open here or owned by a server."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol, Self, TypeVar

from drivecomm.bus.drives import AsyncBroadcast, AsyncDrive, Broadcast, Drive
from drivecomm.bus.peer_verbs import VerbsBus
from drivecomm.protocol import Stop

if TYPE_CHECKING:
    from collections import Counter
    from collections.abc import AsyncGenerator, Callable, Generator, Iterable, Iterator, Mapping
    from pathlib import Path

    from drivecomm.bus.likely_settings import LineChoices
    from drivecomm.bus.scanning import Found
    from drivecomm.bus.stopping_all import OnResult, StopResult
    from drivecomm.line import PollItem, PollResult
    from drivecomm.link import Health, Statistics, TraceEvent
    from drivecomm.protocol import DriveConfig, MachineUnit, Model, StopName

D_co = TypeVar("D_co", covariant=True)
E_co = TypeVar("E_co", covariant=True)


class LineInterface(VerbsBus, Protocol[D_co, E_co]):
    """The part of the interface that never waits. D_co: type of its drives. E_co: type for all drives of a protocol."""

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
    ) -> D_co:
        """Return the drive at an address; nothing is sent. Raises UsageError for invalid arguments."""

    def broadcast(self, protocol: str, *, model: str | Path | Model | None = None, **options: Any) -> E_co:
        """Return an object that broadcasts to all drives of a protocol.

        Raises NotSupported for a protocol without a broadcast.
        """

    def now(self) -> float:
        """Return the time on the line's clock in seconds; only differences are meaningful."""

    @property
    def real_time(self) -> bool:
        """Whether time on the line passes by itself, as on every line except a virtual one."""

    @property
    def counters(self) -> Mapping[str, Counter[str]]:
        """Requests, replies, retries, timeouts and each kind of error so far, by drive."""

    @property
    def statistics(self) -> Mapping[str, Statistics]:
        """The counters and the reply times, by drive."""


class BlockingLine(LineInterface[Drive, Broadcast], Protocol):
    """A line whose calls return when they are done: `Bus`, and `ServedBus` for a line of a server."""

    def scan(
        self,
        only: Iterable[str] | None = None,
        addresses: Iterable[int] | None = None,
        *,
        choices: LineChoices | None = None,
        progress: Callable[[str, int, int], None] | None = None,
        **options: Any,
    ) -> Iterator[Found]:
        """Yield the drives that answer; sends only requests that cannot move a motor."""

    def poll(
        self, items: Iterable[PollItem[Drive]], *, duration_s: float | None = None, cycles: int | None = None
    ) -> Generator[PollResult, None, None]:
        """Yield the results of a poll plan for drives on this line."""

    def stop_all(
        self,
        how: Stop | StopName = Stop.RAMP,
        *,
        drives: Iterable[DriveConfig] | None = None,
        on_result: OnResult | None = None,
    ) -> list[StopResult]:
        """Stop all motors of this line, and return the result of each stop."""

    def listen(self, listener: Callable[[TraceEvent], None]) -> Callable[[], None]:
        """Report every event of the line to a listener; return a function that removes the listener."""

    @property
    def health(self) -> Mapping[str, Health]:
        """Health of the drives, by name."""

    @property
    def other_master(self) -> str:
        """Why the line counts as shared with another master; empty if it does not."""

    def sleep_until(self, until: float) -> None:
        """Wait until this time on the line's clock; others may use the line meanwhile."""

    def close(self) -> None:
        """Release the line for good; the bus cannot be used any more."""

    def __enter__(self) -> Self: ...

    def __exit__(self, *_: object) -> None: ...


class AwaitedLine(LineInterface[AsyncDrive, AsyncBroadcast], Protocol):
    """A line whose calls are awaited: `AsyncBus`, and `AsyncServedBus` for a line of a server."""

    def poll(
        self, items: Iterable[PollItem[AsyncDrive]], *, duration_s: float | None = None, cycles: int | None = None
    ) -> AsyncGenerator[PollResult, None]:
        """Yield the results of a poll plan for drives on this line."""

    async def stop_all(
        self,
        how: Stop | StopName = Stop.RAMP,
        *,
        drives: Iterable[DriveConfig] | None = None,
        on_result: OnResult | None = None,
    ) -> list[StopResult]:
        """Stop all motors of this line, and return the result of each stop."""

    async def sleep_until(self, until: float) -> None:
        """Wait until this time on the line's clock; others may use the line meanwhile."""

    async def close(self) -> None:
        """Release the line for good; the bus cannot be used any more."""

    async def __aenter__(self) -> Self: ...

    async def __aexit__(self, *_: object) -> None: ...
