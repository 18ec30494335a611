"""Line that a server owns, with the interface of `Bus`: its drives are read and commanded through the server."""

from __future__ import annotations

import time
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any, Self

from drivecomm.bus import Broadcast, Drive, carry_out
from drivecomm.client.line_of_server import LineOfServer
from drivecomm.client.served_drive import RemoteBroadcastBase, RemoteDriveBase
from drivecomm.protocol import Stop

if TYPE_CHECKING:
    from collections import Counter
    from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
    from pathlib import Path

    from drivecomm.bus import Found, LineChoices, OnResult, StopResult
    from drivecomm.line import PollItem, PollResult
    from drivecomm.link import Health, Statistics, TraceEvent
    from drivecomm.protocol import DriveConfig, MachineUnit, Model, StopName


class ServedDrive(RemoteDriveBase, Drive):
    """Drive on a line of a server; made by `ServedBus.drive`.

    Errors of the server or the drive are raised as by `Drive`; ServerLostError if the server is gone.
    """

    _bus: ServedBus

    @property
    def standing_stop(self) -> str:
        """Stop that the server retries, or that one of its doors demands, in words; empty without one."""
        state = self._bus.server.ask(self.place) if self._known is not None else {}
        return str((state.get("standing_stop") or {}).get("text", ""))


class ServedBroadcast(RemoteBroadcastBase, Broadcast):
    """All drives of one protocol on a line of a server, addressed together; the counterpart of `Broadcast`."""

    _bus: ServedBus


class ServedBus(LineOfServer):
    """Line that a server owns, a `BlockingLine`; safe for use from many threads."""

    def __init__(self, *given: Any, **options: Any) -> None:
        super().__init__(*given, **options)
        self._stack = ExitStack()
        if self._trace is not None or self._record is not None:
            from drivecomm.client.line_trace import traced

            self._stack.enter_context(traced(self, self._trace, self._record))

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
    ) -> ServedDrive:
        """Return the drive at an address; see `Bus.drive`. Nothing is sent."""
        said = self.described(protocol, address, model, set_up, options, read_only=read_only, machine=machine)
        return ServedDrive(self, **said)

    def broadcast(self, protocol: str, *, model: str | Path | Model | None = None, **options: Any) -> ServedBroadcast:
        """Return all drives of a protocol, addressed together; see `Bus.broadcast`."""
        return ServedBroadcast(self, *self.all_made_here(protocol, model, options))

    def at_server(self, do: Callable[[], Any]) -> Any:
        """Run a request to the server."""
        self._check_open()
        return do()

    def carry_out(self, of: Any, verb: str, arguments: Mapping[str, Any]) -> Any:
        """Run a verb at the server."""
        self._check_open()
        return self.sent(of, verb, arguments)

    def scan(
        self,
        only: Iterable[str] | None = None,
        addresses: Iterable[int] | None = None,
        *,
        choices: LineChoices | None = None,
        progress: Callable[[str, int, int], None] | None = None,
        **options: Any,
    ) -> Iterator[Found]:
        """Yield the drives that answer, as `Bus.scan` does; the server scans in between its other requests."""
        from drivecomm.client.line_streams import scan

        self._check_open()
        asked = {
            "only": None if only is None else list(only),
            "addresses": None if addresses is None else list(addresses),
            "choices": choices,
            "options": {**self._facts, **{name: value for name, value in options.items() if value is not None}},
        }
        return scan(self.server, self.line, asked, progress)

    def stop_all(
        self,
        how: Stop | StopName = Stop.RAMP,
        *,
        drives: Iterable[DriveConfig] | None = None,
        on_result: OnResult | None = None,
    ) -> list[StopResult]:
        """Stop all motors of the server's plant on this line, and return the result of each stop; see `Bus.stop_all`.

        drives: further drives on this line.
        """
        from drivecomm.client.stopping_lines import stopping_served_line

        return carry_out(None, stopping_served_line(self, drives, how, on_result))

    def listen(self, listener: Callable[[TraceEvent], None]) -> Callable[[], None]:
        """Report events of the line to a listener from now on; return a function that stops the reports."""
        from drivecomm.client.line_trace import traced

        listening = self._stack.enter_context(ExitStack())
        listening.enter_context(traced(self, listener, None))
        return listening.close

    def poll(
        self, items: Iterable[PollItem[Drive]], *, duration_s: float | None = None, cycles: int | None = None
    ) -> Generator[PollResult, None, None]:
        """Yield the results of a poll plan for drives on this bus; see `drivecomm.poll`."""
        from drivecomm.line import poll

        return poll(self.on_this_line(items, "drivecomm.poll"), duration_s=duration_s, cycles=cycles)

    def now(self) -> float:
        """Return the monotonic time of this machine in seconds."""
        self._check_open()
        return time.monotonic()

    def sleep_until(self, until: float) -> None:
        """Sleep until this time of the monotonic clock."""
        while (left := until - time.monotonic()) > 0:
            time.sleep(left)

    @property
    def counters(self) -> Mapping[str, Counter[str]]:
        """Counts of line events by drive, for the requests of all clients; see `statistics`."""
        return {name: each.counters for name, each in self.statistics.items()}

    @property
    def statistics(self) -> Mapping[str, Statistics]:
        """Counters and reply times since `count_from_now`, by drive, for the requests of all clients.

        Without a call of `count_from_now`, they count from the start of the server.
        """
        from drivecomm.client.line_streams import since, statistics

        now = statistics(self.server, self.line)
        return now if self._before is None else since(self._before, now)

    def count_from_now(self) -> None:
        """Reset the counters and reply times of this bus to zero."""
        self._before = None
        self._before = self.statistics

    @property
    def health(self) -> Mapping[str, Health]:
        """Health of the drives of the server's plant, by name."""
        from drivecomm.client.line_streams import health

        return health(self.server, self.line)

    @property
    def other_master(self) -> str:
        """Reason why the line counts as shared with another master, empty if no other master was heard lately."""
        from drivecomm.client.line_streams import other_master

        return other_master(self.server, self.line)

    def close(self) -> None:
        """End all activity of this bus at the server; the server continues. Raises the error of the trace function."""
        self._closed = True
        try:
            self._stack.close()
        finally:
            self.server.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
