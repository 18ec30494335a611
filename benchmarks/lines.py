"""Emulated lines: start the emulator, let somebody work on its lines, and judge whether the instrument was good."""

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
"""A run whose emulator was later than this with one delivery in a hundred is void."""

MOST_OTHERS = 0.3
"""And one during which other programs took so large a part of one core."""


class Master(Protocol):
    """What is at work on the lines."""

    def others_s(self) -> float:
        """Return the processor time that others than the measurement have taken so far."""


class MeasurementError(Exception):
    """A measurement went wrong, and its result means nothing; the text says why."""


class DisturbedError(MeasurementError):
    """A measurement went wrong because this machine was too busy with other things."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EmulatedLine:
    """One line and what is answered on it.

    bits: of one character, on the wire. delay_s: from the end of a request to its reply, evenly spread between the two.
    whole: replies arrive as a whole when their last character has passed, otherwise character by character. answers:
    request to reply; an empty reply for a telegram that nobody answers. deaf_s: after its reply, the drive does not
    hear what begins sooner.
    """

    bits: float
    baudrate: float
    delay_s: tuple[float, float]
    answers: Mapping[bytes, bytes]
    whole: bool = False
    deaf_s: float = 0.0

    def described(self, seed: int) -> str:
        """Return the line as the emulator reads it."""
        low, high = self.delay_s
        rows = [
            f"line {self.bits} {self.baudrate} {low} {high} {seed} {'telegram' if self.whole else 'byte'}",
            f"deaf {self.deaf_s}",
        ]
        rows += [f"answer {request.hex()} {reply.hex() or '-'}" for request, reply in self.answers.items()]
        return "\n".join(rows) + "\n"


class Emulator:
    """A running emulator, a context manager. paths: its lines. report: after its end, what it saw."""

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
    """What the work returned, what the emulator saw, and what part of a core others took meanwhile."""

    result: T
    report: dict[str, Any]
    others: float = 0.0

    @property
    def late_us(self) -> float:
        """How late 99 of a hundred deliveries were at most."""
        return lateness_us(self.report)

    @property
    def disturbed(self) -> bool:
        """Whether too much else happened for what was measured to be judged."""
        return self.disturbance > 1

    @property
    def disturbance(self) -> float:
        """How much it was disturbed; above one too much."""
        return max(self.late_us / MOST_LATE_US, self.others / MOST_OTHERS)

    def check(self) -> None:
        """Raise MeasurementError when a master spoke while a reply was due: no master may, so something is wrong."""
        for number, line in enumerate(self.report["lines"]):
            if line["collisions"]:
                raise MeasurementError(f"the master spoke into a reply on line {number}: {line}")

    def gap_us(self, line: int) -> float:
        """The median from the end of a reply to the beginning of the next request on this line."""
        return float(self.report["lines"][line]["gap_us"].get("p50", float("nan")))


@dataclass(slots=True)
class Instrument:
    """The emulator with the Python master at work on its lines, and how good they were so far.

    tries: how often a run is made at most until it is quiet. spare_s: how many seconds may still be spent on repeating
    what was disturbed. late_us: the median and the 99 % lateness of each run that counts. void: runs thrown away.
    doubtful: runs that stayed disturbed however often they were repeated.
    """

    program: Path
    master: Master
    tries: int
    spare_s: float
    late_us: list[tuple[float, float]] = field(default_factory=list)
    void: int = 0
    doubtful: int = 0

    def measure(self, lines: Sequence[EmulatedLine], work: Callable[[list[str]], T]) -> Run[T]:
        """Let somebody work on emulated lines; repeat when the emulator was disturbed.

        The least disturbed of some runs counts when none was quiet. What goes wrong in a disturbed run only makes it
        void, and DisturbedError is raised when it does so every time; in a quiet run it is raised as it is.
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
        """Return how good the instrument was, in one line."""
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
    """Return how late 99 of a hundred deliveries of a run were at most."""
    return float(report.get("lateness_us", {}).get("p99", 0.0))


def undisturbed(values: Sequence[float], disturbed: Sequence[bool]) -> list[float]:
    """Return the values of the undisturbed runs; all of them when most were disturbed."""
    return [value for value, bad in zip(values, disturbed, strict=True) if mostly(disturbed) or not bad]


def mostly(disturbed: Sequence[bool]) -> bool:
    """Return whether so many runs were disturbed that their median is, too."""
    return 2 * sum(disturbed) > len(disturbed)
