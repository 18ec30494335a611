"""One line that a server owns, with what `Bus` offers: its drives are asked and commanded through the server."""

from __future__ import annotations

import time
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any, NoReturn, Self

from drivecomm.bus import BroadcastVerbs, Sent, carry_out, reaching
from drivecomm.client.line_of_server import LineOfServer
from drivecomm.client.served_drive import SentDrive
from drivecomm.errors import UsageError

if TYPE_CHECKING:
    from collections import Counter
    from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
    from pathlib import Path

    from drivecomm.bus import Found, Goal, LineChoices
    from drivecomm.errors import DriveCommError
    from drivecomm.line import Job
    from drivecomm.link import Health, Port, Statistics, TraceEvent
    from drivecomm.polling import PollItem, PollResult
    from drivecomm.protocol import DriveStatus, Model
    from drivecomm.transport import Engine


class ServedDrive(SentDrive["ServedBus"]):
    """One drive on a line of a server, with all that `Drive` offers; made by `ServedBus.drive`.

    Whatever the server or the drive answers with is raised as `Drive` raises it; ServerLostError where it is gone.
    """

    _bus: ServedBus

    @property
    def standing_stop(self) -> str:
        """The stop that the server retries, or that one of its doors demands, in words; empty without one."""
        state = self.bus.server.ask(self.place) if self._known is not None else {}
        return str((state.get("standing_stop") or {}).get("text", ""))

    def wait_for(self, goal: Goal, timeout_s: float = 10.0) -> DriveStatus:
        """Ask for the status until the drive is in a state, or "at_reference"; as `Drive.wait_for`."""
        reached: DriveStatus = carry_out(self, reaching(self.name, goal, timeout_s, self.bus.now))
        return reached


class ServedBroadcast(BroadcastVerbs["ServedBus"], Sent):
    """All drives of one protocol on a line of a server at once, as `Broadcast` has them."""

    @property
    def place(self) -> str:
        """Where the server has them."""
        from urllib.parse import quote

        return f"/api/v1/lines/{quote(self._bus.line, safe='')}/drives/{self._peer.name}"

    def send(self, verb: str, arguments: dict[str, Any], job: Callable[[], Job[Any]]) -> Any:
        """Have the server carry out a verb."""
        job()
        return self._bus.carry_out(self, verb, arguments)

    def request(self, arguments: Mapping[str, Any]) -> dict[str, Any]:
        """Return what is sent besides the verb."""
        return {"arguments": arguments, "arm": True}

    def own_error(self, error: DriveCommError) -> DriveCommError:
        """Return the error that the server has answered with."""
        return error


class ServedBus(LineOfServer):
    """A line that a server owns; may be used from many threads.

    It offers what `Bus` offers, but that a job of one's own cannot be sent.
    """

    def __init__(self, *given: Any, **options: Any) -> None:
        super().__init__(*given, **options)
        self._closed = False
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
        **options: Any,
    ) -> ServedDrive:
        """Return the drive at an address, as `Bus.drive` does; nothing is sent."""
        return ServedDrive(self, **self.described(protocol, address, model, set_up, options, read_only=read_only))

    def broadcast(self, protocol: str, *, model: str | Path | Model | None = None, **options: Any) -> ServedBroadcast:
        """Return all drives of a protocol at once, as `Bus.broadcast` does."""
        from drivecomm.bus import Roster

        made = Roster(self._facts).all_drives(protocol, model, options)
        return ServedBroadcast(self, made.peer, made.operations)

    def carry_out(self, of: Any, verb: str, arguments: Mapping[str, Any]) -> Any:
        """Have the server carry out a verb."""
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
        """Yield the drives that answer, as `Bus.scan` does; the server asks, between what else it does."""
        from drivecomm.client.line_streams import scan

        self._check_open()
        asked = {
            "only": None if only is None else list(only),
            "addresses": None if addresses is None else list(addresses),
            "choices": choices,
            "options": {**self._facts, **{name: value for name, value in options.items() if value is not None}},
        }
        return scan(self.server, self.line, asked, progress)

    def listen(self, listener: Callable[[TraceEvent], None]) -> Callable[[], None]:
        """Tell a function what happens on the line from now on; returns what ends that."""
        from drivecomm.client.line_trace import traced

        listening = self._stack.enter_context(ExitStack())
        listening.enter_context(traced(self, listener, None))
        return listening.close

    def poll(
        self, items: Iterable[PollItem[ServedDrive]], *, duration_s: float | None = None, cycles: int | None = None
    ) -> Generator[PollResult, None, None]:
        """Yield the results of a poll plan for drives on this bus; see `drivecomm.poll`."""
        from drivecomm.polling import poll

        plan = list(items)
        for item in plan:
            if item.drive.bus is not self:
                raise UsageError(f"{item.drive.name} is not on this bus; poll it with drivecomm.poll")
        return poll(plan, duration_s=duration_s, cycles=cycles)

    def run(self, job: Job[Any]) -> NoReturn:  # noqa: ARG002 - see `Bus`
        """Refuse a job of one's own: only verbs can be sent."""
        raise self._only_verbs()

    def lend(self, work: Callable[[Port, Port], Any]) -> NoReturn:  # noqa: ARG002 - see `Bus`
        """Refuse to lend the port, which is the server's."""
        raise self._only_verbs()

    def questions(self, *_: Any) -> NoReturn:
        """Refuse the questions of a scan, which the server asks."""
        raise self._only_verbs()

    def on_engine(self, engine: Engine) -> None:
        """Return that no engine can serve it."""

    def now(self) -> float:
        """Return the time of this machine's clock that nobody sets, in seconds."""
        self._check_open()
        return time.monotonic()

    def sleep_until(self, until: float) -> None:
        """Let time pass."""
        while (left := until - time.monotonic()) > 0:
            time.sleep(left)

    @property
    def counters(self) -> Mapping[str, Counter[str]]:
        """What happened on the line since this bus was made, by drive, whoever asked."""
        return {name: each.counters for name, each in self.statistics.items()}

    @property
    def statistics(self) -> Mapping[str, Statistics]:
        """The counters and the reply times since they were asked for first, by drive; whoever asked the drives.

        The first time it is all since the server began.
        """
        from drivecomm.client.line_streams import since, statistics

        now = statistics(self.server, self.line)
        return now if self._before is None else since(self._before, now)

    def count_from_now(self) -> None:
        """Let what was counted until now not be counted."""
        self._before = None
        self._before = self.statistics

    @property
    def health(self) -> Mapping[str, Health]:
        """Whether the drives answer, by name; of those of the server's plant."""
        from drivecomm.client.line_streams import health

        return health(self.server, self.line)

    @property
    def other_master(self) -> str:
        """Why the line counts as shared with another master, empty if nobody else was heard on it lately."""
        from drivecomm.client.line_streams import other_master

        return other_master(self.server, self.line)

    def close(self) -> None:
        """End what was begun through the server; it goes on."""
        self._stack.close()
        self._closed = True
        self.server.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _only_verbs(self) -> UsageError:
        return UsageError(
            f"{self.port} is the port of {self.server.registration}, to which only verbs of a drive can be sent; end "
            "that server to use the port itself"
        )

    def _check_open(self) -> None:
        if self._closed:
            raise UsageError("this bus is closed; open it again with open_bus")
