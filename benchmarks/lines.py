"""Emulated lines: starts the emulator, runs a master on its lines, and checks the quality of the run."""

from __future__ import annotations

import json
import subprocess
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Generic, Protocol, Self, TypeVar

from cores import on_emulator_core

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path
    from types import TracebackType

T = TypeVar("T")

MOST_LATE_US = 100.0
"""Limit for the 99 % lateness of the emulator in microseconds; a run beyond it is void."""

MOST_OTHERS = 0.3
"""Limit for the share of a core used by other programs; a run beyond it is void."""


class Master(Protocol):
    """The program that works on the lines."""

    def others_s(self) -> float:
        """Return the processor time in seconds that programs other than the measurement have used so far."""


class MeasurementError(Exception):
    """A measurement failed, and its result is meaningless; the text gives the reason."""


class DisturbedError(MeasurementError):
    """A measurement failed because this machine was too busy with other work."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EmulatedLine:
    """One line and its replies.

    bits: number of bits of one character on the wire. delay_s: range of the delay from the end of a request to its
    reply, evenly spread. whole: deliver replies as a whole after their last character, otherwise character by
    character. answers: reply by request; an empty reply for a telegram without one. deaf_s: time after its reply for
    which the drive ignores requests.
    """

    bits: float
    baudrate: float
    delay_s: tuple[float, float]
    answers: Mapping[bytes, bytes]
    whole: bool = False
    deaf_s: float = 0.0

    def described(self, seed: int) -> str:
        """Return the description of the line for the emulator."""
        low, high = self.delay_s
        rows = [
            f"line {self.bits} {self.baudrate} {low} {high} {seed} {'telegram' if self.whole else 'byte'}",
            f"deaf {self.deaf_s}",
        ]
        rows += [f"answer {request.hex()} {reply.hex() or '-'}" for request, reply in self.answers.items()]
        return "\n".join(rows) + "\n"


class Emulator:
    """A running emulator; a context manager. paths: its lines. report: its observations, after the end."""

    def __init__(self, program: Path, lines: Sequence[EmulatedLine]) -> None:
        self._program = program
        self._lines = lines
        self._process: subprocess.Popen[str] | None = None
        self.paths: list[str] = []
        self.report: dict[str, Any] = {}

    def __enter__(self) -> Self:
        process = subprocess.Popen(
            [*on_emulator_core(), str(self._program)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self._process = process
        if process.stdin is None or process.stdout is None:
            raise MeasurementError("the emulator has no pipes")
        for seed, line in enumerate(self._lines, 1):
            process.stdin.write(line.described(seed))
        process.stdin.write("go\n")
        process.stdin.flush()
        told = process.stdout.readline()
        if not told:
            raise MeasurementError("the line emulator did not start; its reason is on standard error")
        self.paths = json.loads(told)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if self._process is not None:
            told, _ = self._process.communicate(timeout=10)
            if self._process.returncode:
                raise MeasurementError("the line emulator gave up; its reason is on standard error")
            self.report = json.loads(told)


@dataclass(frozen=True, slots=True)
class Run(Generic[T]):
    """Result of the work, report of the emulator, and share of a core that other programs used."""

    result: T
    report: dict[str, Any]
    others: float = 0.0

    @property
    def late_us(self) -> float:
        """The 99 % lateness of deliveries in microseconds."""
        return lateness_us(self.report)

    @property
    def disturbed(self) -> bool:
        """Whether the run was too disturbed to be judged."""
        return self.disturbance > 1

    @property
    def disturbance(self) -> float:
        """Degree of disturbance; above 1 the run is void."""
        return max(self.late_us / MOST_LATE_US, self.others / MOST_OTHERS)

    def check(self) -> None:
        """Raise MeasurementError if the master sent while a reply was due, which no master may do."""
        for number, line in enumerate(self.report["lines"]):
            if line["collisions"]:
                raise MeasurementError(f"the master spoke into a reply on line {number}: {line}")

    def gap_us(self, line: int) -> float:
        """Return the median time in microseconds from the end of a reply to the next request on this line."""
        return float(self.report["lines"][line]["gap_us"].get("p50", float("nan")))


@dataclass(slots=True)
class Instrument:
    """The emulator with the Python master on its lines, and the accuracy of all runs so far.

    tries: maximum number of attempts until a run is undisturbed. spare_s: seconds left for repeating disturbed runs.
    late_us: the median and the 99 % lateness of each run that counts. void: number of discarded runs. doubtful: number
    of runs that stayed disturbed despite repetitions.
    """

    program: Path
    master: Master
    tries: int
    spare_s: float
    late_us: list[tuple[float, float]] = field(default_factory=list)
    void: int = 0
    doubtful: int = 0

    def measure(self, lines: Sequence[EmulatedLine], work: Callable[[list[str]], T]) -> Run[T]:
        """Run some work on emulated lines; repeat it if the run was disturbed.

        If no run is undisturbed, the least disturbed one counts. An error in a disturbed run only makes the run void;
        DisturbedError is raised if that happens every time. An error in an undisturbed run is raised directly.
        """
        best: Run[T] | None = None
        failure: Exception | None = None
        for attempt in range(self.tries):
            if attempt and self.spare_s <= 0:
                break
            began, others = time.monotonic(), self.master.others_s()
            emulator = Emulator(self.program, lines)
            try:
                with emulator:
                    result = work(emulator.paths)
                run = Run(result, emulator.report, self._others(began, others))
                run.check()
            except (MeasurementError, subprocess.CalledProcessError) as error:
                if not Run(None, emulator.report, self._others(began, others)).disturbed:
                    raise
                failure = error
            else:
                if best is None or run.disturbance < best.disturbance:
                    best = run
                if not run.disturbed:
                    break
            self.void += 1
            self.spare_s -= time.monotonic() - began
        if best is None:
            self.doubtful += 1
            raise DisturbedError(f"this machine is too busy for it now ({failure})") from failure
        if best.disturbed:
            self.void -= 1
            self.doubtful += 1
        self.late_us.append((best.report["lateness_us"].get("p50", 0.0), best.late_us))
        return best

    def _others(self, began: float, before_s: float) -> float:
        return (self.master.others_s() - before_s) / (time.monotonic() - began)

    def accuracy(self) -> str:
        """Return the accuracy of the instrument in one line."""
        if not self.late_us:
            return "The line emulator was not used."
        middle = sorted(self.late_us)[len(self.late_us) // 2][0]
        worst = max(p99 for _, p99 in self.late_us)
        typical = sorted(p99 for _, p99 in self.late_us)[len(self.late_us) // 2]
        text = (
            f"Line emulator: {len(self.late_us)} runs; it delivered {middle:.0f} us late in the middle, 99 % at most "
            f"{typical:.0f} us late in the usual run and {worst:.0f} us in the worst one that counts; {self.void} runs "
            f"were disturbed (99 % over {MOST_LATE_US:.0f} us, or others at work for more than {MOST_OTHERS:.0%} of a "
            "core) and repeated"
        )
        return text + (f", {self.doubtful} stayed disturbed." if self.doubtful else ".")


def lateness_us(report: Mapping[str, Any]) -> float:
    """Return the 99 % lateness of a run's deliveries in microseconds."""
    return float(report.get("lateness_us", {}).get("p99", 0.0))


def undisturbed(values: Sequence[float], disturbed: Sequence[bool]) -> list[float]:
    """Return the values of the undisturbed runs, or all values if most runs were disturbed."""
    return [value for value, bad in zip(values, disturbed, strict=True) if mostly(disturbed) or not bad]


def mostly(disturbed: Sequence[bool]) -> bool:
    """Return whether more than half of the runs were disturbed, and with them the median."""
    return 2 * sum(disturbed) > len(disturbed)
