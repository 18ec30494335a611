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
    from drivecomm.bus.line_options import LineOptions
    from drivecomm.bus.roster import Roster
    from drivecomm.bus.scanning import Found, Question
    from drivecomm.bus.stopping_all import OnResult, StopResult
    from drivecomm.line import Engine, EngineLine, Job, PollItem, PollResult
    from drivecomm.link import Port
    from drivecomm.protocol import DriveConfig, StopName

T = TypeVar("T")


class Bus(SharedBus[Drive, Broadcast]):
    """The master's side of one line. Runs one exchange at a time, whoever asks; may be used from many threads.

    open_port: opens the port, at once and again after it was lost. roster: the drives and what holds for all of them.
    on_close: called when the bus has been closed.
    """

    _drive = Drive
    _broadcast = Broadcast
    line: ThreadLine

    def __init__(
        self, open_port: Callable[[], Port], roster: Roster, on_close: Callable[[], None] | None = None
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
        """Yield the drives that answer; sends only what cannot move a motor.

        Without choices it goes protocol by protocol, at the settings that each one has on this bus. With them it is a
        wide scan, which tries other line settings, too, the likely ones of all protocols first; `LineChoices()` is all
        that are likely. Whether somebody is there is asked once. Give `Bus.drive` the options of what was found.

        only: protocol names, also with drive options, as in `toy,end=1`; all installed ones if absent. addresses: those
        to ask, the protocol's usual ones if absent; addresses that a protocol does not have are left out. progress:
        told what is asked, how many questions are done, and how many there are. options: line facts for all drives
        asked.
        """
        from drivecomm.bus.scanning import Found, Search

        search = Search(only, addresses, choices)
        for each in self.questions(search, progress, options):
            if isinstance(each, Found):
                yield search.model_of(each)
            else:
                each.found = self._asked(each)

    def _asked(self, question: Question) -> Found | None:
        """Ask until no stop goes first."""
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
        """Stop all motors of this line, and return what came of each stop; nothing is raised for a drive or the line.

        By broadcasts first, which nobody confirms, then each drive by itself; those that are silent last. drives: those
        of this line, as a plant file has them; those that were made with `drive` if absent. on_result: called with each
        outcome as it comes.
        """
        from drivecomm.bus.stopping_all import stopping_all

        return carry_out(None, stopping_all(self, self._roster.drives if drives is None else drives, how, on_result))

    def run(self, job: Job[T]) -> T:
        """Carry out a job when it is its turn; a port that was lost is opened again first.

        Raises what the exchange raises, DeadlineError when the drive's deadline_s passes, CommandCancelledError for a
        command that a stop has cancelled, NotAnsweringError for a drive that is known not to answer.
        """
        return self.line.run(job)

    def on_engine(self, engine: Engine) -> EngineLine | None:
        """Return this bus's line for an engine, which serves many in one thread; None where that cannot be."""
        return self.line.on_engine(engine)

    def sleep_until(self, until: float) -> None:
        """Let time pass on the line's clock; others may use the line meanwhile."""
        self.line.sleep_until(until)

    def lend(self, work: Callable[[Port, Port], T]) -> T:
        """Let a function have the port for itself, opened anew for it; return what it returns.

        work: is given the port, and the same port as one that fails with LinkDownError as soon as a stop waits for the
        line. Raises PortError when it cannot be opened.
        """
        return self.line.lend(work)

    def close(self) -> None:
        """Give the port back; the bus cannot be used any more."""
        self.line.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


@lists_line_options
def open_bus(port: str | Callable[[], Port], **options: Unpack[LineOptions]) -> Bus:
    """Open a line and return its bus, a context manager.

    port: what pyserial opens ("/dev/ttyUSB0", "COM3", "socket://host:4001", "rfc2217://host:4001", "loop://"), Modbus
    over TCP ("modbus-tcp://host"), or a function that returns a port, such as `VirtualLine.port`. options: see
    `help(drivecomm.LineOptions)`.

    Raises PortError when the port does not exist, is in use, or has not what was asked for, UsageError for an unknown
    option.
    """
    return Bus(*opened_with(port, options))
