"""One line that a server owns, with what `Bus` offers: its drives are asked and commanded through the server."""

from __future__ import annotations

import os
import time
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any, NoReturn, Self

from drivecomm.client.connection import LONGEST_S, LocalServer
from drivecomm.client.served_drive import READING, ServedBroadcast, ServedDrive
from drivecomm.client.wire import error_of, result_of
from drivecomm.errors import UsageError, shortened
from drivecomm.protocol import LINE_FACT_NAMES, DriveConfig

if TYPE_CHECKING:
    from collections import Counter
    from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
    from pathlib import Path

    from drivecomm.bus import Found, Job, LineChoices, Member
    from drivecomm.capture import Record
    from drivecomm.client.registration import Registration
    from drivecomm.link import CommandCall, Health, Peer, Port, Statistics, TraceEvent
    from drivecomm.polling import PollItem, PollResult
    from drivecomm.protocol import LineSettings, Model
    from drivecomm.transport import Engine

# What a call may take in all unless its drive says otherwise, and the way there and back.
_CALL_S = 30.0
_WAY_S = 5.0
_VALID_S = 10


class LineOfServer:
    """What buses of a server have in common: which drives there are, and what is sent of them.

    line: what the server calls it. drives: those of its plant on this line, with what holds for them on it. trace:
    called for everything that happens on the line, record: gets every byte, both for as long as the bus is open.
    facts: line facts for all drives, and what else `open_bus` takes, which is the server's to decide.
    """

    def __init__(
        self,
        server: Registration,
        line: str,
        drives: Iterable[DriveConfig] = (),
        *,
        trace: Callable[[TraceEvent], None] | None = None,
        record: Record | None = None,
        **facts: Any,
    ) -> None:
        self.server = LocalServer(server)
        self.line = line
        self.port = server.lines.get(line, "")
        self._facts = {name: value for name, value in facts.items() if name in LINE_FACT_NAMES and value is not None}
        self._known = {str(each): each for each in drives}
        self._trace = trace
        self._record = record
        self._before: Mapping[str, Statistics] | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The drives of the server's plant on this line, as PROTOCOL:ADDRESS."""
        return tuple(sorted(self._known))

    @property
    def settings(self) -> LineSettings | None:
        """The line settings of its first drive; None without any."""
        first = next(iter(self._known.values()), None)
        return None if first is None else self.member(first, read_only=False).peer.facts.settings

    def described(
        self,
        protocol: str,
        address: int,
        model: object,
        set_up: object,
        options: Mapping[str, Any],
        *,
        read_only: bool,
    ) -> dict[str, Any]:
        """Return what is said of a drive, as `SentDrive` takes it. Raises UsageError for what no server does."""
        if set_up:
            raise UsageError(
                f"{protocol}:{shortened(address)} cannot be set up through a server; write these parameters, or end "
                f"{self.server.registration} and try again"
            )
        known = self._known.get(f"{protocol}:{address}")
        given = {**self._facts, **options, **({} if model is None else {"model": model})}
        of_plant = {} if known is None else dict(known.options)
        return {
            "config": DriveConfig(protocol=protocol, address=address, options={**of_plant, **given}),
            "said": _news(given, of_plant),
            "known": known,
            "read_only": read_only,
        }

    def member(self, config: DriveConfig, *, read_only: bool) -> Member:
        """Return what a drive is made of here, as a bus of one's own would make it. Raises UsageError."""
        from drivecomm.bus import Roster  # noqa: PLC0415 - for those who ask what sends nothing

        options = dict(config.options)
        model = options.pop("model", None)
        return Roster(self._facts).member(config.protocol, config.address, model, None, options, read_only=read_only)

    def carry_out(self, of: Any, verb: str, arguments: Mapping[str, Any]) -> Any:
        """Have the server carry out a verb; each kind of bus says whether that is waited for or awaited."""
        raise NotImplementedError

    def sent(self, of: Any, verb: str, arguments: Mapping[str, Any]) -> Any:
        """Have the server carry out a verb, and return its result; raises the error that it ends with."""
        content = {"id": os.urandom(8).hex(), **of.request(arguments)}
        limit_s = float(content.get("options", {}).get("deadline_s", _CALL_S)) + _WAY_S
        reads = verb in READING
        if not reads:
            # As long as a server lets a command wait for its turn; one that hung meanwhile does not carry it out later.
            content |= {"issued_s": time.time(), "valid_s": _VALID_S}
        post = self.server.read if reads else self.server.order
        answer = post(f"{of.place}/{verb}", content, limit_s=max(limit_s, LONGEST_S))
        if answer.get("error"):
            raise of.own_error(error_of(answer["error"]))
        return result_of(answer.get("result"))

    def command(self, peer: Peer) -> CommandCall | None:  # noqa: ARG002 - see `Bus`
        """Take no note of what is commanded: the server does, for everybody."""
        return None

    def storing(self, peer: Peer, parameter: str) -> None:
        """Count no writes to EEPROM: the server does, for everybody."""

    def watched(self, peer: Peer, silence_s: float | None) -> None:
        """Take no note of a watchdog: its drive lets the server know."""

    def wall_time(self) -> float:
        """Return the time in seconds since 1970."""
        return time.time()

    @property
    def real_time(self) -> bool:
        """Whether time passes by itself, as it does here."""
        return True


class ServedBus(LineOfServer):
    """A line that a server owns; may be used from many threads.

    It offers what `Bus` offers, but that a job of one's own cannot be sent.
    """

    def __init__(self, *given: Any, **options: Any) -> None:
        super().__init__(*given, **options)
        self._closed = False
        self._stack = ExitStack()
        if self._trace is not None or self._record is not None:
            from drivecomm.client.line_trace import traced  # noqa: PLC0415 - for those who look at the line

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
        from drivecomm.bus import Roster  # noqa: PLC0415 - as above

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
        from drivecomm.client.line_streams import scan  # noqa: PLC0415 - for those who scan

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
        from drivecomm.client.line_trace import traced  # noqa: PLC0415 - for those who look at the line

        listening = self._stack.enter_context(ExitStack())
        listening.enter_context(traced(self, listener, None))
        return listening.close

    def poll(
        self, items: Iterable[PollItem[ServedDrive]], *, duration_s: float | None = None, cycles: int | None = None
    ) -> Generator[PollResult, None, None]:
        """Yield the results of a poll plan for drives on this bus; see `drivecomm.poll`."""
        from drivecomm.polling import poll  # noqa: PLC0415 - for those who poll

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
        from drivecomm.client.line_streams import since, statistics  # noqa: PLC0415 - for those who count

        now = statistics(self.server, self.line)
        return now if self._before is None else since(self._before, now)

    def count_from_now(self) -> None:
        """Let what was counted until now not be counted."""
        self._before = None
        self._before = self.statistics

    @property
    def health(self) -> Mapping[str, Health]:
        """Whether the drives answer, by name; of those of the server's plant."""
        from drivecomm.client.line_streams import health  # noqa: PLC0415 - for those who ask

        return health(self.server, self.line)

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


def _news(given: Mapping[str, Any], known: Mapping[str, Any]) -> dict[str, Any]:
    """Return what is said of a drive and the server does not know."""
    news = {name: value for name, value in given.items() if name not in known or known[name] != value}
    return {**news, "model": _found_from_anywhere(news["model"])} if "model" in news else news


def _found_from_anywhere(model: Any) -> str:
    """Return a model as its name, or its file wherever the server was started."""
    if not isinstance(model, str | os.PathLike):
        raise UsageError("a model that was made by a program cannot be sent to a server; give its name or its file")
    text = os.fspath(model)
    return os.path.abspath(text) if text.endswith(".toml") else text  # noqa: PTH100
