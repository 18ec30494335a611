"""One line and its drives, from the master's side."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Self, TypeVar, Unpack

from drivecomm.bus.drives import Broadcast, Drive
from drivecomm.bus.line_options import lists_line_options
from drivecomm.bus.opening import opened_with
from drivecomm.bus.procedures import carry_out
from drivecomm.bus.shared_bus import SharedBus
from drivecomm.errors import OvertakenError
from drivecomm.line import ThreadLine
from drivecomm.protocol import Stop

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterable, Iterator

    from drivecomm.bus.likely_settings import LineChoices
    from drivecomm.bus.line_drives import LineDrives
    from drivecomm.bus.line_options import LineOptions
    from drivecomm.bus.scanning import Found, ScanRequest
    from drivecomm.bus.stopping_all import OnResult, StopResult
    from drivecomm.line import Engine, EngineLine, Job, PollItem, PollResult
    from drivecomm.link import Port
    from drivecomm.protocol import DriveConfig, StopName

T = TypeVar("T")


class Bus(SharedBus[Drive, Broadcast]):
    """The master's side of one line. It runs one exchange at a time, and may be used from many threads.

    open_port: opens the port, now and again after it was lost. roster: the drives and the settings that all of them
    share. on_close: called when the bus has been closed.
    """

    _drive = Drive
    _broadcast = Broadcast
    line: ThreadLine

    def __init__(
        self, open_port: Callable[[], Port], roster: LineDrives, on_close: Callable[[], None] | None = None
    ) -> None:
        super().__init__(roster)
        self.line = ThreadLine(open_port, roster.link, roster.commands, self._was_opened, on_close)
        self.line.opened()

    def scan(
        self,
        only: Iterable[str] | None = None,
        addresses: Iterable[int] | None = None,
        *,
        choices: LineChoices | None = None,
        progress: Callable[[str, int, int], None] | None = None,
        **options: Any,
    ) -> Iterator[Found]:
        """Yield the drives that answer; sends only requests that cannot move a motor.

        Without choices, the scan goes protocol by protocol, at the line settings of each one on this bus. With choices
        it is a wide scan, which tries other line settings, too, beginning with the likely ones of all protocols;
        `LineChoices()` stands for all likely settings. Each probe is sent once. Pass the options of a found drive to
        `Bus.drive`.

        only: protocol names, also with drive options, as in `toy,end=1`; all installed protocols if absent. addresses:
        the addresses to probe, the protocol's usual ones if absent; addresses that a protocol does not have are left
        out. progress: called with the next probe in words, the number of completed probes, and their total number.
        options: line facts for all probed drives.
        """
        from drivecomm.bus.scanning import Found, Search

        search = Search(only, addresses, choices)
        for each in self.questions(search, progress, options):
            if isinstance(each, Found):
                yield search.model_of(each)
            else:
                each.found = self._asked(each)

    def _asked(self, question: ScanRequest) -> Found | None:
        """Carry out a request of a scan, and repeat it while a stop goes first."""
        while True:
            try:
                return self.run(question.job)
            except OvertakenError:
                continue

    def poll(
        self, items: Iterable[PollItem[Drive]], *, duration_s: float | None = None, cycles: int | None = None
    ) -> Generator[PollResult, None, None]:
        """Yield the results of a poll plan for drives on this bus; see `drivecomm.poll`."""
        from drivecomm.line import poll

        return poll(self._on_this_bus(items, "drivecomm.poll"), duration_s=duration_s, cycles=cycles)

    def stop_all(
        self,
        how: Stop | StopName = Stop.RAMP,
        *,
        drives: Iterable[DriveConfig] | None = None,
        on_result: OnResult | None = None,
    ) -> list[StopResult]:
        """Stop all motors of this line, and return the result of each stop; errors are in the results and not raised.

        Broadcasts are sent first, which no drive confirms; then each drive is stopped by itself, silent drives last.
        drives: the drives of this line, as a plant file has them; those that were made with `drive` if absent.
        on_result: called with each result as it comes.
        """
        from drivecomm.bus.stopping_all import stopping_all

        return carry_out(None, stopping_all(self, self._roster.drives if drives is None else drives, how, on_result))

    def run(self, job: Job[T]) -> T:
        """Carry out a job when its turn comes; a lost port is opened again first.

        Raises the errors of the exchange, DeadlineError when the drive's deadline_s passes, CommandCancelledError for a
        command that a stop has cancelled, NotAnsweringError for a drive that is known to be silent.
        """
        return self.line.run(job)

    def on_engine(self, engine: Engine) -> EngineLine | None:
        """Return this bus's line for an engine, which serves many lines in one thread; None if that is impossible."""
        return self.line.on_engine(engine)

    def sleep_until(self, until: float) -> None:
        """Wait until this time on the line's clock; others may use the line meanwhile."""
        self.line.sleep_until(until)

    def lend(self, work: Callable[[Port, Port], T]) -> T:
        """Lend the port, newly opened, to a function; return the function's result.

        work: gets the port, and a proxy of this port that raises LinkDownError as soon as a stop waits for the line.
        Raises PortError if the port cannot be opened.
        """
        return self.line.lend(work)

    def close(self) -> None:
        """Close the port for good; the bus cannot be used any more."""
        self.line.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


@lists_line_options
def open_bus(port: str | Callable[[], Port], **options: Unpack[LineOptions]) -> Bus:
    """Open a line and return its bus, a context manager.

    port: a port name or URL of pyserial ("/dev/ttyUSB0", "COM3", "socket://host:4001", "rfc2217://host:4001",
    "loop://"), Modbus over TCP ("modbus-tcp://host"), or a function that returns a port, such as `VirtualLine.port`.
    options: see `help(drivecomm.LineOptions)`.

    Raises PortError if the port does not exist, is in use, or lacks a requested feature, UsageError for an unknown
    option.
    """
    return Bus(*opened_with(port, options))
