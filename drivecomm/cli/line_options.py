"""Common options of all commands on a line, and the ports, buses and drives that they open."""

from __future__ import annotations

from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from drivecomm import bus as buses
from drivecomm.cli.drive_names import known_plant
from drivecomm.cli.output import labels, sentence, show_trace
from drivecomm.cli.stops_from_others import StopsFromOthers
from drivecomm.client import server_of_port
from drivecomm.errors import (
    DriveCommError,
    FileFormatError,
    PortError,
    ProtocolLoadError,
    UnknownProtocolError,
    UsageError,
)
from drivecomm.link import Echo, combine_traces
from drivecomm.protocol import installed, parse_drive, parse_options, unknown_protocol
from drivecomm.transport import same_port

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping
    from pathlib import Path

    from drivecomm.bus import BlockingLine, Bus, Drive
    from drivecomm.client import Registration, ServedBus
    from drivecomm.link import Port, TraceEvent
    from drivecomm.plant import Plant, PlantLine
    from drivecomm.protocol import DriveConfig, LinkLossPolicy

_COMMANDS_NOTHING = {"arm": "does not command a drive"}
_OPENS_NOTHING = "opens no port"
_RECORDS_NOTHING = "uses the port itself and does not record"

WITHOUT_EFFECT: Mapping[str, Mapping[str, str]] = {
    **dict.fromkeys(
        ("read", "status", "wait", "scan", "doctor", "stats", "poll", "backup", "compare", "accept", "grow"),
        _COMMANDS_NOTHING,
    ),
    "drift": {**_COMMANDS_NOTHING, "record": "opens a line once for each of its drives"},
    "forecast": {
        **_COMMANDS_NOTHING,
        **dict.fromkeys(("echo", "rs485", "low_latency", "trace", "record"), _OPENS_NOTHING),
    },
    "doctor": {**_COMMANDS_NOTHING, "record": _RECORDS_NOTHING},
    "tune": {**_COMMANDS_NOTHING, "attempts": "counts each request that fails"},
    "replay": {
        **dict.fromkeys(("attempts", "trace"), "sends each telegram of the file once"),
        "record": _RECORDS_NOTHING,
    },
}
"""Line options without effect on a command, by command and option, with the reason; the command refuses them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LineArguments:
    """Port, line settings and output of one call; absent settings are the protocol's own."""

    port: str | None = None
    baudrate: int | None = None
    bytesize: int | None = None
    parity: str | None = None
    stopbits: float | None = None
    timeout: float | None = None
    attempts: int | None = None
    echo: Echo = "off"
    rs485: bool = False
    low_latency: bool | None = None
    trace: bool = False
    record: Path | None = None
    plant: Path | None = None
    arm: bool = False
    json: bool = False
    given: frozenset[str] = frozenset()
    """Options that were written on the command line; the others have defaults or come from the environment."""

    stops: StopsFromOthers = field(default_factory=StopsFromOthers, compare=False, repr=False)
    """Handler of stops from other programs while a port is open here."""

    def reaching(self, text: str) -> tuple[LineArguments, DriveConfig]:
        """Return the line of a drive and the drive, which is named as PROTOCOL:ADDRESS or by its name in the plant.

        All options of a drive are combined here. `Bus.drive` adds the defaults of protocol and model. The plant's line
        overrides them, the plant's drive overrides its line, and the command line, by a flag or after the drive's name,
        overrides everything, because the user knows better than a file. Drives of a plant are read-only unless it arms
        them, or --arm is given. Raises UsageError.
        """
        place = _placed(text, self)
        if place is None:
            if self.arm:
                raise UsageError(
                    f"{text} is not in a plant that keeps it read-only, so --arm has no effect; leave it out"
                )
            drive = parse_drive(text)
            if drive.protocol not in installed:
                # A mistyped protocol is reported before a missing port.
                raise unknown_protocol(drive.protocol, installed)
            return self, replace(drive, options=self._over({}, drive.options), line=self.named_port)
        plant, drive, behind = place
        return self._reaching(plant, drive, behind)

    def reaching_each(self, texts: Iterable[str]) -> list[tuple[LineArguments, DriveConfig]]:
        """Return the line and the drive of each name, as `reaching` does, without duplicates.

        A group stands for its drives. Options after the name of a group apply to each of its drives. Raises UsageError.
        """
        known = known_plant(self.plant, port_given=False)
        groups = known.groups if known else {}
        found: dict[tuple[str, str], tuple[LineArguments, DriveConfig]] = {}
        for text in texts:
            word, *behind = text.split(",")
            if known is not None and word in groups:
                several = [self.reaching_in(known, drive, behind) for drive in groups[word]]
            else:
                several = [self.reaching(text)]
            for reached, drive in several:
                found.setdefault((drive.line, str(drive)), (reached, drive))
        return list(found.values())

    def reaching_in(self, plant: Plant, drive: DriveConfig, behind: Iterable[str]) -> tuple[LineArguments, DriveConfig]:
        """Return the line of a drive of this plant, and the drive, as `reaching` does.

        behind: options as written after its name. Raises UsageError.
        """
        return self._reaching(plant, _permitted(plant, drive, self), parse_options(behind))

    def _reaching(
        self, plant: Plant, drive: DriveConfig, behind: Mapping[str, Any]
    ) -> tuple[LineArguments, DriveConfig]:
        return self.on(plant.line(drive.line), plant.file), replace(drive, options=self._over(drive.options, behind))

    def on(self, line: PlantLine, file: str) -> LineArguments:
        """Return the options for a line of the plant, which fills in options missing on the command line."""
        echo: Echo = "expect" if line.echo and "echo" not in self.given else self.echo
        settings = {key: value for key, value in line.settings.items() if getattr(self, key) is None}
        return replace(self, port=self.port_of(line, file), echo=echo, given=self.given | {"port"}, **settings)

    def _over(self, options: Mapping[str, Any], behind: Mapping[str, Any]) -> dict[str, Any]:
        """Return a drive's options, overridden by those of the command line."""
        for key in behind:
            if self.said_facts.get(key, behind[key]) != behind[key]:
                raise UsageError(
                    f"{key}={behind[key]} behind the drive and {self.said_facts[key]} by its flag exclude each other; "
                    "leave one of them out"
                )
        return {**options, **self.said_facts, **behind}

    def refuse(self, why: str, *names: str) -> None:
        """Raise UsageError if one of these options is written on the command line, where it has no effect."""
        for name in names or tuple(each.name for each in fields(self) if each.name != "json"):
            if name in self.given:
                raise UsageError(f"{why}, so --{name.replace('_', '-')} has no effect; leave it out")

    def must_be_armed(self) -> None:
        """Raise UsageError if the plant has a read-only drive at this port and --arm is not given.

        For commands that act on any drive of a line.
        """
        known = known_plant(self.plant, port_given=False)
        for drive in known.drives if known else ():
            there = known is not None and same_port(known.line(drive.line).reached_at, self.named_port)
            if known is not None and there and not drive.armed and not self.arm:
                raise UsageError(f"{drive.why_read_only(known.file)}, or give --arm for this command")

    def link_loss_of(self, text: str) -> LinkLossPolicy | None:
        """Return the plant's link loss policy of a drive, None if there is none."""
        place = _placed(text, self)
        return place[1].link_loss if place else None

    def in_plant(self, text: str) -> tuple[str, int] | None:
        """Return the plant file of a drive and its position in the file, from 0; None for a drive without plant."""
        place = _placed(text, self)
        return (place[0].file, [each.name for each in place[0].drives].index(place[1].name)) if place else None

    def port_of(self, line: PlantLine, file: str) -> str:
        """Return the port of a line of the plant, or else the given port. Raises UsageError without a port."""
        port = line.reached_at or self.port
        if not port:
            raise UsageError(f'{file}: line {line.name} has no port; write port = "/dev/ttyUSB0" there, or give --port')
        return port

    def at(self, port: str) -> LineArguments:
        """Return the options for another port; with an echo if the plant states one for its line."""
        known = known_plant(self.plant, port_given="port" in self.given)
        lines = known.lines if known else ()
        echoes = "echo" not in self.given and any(line.echo for line in lines if line.reached_at == port)
        return replace(self, port=port, echo="expect" if echoes else self.echo, given=self.given | {"port"})

    @contextmanager
    def bus(self, listener: Callable[[TraceEvent], None] | None = None) -> Iterator[BlockingLine]:
        """Open the bus for the time of the block; errors then name the port. listener: called with trace events, too.

        If a server has the port, the bus uses the server. Otherwise stops of other programs reach the bus.
        """
        opening = {**self.opening, "trace": combine_traces(self.shown_trace, listener)}
        with self._recorded(), self.named_in_errors():
            if (found := self.server) is not None:
                with self._served_bus(found, opening) as served:
                    yield served
                return
            with buses.open_bus(self.named_port, **opening) as bus, self.stops.over(self.named_port, bus):
                yield bus

    @contextmanager
    def own_bus(self) -> Iterator[Bus]:
        """Open the bus as `bus` does, always with the port itself, even if a server has it."""
        with self._recorded(), self.named_in_errors(), buses.open_bus(self.named_port, **self.opening) as bus:
            yield bus

    @contextmanager
    def drive(self, text: str, model: str | None = None) -> Iterator[tuple[Drive, DriveConfig]]:
        """Open the line of a drive and yield the drive and its configuration; errors in the block name both."""
        reached, name = self.reaching(text)
        with reached.drive_at(name, model) as drive:
            yield drive, name

    @contextmanager
    def drive_at(self, name: DriveConfig, model: str | None = None) -> Iterator[Drive]:
        """Yield a drive of this line; see `drive`."""
        with self.bus() as bus, naming(name):
            yield name.with_options(**({"model": model} if model else {})).build(bus.drive)

    @property
    def server(self) -> tuple[Registration, str] | None:
        """Server that has the port, and its name of the line; None if no server has it."""
        found = server_of_port(self.named_port)
        if found is not None:
            self.refuse(f"{found[0]} has {self.named_port} open already", "echo", "rs485", "low_latency")
        return found

    def must_be_free(self, what: str) -> None:
        """Raise PortError if a server has the port. what: name of the feature that needs the port for itself."""
        if (found := server_of_port(self.named_port)) is not None:
            raise PortError(
                f"port {self.named_port} is in use by {found[0]}, and {what} needs it alone; stop that server first"
            )

    def _served_bus(self, found: tuple[Registration, str], opening: Mapping[str, Any]) -> ServedBus:
        # Imported late, because only calls through a server need it.
        from drivecomm.client import ServedBus
        from drivecomm.plant import drives_of

        return ServedBus(*found, drives_of(*found), **opening)

    @contextmanager
    def opened(self) -> Iterator[Port]:
        """Open the bare port during the block; a stop of another program ends the block. Errors name the port."""
        with self.named_in_errors(), ExitStack() as stack:
            port = buses.port_opener(self.named_port, rs485=self.rs485, low_latency=self.low_latency)()
            if port.real_time:
                stack.enter_context(self.stops.make_way(self.named_port))
            stack.callback(port.close)
            yield port

    @property
    def named_port(self) -> str:
        """The given port, or the port of the plant's only line. Raises UsageError if there is none."""
        # A plant on the command line overrides the port of the environment.
        if self.port is not None and ("plant" not in self.given or "port" in self.given):
            return self.port
        known = known_plant(self.plant, port_given=False)
        if known is None:
            raise UsageError("no port: give --port, or set DRIVECOMM_PORT")
        if len(known.lines) > 1:
            ports = ", ".join(f"{line.reached_at or 'no port'} ({line.name})" for line in known.lines)
            raise UsageError(f"no port: give --port; {known.file} has {ports}")
        return self.port_of(known.lines[0], known.file)

    @property
    def facts(self) -> dict[str, Any]:
        """Line facts for all drives, as keywords of `open_bus`; None for those that are not given."""
        return {
            "baudrate": self.baudrate,
            "bytesize": self.bytesize,
            "parity": self.parity.upper() if self.parity else None,
            "stopbits": self.stopbits,
            "reply_timeout_s": self.timeout,
            "attempts": self.attempts,
        }

    @property
    def said_facts(self) -> dict[str, Any]:
        """Line facts given on the command line."""
        return {name: value for name, value in self.facts.items() if value is not None}

    @property
    def shown_trace(self) -> Callable[[TraceEvent], None] | None:
        """Printer of trace events, None unless --trace is given."""
        return partial(show_trace, as_json=self.json) if self.trace else None

    def _recorded(self) -> AbstractContextManager[None]:
        if self.record is None:
            return nullcontext()
        # Imported late, because only recording needs it.
        from drivecomm.cli.value_files import recorded

        return recorded(self.record, as_json=self.json)

    @contextmanager
    def named_in_errors(self) -> Iterator[None]:
        """Add the port to errors raised in the block."""
        where = self.named_port
        try:
            yield
        except (FileFormatError, UnknownProtocolError, ProtocolLoadError):
            # The error names its file or protocol, and the port is not the cause.
            raise
        except DriveCommError as error:
            error.args = (sentence(str(error), where=where), *error.args[1:])
            raise

    @property
    def opening(self) -> dict[str, Any]:
        """All keywords of `open_bus`."""
        return {
            "echo": self.echo,
            "rs485": self.rs485,
            "low_latency": self.low_latency,
            "trace": self.shown_trace,
            "record": self.record,
            **self.facts,
        }


@contextmanager
def naming(name: DriveConfig) -> Iterator[None]:
    """Add the drive's name in the plant to errors raised in the block."""
    try:
        yield
    except DriveCommError as error:
        error.about = labels(name)
        if name.name not in str(error):
            error.args = (f"{name.name}: {error}", *error.args[1:])
        raise


def _placed(text: str, asked: LineArguments) -> tuple[Plant, DriveConfig, dict[str, Any]] | None:
    """Return the plant, its drive, and the options after its name; None for PROTOCOL:ADDRESS without a plant.

    With a port, PROTOCOL:ADDRESS is the plant's drive if the plant has it at that port, so that the plant's settings of
    a drive apply under any name. Raises UsageError for an unknown name, and for a drive at another port.
    """
    word, *settings = text.split(",")
    known = known_plant(asked.plant, port_given=False)
    if known is None:
        if ":" in word:
            return None
        raise UsageError(
            f"{word!r} is not a drive; write PROTOCOL:ADDRESS, such as vabus:1, or a name in a plant file "
            "(--plant plant.toml)"
        )
    drive = _addressed(word, known, asked) if ":" in word else known.drive(word)
    return None if drive is None else (known, _permitted(known, drive, asked), parse_options(settings))


def _permitted(known: Plant, drive: DriveConfig, asked: LineArguments) -> DriveConfig:
    """Return a drive of the plant, read-only unless it is armed. Raises UsageError if it is not at the given port."""
    line = known.line(drive.line)
    if "port" in asked.given and asked.port and line.reached_at and not same_port(line.reached_at, asked.port):
        raise UsageError(
            f"{known.file}: {drive.name} is on line {line.name}, at {line.reached_at}; leave --port {asked.port} out, "
            f"or name a drive as PROTOCOL:ADDRESS there"
        )
    reason = drive.why_read_only(known.file)
    if asked.arm and not reason:
        raise UsageError(f"{drive.name} is armed in {known.file}, so --arm has no effect; leave it out")
    if reason and not asked.arm:
        return replace(drive, read_only_reason=f"{reason}, or give --arm for this command")
    return drive


def _addressed(word: str, known: Plant, asked: LineArguments) -> DriveConfig | None:
    same = [drive for drive in known.drives if str(drive) == word]
    if asked.port is not None and ("port" in asked.given or asked.plant is None):
        port = asked.port
        lines = {line.name for line in known.lines if not line.reached_at or same_port(line.reached_at, port)}
        here = [drive for drive in same if drive.line in lines]
        if asked.plant is None or here:
            return min(here, key=lambda drive: drive.armed, default=None)
    if not same and asked.plant is None:
        return None
    return known.drive(word)
