"""Line that a server owns, in the form of a bus: its drives, and the requests for them."""

from __future__ import annotations

import os
import time
from typing import TYPE_CHECKING, Any

from drivecomm.bus import Discoverable, check_line_options
from drivecomm.client.connection import LONGEST_S, LocalServer
from drivecomm.client.wire import error_of, result_of
from drivecomm.errors import UsageError, counted, shortened
from drivecomm.protocol import LINE_FACT_NAMES, DriveConfig

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from drivecomm.bus import DriveParts
    from drivecomm.capture import Record
    from drivecomm.client.registration import Registration
    from drivecomm.line import PollItem
    from drivecomm.link import CommandCall, Peer, Statistics, TraceEvent
    from drivecomm.protocol import LineSettings, MachineUnit, Operations


# Default limit of a whole call, and time for the way to the server and back.
_CALL_S = 30.0
_WAY_S = 5.0
_VALID_S = 10


READING = frozenset({"read", "read_many", "polled", "polled_many", "status", "polled_status", "identify", "probe"})
"""Verbs that command nothing: they may be sent twice, and need no right to command the drive."""


class LineOfServer(Discoverable):
    """Common base of the buses of a server: the drives of a line, and the requests for them.

    line: name of the line at the server. drives: drives of its plant on this line, with their settings there. trace:
    called for every event on the line. record: receives every byte. Both work while the bus is open. facts: line facts
    for all drives, and other options of `open_bus`, which the server decides.
    """

    _inner = frozenset(
        {
            "all_made_here",
            "at_server",
            "carry_out",
            "command",
            "described",
            "in_ram_only",
            "kept_in_ram",
            "made_here",
            "on_this_line",
            "sent",
            "storing",
            "wall_time",
            "watched",
        }
    )

    _closed = False

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
        check_line_options(facts)
        self.server = LocalServer(server)
        self.line = line
        self.port = server.lines.get(line, "")
        self._facts = {name: value for name, value in facts.items() if name in LINE_FACT_NAMES and value is not None}
        self._known = {str(each): each for each in drives}
        self._trace = trace
        self._record = record
        self._before: Mapping[str, Statistics] | None = None
        self._in_ram: set[tuple[str, str]] = set()

    def __repr__(self) -> str:
        drives = counted(len(self._known), "drive")
        return f"<{type(self).__name__} line {self.line} of {self.server.registration}, {drives}>"

    def _check_open(self) -> None:
        if self._closed:
            raise UsageError("this bus is closed; open it again with open_bus")

    @property
    def names(self) -> tuple[str, ...]:
        """Drives of the server's plant on this line, as PROTOCOL:ADDRESS."""
        return tuple(sorted(self._known))

    @property
    def drives(self) -> tuple[DriveConfig, ...]:
        """Drives of the server's plant on this line."""
        return tuple(self._known.values())

    @property
    def settings(self) -> LineSettings | None:
        """Line settings of the first drive; None without drives."""
        first = next(iter(self._known.values()), None)
        return None if first is None else self.made_here(first, read_only=False).peer.facts.settings

    def described(
        self,
        protocol: str,
        address: int,
        model: object,
        set_up: object,
        options: Mapping[str, Any],
        *,
        read_only: bool,
        machine: MachineUnit | None = None,
    ) -> dict[str, Any]:
        """Return the description of a drive, as arguments of `RemoteDriveBase`.

        Raises UsageError for options that do not work through a server.
        """
        if set_up:
            raise UsageError(
                f"{protocol}:{shortened(address)} cannot be set up through a server; write these parameters, or end "
                f"{self.server.registration} and try again"
            )
        known = self._known.get(f"{protocol}:{address}")
        given = {**self._facts, **options, **({} if model is None else {"model": model})}
        of_plant = {} if known is None else dict(known.options)
        machine = known.machine if machine is None and known is not None else machine
        return {
            "config": DriveConfig(protocol=protocol, address=address, options={**of_plant, **given}, machine=machine),
            "said": _news(given, of_plant),
            "known": known,
            "read_only": read_only,
        }

    def made_here(self, config: DriveConfig, *, read_only: bool) -> DriveParts:
        """Return the local objects of a drive, as a bus with its own port would make them. Raises UsageError."""
        from drivecomm.bus import LineDrives

        options = dict(config.options)
        model = options.pop("model", None)
        return LineDrives(self._facts).member(
            config.protocol, config.address, model, None, options, read_only=read_only
        )

    def all_made_here(self, protocol: str, model: Any, options: Mapping[str, Any]) -> tuple[Peer, Operations]:
        """Return peer and operations for all drives of a protocol. Raises NotSupported if it has no broadcast."""
        from drivecomm.bus import LineDrives

        made = LineDrives(self._facts).all_drives(protocol, model, options)
        return made.peer, made.operations

    def on_this_line(self, items: Iterable[PollItem[Any]], elsewhere: str) -> list[PollItem[Any]]:
        """Return the items of a poll plan. Raises UsageError for a drive on another line."""
        plan = list(items)
        for item in plan:
            if item.drive.bus is not self:
                raise UsageError(f"{item.drive.name} is not on this bus; poll it with {elsewhere}")
        return plan

    def at_server(self, do: Callable[[], Any]) -> Any:
        """Run a request to the server; blocking or awaitable, depending on the kind of bus."""
        raise NotImplementedError

    def carry_out(self, of: Any, verb: str, arguments: Mapping[str, Any]) -> Any:
        """Run a verb at the server; blocking or awaitable, depending on the kind of bus."""
        raise NotImplementedError

    def sent(self, of: Any, verb: str, arguments: Mapping[str, Any]) -> Any:
        """Run a verb at the server, and return its result; raises the error with which it ends."""
        content = {"id": os.urandom(8).hex(), **of.request(arguments)}
        limit_s = float(content.get("options", {}).get("deadline_s", _CALL_S)) + _WAY_S
        reads = verb in READING
        if not reads:
            # A server drops commands that waited longer than this, so one that hung is not carried out late.
            content |= {"issued_s": time.time(), "valid_s": _VALID_S}
        post = self.server.read if reads else self.server.order
        answer = post(f"{of.place}/{verb}", content, limit_s=max(limit_s, LONGEST_S))
        if answer.get("error"):
            raise of.own_error(error_of(answer["error"]))
        return result_of(answer.get("result"))

    def command(
        self,
        peer: Peer,  # noqa: ARG002 - see `Bus`
        check: Callable[[], None] | None = None,  # noqa: ARG002 - as above
    ) -> CommandCall | None:
        """Do nothing, because the server tracks the commands of all clients."""
        return None

    def storing(self, peer: Peer, parameter: str) -> None:
        """Count no stored write, because the server counts those of all clients."""
        self._in_ram.discard((peer.name, parameter.partition("[")[0]))

    def kept_in_ram(self, peer: Peer, parameter: str) -> None:
        """Record a volatile write of this client; the server does not report those of other clients."""
        self._in_ram.add((peer.name, parameter.partition("[")[0]))

    def in_ram_only(self, peer: Peer) -> frozenset[str]:
        """Return the parameters of a drive that this client wrote without storing them."""
        return frozenset(parameter for drive, parameter in self._in_ram if drive == peer.name)

    def watched(self, peer: Peer, silence_s: float | None) -> None:
        """Ignore a watchdog, because the server feeds only those of motors that it keeps itself."""

    def wall_time(self) -> float:
        """Return the time in seconds since 1970."""
        return time.time()

    @property
    def real_time(self) -> bool:
        """Whether time passes by itself; always true on a line of a server."""
        return True


def _news(given: Mapping[str, Any], known: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of a drive that differ from those known to the server."""
    news = {name: value for name, value in given.items() if name not in known or known[name] != value}
    return {**news, "model": _found_from_anywhere(news["model"])} if "model" in news else news


def _found_from_anywhere(model: Any) -> str:
    """Return a model as its name, or as an absolute path that is valid in the server's folder, too."""
    if not isinstance(model, str | os.PathLike):
        raise UsageError("a model that was made by a program cannot be sent to a server; give its name or its file")
    text = os.fspath(model)
    return os.path.abspath(text) if text.endswith(".toml") else text  # noqa: PTH100
