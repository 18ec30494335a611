"""Command `sniff`: show the traffic of a line or a capture."""

from __future__ import annotations

from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from functools import partial
from typing import TYPE_CHECKING

import click

from drivecomm.capture import CaptureWriter, Provenance, open_capture
from drivecomm.cli import options
from drivecomm.cli.commands import CliCommand
from drivecomm.cli.drive_names import known_plant
from drivecomm.cli.line_command import LineSetting
from drivecomm.cli.output import complain, note, tell
from drivecomm.cli.output_files import force_option, must_be_free
from drivecomm.cli.sniff.lines import LiveTable, emit_event, emit_summary, print_summary, say_event
from drivecomm.cli.sniff.naming import Naming
from drivecomm.cli.sniff.sources import DetectionListener, is_file, pieces_from
from drivecomm.cli.stops_from_others import StopsFromOthers
from drivecomm.cli.values import FILE, NUMBER, WHOLE_NUMBER
from drivecomm.client import server_of_port
from drivecomm.errors import FileFormatError, LinkError, UsageError
from drivecomm.protocol import LineSettings, installed, parse_drive
from drivecomm.traffic.sniffer import LineMonitor, detect, protocols_for, recorded_with
from drivecomm.transport import listening_port, same_port, shared_listening_port
from drivecomm.version import __version__

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping
    from pathlib import Path

    from drivecomm.capture import Piece
    from drivecomm.cli.sniff.naming import Meaning
    from drivecomm.link import Statistics
    from drivecomm.protocol import DriveConfig, Protocol
    from drivecomm.traffic.sniffer import Detected, LineEvent
    from drivecomm.transport import ListeningPort

_LINE = "Line"
_NOTHING_HEARD = 1


@click.command(cls=CliCommand)
@click.argument("place", metavar="PORT|FILE", help="A port, socket://HOST:PORT, or a capture (.jsonl, .pcapng).")
@click.option(
    "--drive",
    "drives",
    metavar="DRIVE",
    multiple=True,
    help="A drive to expect, such as vabus:1,model=agile; repeatable.",
)
@click.option(
    "--protocol",
    "protocols",
    metavar="PROTOCOL",
    shell_complete=options.complete_protocol,
    multiple=True,
    help="Look for this protocol only; repeatable. Default: all.",
)
@click.option("--names", is_flag=True, help="Assume the protocol's usual model for other drives, to name parameters.")
@click.option("--only", metavar="DRIVE", multiple=True, help="Show this drive or protocol only; repeatable.")
@click.option("--errors", is_flag=True, help="Show only errors.")
@click.option("--table", is_flag=True, help="Show a table of the drives instead of telegrams.")
@click.option("--write", type=FILE, help="Record to a capture file.")
@force_option
@click.option("--detect", "find", is_flag=True, help="Find baud rate, parity and protocol first, by listening.")
@click.option(
    "--shared", is_flag=True, help="Listen at a port that another program has open; each gets half the bytes."
)
@click.option("--for", "seconds", type=NUMBER, metavar="SECONDS", help="Stop after this time.")
@click.option("--baudrate", cls=LineSetting, type=WHOLE_NUMBER, help="Bits per second.")
@click.option("--bytesize", cls=LineSetting, type=WHOLE_NUMBER, help="Data bits, 7 or 8.")
@click.option("--parity", metavar="LETTER", cls=LineSetting, help="N, E, O, M or S.")
@click.option("--stopbits", cls=LineSetting, type=NUMBER, help="1, 1.5 or 2.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object per line.")
def sniff(
    *,
    place: str,
    drives: tuple[str, ...],
    protocols: tuple[str, ...],
    names: bool,
    only: tuple[str, ...],
    errors: bool,
    table: bool,
    write: Path | None,
    force: bool,
    find: bool,
    shared: bool,
    seconds: float | None,
    baudrate: int | None,
    bytesize: int | None,
    parity: str | None,
    stopbits: float | None,
    as_json: bool,
) -> int:
    """Listen to a line without ever sending, or read a capture; Ctrl-C ends with a summary.

    The port is opened exclusively unless --shared is given. Exit code 1 when nothing was heard.
    """
    if table and as_json:
        raise UsageError("--table and --json exclude each other; choose one")
    if write is not None and write.exists() and is_file(place) and write.samefile(place):
        raise UsageError(f"{write}: is the capture that is read; write to another file")
    must_be_free(write, "--write", force=force)
    recorded, planned = _expected(place)
    # Drives named in a recording have no model, so their parameters have no names.
    naming = Naming([parse_drive(text) for text in drives] or planned, everybody=names)
    given = {"baudrate": baudrate, "bytesize": bytesize, "parity": parity and parity.upper(), "stopbits": stopbits}
    naming.check()
    named = [installed[name] for name in dict.fromkeys(protocols)]
    job = SniffRun(
        protocols=named or protocols_for([*(naming.drives if drives else recorded), *naming.drives]),
        naming=naming,
        given={name: value for name, value in given.items() if value is not None},
        chosen=frozenset(only),
        errors_only=errors,
    )
    output = _output(job, table=table, as_json=as_json)
    if is_file(place):
        if find or shared or seconds is not None:
            raise UsageError(
                "--detect, --shared and --for are for ports; a capture holds what was heard with its settings"
            )
        job.read(place, write, output)
        return 0
    open_port: Callable[[str, LineSettings], ListeningPort] = shared_listening_port if shared else listening_port
    making_way: AbstractContextManager[None] = nullcontext()
    if not shared:
        making_way = StopsFromOthers("drivecomm sniff").make_way(place)
    if (found := server_of_port(place)) is not None:
        if find or shared:
            raise UsageError(
                f"{place} is the port of {found[0]}, which reports the traffic itself; leave --detect and --shared out"
            )
        # Imported late, because only a port of a server needs it.
        from drivecomm.client import LineEar

        open_port, making_way = (lambda *_: LineEar(*found)), nullcontext()
    with making_way:
        heard = job.listen(
            place,
            write,
            output,
            open_port=open_port,
            told=partial(_tell_detected, as_json=as_json) if find else None,
            seconds=seconds,
        )
    if heard:
        return 0
    served = ", that its server has no other client" if "://" in place else ""
    complain(
        f"{place}: nothing was heard; check that there is traffic on this line{served}, and its wiring", as_json=as_json
    )
    return _NOTHING_HEARD


def _expected(place: str) -> tuple[list[DriveConfig], list[DriveConfig]]:
    """Return the drives that a recording names, and the plant's drives on the line of this port.

    For a recording, the second list has only drives that the recording names.
    """
    port, recorded = place, []
    if is_file(place):
        with open_capture(place) as capture:
            port, recorded = capture.provenance.port, recorded_with(capture.provenance)
    try:
        plant = known_plant(None, port_given=False)
    except FileFormatError as error:
        # Listening does not need a plant.
        note(str(error))
        plant = None
    if plant is None:
        return recorded, []
    lines = {each.name for each in plant.lines if same_port(each.reached_at, port)}
    planned = [each for each in plant.drives if each.line in lines]
    if is_file(place):
        planned = [each for each in planned if str(each) in {str(one) for one in recorded}]
    return recorded, planned


@dataclass(frozen=True, slots=True, kw_only=True)
class Output:
    """Output functions of a call: for each event, and at the beginning and the end."""

    show: Callable[[LineEvent, Meaning], None]
    end: Callable[[], None]
    begin: Callable[[], None] = lambda: None


@dataclass(slots=True, kw_only=True)
class SniffRun:
    """One call of the command."""

    protocols: list[Protocol]
    naming: Naming
    given: dict[str, object]
    chosen: frozenset[str]
    errors_only: bool
    _watches: dict[str, LineMonitor] = field(default_factory=dict)
    _heard: bool = False

    def counted(self) -> Mapping[str, Mapping[str, Statistics]]:
        """Return the statistics so far, by line."""
        return {name: watch.statistics for name, watch in list(self._watches.items())}

    def read(self, place: str, write: Path | None, output: Output) -> None:
        """Show the contents of a capture."""
        with open_capture(place) as capture:
            about = capture.provenance
            settings = self._settings(None) if self.given or about.settings is None else None
            pieces = capture if settings is None else (replace(piece, settings=settings) for piece in capture)
            self._show(pieces, settings or about.settings, write, about, output)
            for remark in capture.remarks:
                note(remark)

    def listen(
        self,
        place: str,
        write: Path | None,
        output: Output,
        *,
        open_port: Callable[[str, LineSettings], ListeningPort],
        told: Callable[[str, Detected], None] | None,
        seconds: float | None,
    ) -> bool:
        """Show the traffic at a port; return whether there was any.

        told: called with the line settings detected by listening; None to detect nothing.
        """
        settings = self._settings(self.naming.settings)
        with closing(open_port(place, settings)) as port:
            if told is not None:
                settings = _found_settings(place, port, self.protocols, told)
            remark = port.configure(settings)
            where = f"listening at {place}" + (f" ({remark})" if remark else f" with {settings}")
            note(f"{where}; stop with Ctrl-C")
            provenance = Provenance(
                began=datetime.now(UTC), tool=f"drivecomm {__version__}", port=place, settings=settings
            )
            self._show(pieces_from(port, settings, seconds), settings, write, provenance, output)
        return self._heard

    def _settings(self, of_drives: LineSettings | None) -> LineSettings:
        facts = self.protocols[0].facts if len(self.protocols) == 1 else None
        known = of_drives or (facts.settings if facts else LineSettings())
        return replace(known, **self.given)  # type: ignore[arg-type]

    def _show(
        self,
        pieces: Iterable[Piece],
        settings: LineSettings | None,
        write: Path | None,
        provenance: Provenance,
        output: Output,
    ) -> None:
        output.begin()
        try:
            with CaptureWriter(write, provenance) if write else nullcontext() as writer:
                for event in self._events(pieces, settings, writer):
                    if self._is_wanted(event):
                        output.show(event, self.naming.meaning(event))
        except KeyboardInterrupt:
            # Ctrl-C is the normal end.
            pass
        finally:
            output.end()

    def _events(
        self, pieces: Iterable[Piece], settings: LineSettings | None, writer: CaptureWriter | None
    ) -> Iterator[LineEvent]:
        try:
            for piece in pieces:
                if writer is not None:
                    writer.add(piece)
                self._heard = self._heard or bool(piece.data)
                if (name := piece.line) not in self._watches:
                    options = self.naming.options
                    self._watches[name] = LineMonitor(self.protocols, name=name, settings=settings, options=options)
                watch = self._watches[name]
                yield from watch.feed(piece) if piece.data else watch.flush(piece.time_s)
        finally:
            # After Ctrl-C or the loss of the port, pending telegrams still count.
            left = [event for watch in self._watches.values() for event in watch.finish()]
        yield from left

    def _is_wanted(self, event: LineEvent) -> bool:
        if self.errors_only and not event.wrong:
            return False
        return not self.chosen or event.drive in self.chosen or event.drive.partition(":")[0] in self.chosen


def _output(job: SniffRun, *, table: bool, as_json: bool) -> Output:
    if table:
        live = LiveTable(job.counted)
        return Output(begin=live.start, show=live.show, end=live.stop)
    if as_json:
        return Output(show=emit_event, end=lambda: emit_summary(job.counted()))
    return Output(show=say_event, end=lambda: print_summary(job.counted()))


def _tell_detected(place: str, found: Detected, *, as_json: bool) -> None:
    text = (
        f"{place}: {found.settings}, {', '.join(found.protocols)}; {found.telegrams} telegrams, "
        f"{found.understood:.0%} of the characters understood, {found.spoilt:.0%} with a wrong parity or stop bit"
    )
    tell(text, as_json=as_json, what="detected", port=place, **asdict(found))


def _found_settings(
    place: str, port: ListeningPort, protocols: list[Protocol], told: Callable[[str, Detected], None]
) -> LineSettings:
    if note := port.configure(LineSettings()):
        raise UsageError(f"{place}: there is nothing to detect ({note}); leave --detect out")
    found = detect(DetectionListener(port), protocols)
    if found is None:
        raise LinkError(
            f"{place}: nothing could be decoded with the usual line settings; check that there is traffic on this line"
        )
    told(place, found)
    return found.settings
