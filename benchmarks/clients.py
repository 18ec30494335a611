"""Masters on a line: the framework, comparable libraries, and the bare C client; each in a separate process."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from compiling import CannotMeasureError
from cores import on_client_core, others_s
from lines import MeasurementError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from types import TracebackType

    from conversation import Conversation


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """Task of a Python master.

    way: bare Python, bare selectors, blocking, threads, asyncio, poll plan, scan, or a peer. paths: its lines. seconds:
    how long it repeats the read of one parameter on all of them. neighbour: run a second thread that only computes.
    switch_interval_s: thread switch interval, None for Python's own. spoken: telegrams for bare Python, which knows no
    protocol.
    """

    way: str
    paths: Sequence[str]
    baudrate: int
    seconds: float
    protocol: str = ""
    parameter: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)
    neighbour: bool = False
    switch_interval_s: float | None = None
    spoken: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Ran:
    """Results of a master: exchanges and seconds on each line, and its processor time."""

    lines: tuple[tuple[int, float], ...]
    processor_s: float

    @property
    def exchanges(self) -> int:
        """Number of exchanges on all lines."""
        return sum(count for count, _ in self.lines)

    @property
    def rates(self) -> list[float]:
        """Exchanges per second on each line."""
        return [count / seconds if count else 0.0 for count, seconds in self.lines]

    @property
    def processor_us(self) -> float:
        """Processor time of one exchange in microseconds."""
        return self.processor_s / self.exchanges * 1e6


class MasterBrokenError(Exception):
    """A master stopped with an error that no line can cause."""


class PythonMaster:
    """Python process that does jobs in turn; a context manager."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[str] | None = None

    def __enter__(self) -> Self:
        script = Path(__file__).with_name("client_process.py")
        self._process = subprocess.Popen(
            [*on_client_core(), sys.executable, str(script)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if self._process is not None:
            self._process.communicate(timeout=10)

    def others_s(self) -> float:
        """Return the processor time in seconds that other programs have used so far."""
        return others_s(self._process.pid if self._process is not None else os.getpid())

    def work(self, job: Job) -> Ran:
        """Do a job. Raises CannotMeasureError if a requirement is not installed or not yet available.

        Raises MeasurementError if a reply is missing, and MasterBrokenError if the program has a fault.
        """
        process = self._process
        if process is None or process.stdin is None or process.stdout is None:
            raise MeasurementError("the master has no pipes")
        process.stdin.write(json.dumps(asdict(job)) + "\n")
        process.stdin.flush()
        told = process.stdout.readline()
        if not told:
            raise MeasurementError(f"the master ended; it had to do {job}")
        answer = json.loads(told)
        for how, kind in (("failed", MeasurementError), ("broken", MasterBrokenError)):
            if how in answer:
                raise kind(f"{job.way} on {len(job.paths)} lines: {answer[how]}")
        if "missing" in answer:
            raise CannotMeasureError(answer["missing"])
        return _ran(answer)


def reading(way: str, conversation: Conversation, paths: Sequence[str], seconds: float, **more: Any) -> Job:
    """Return the job of repeating this exchange on these lines."""
    return Job(
        way=way,
        paths=paths,
        baudrate=conversation.baudrate,
        seconds=seconds,
        protocol=conversation.protocol,
        parameter=conversation.parameter,
        options=conversation.options,
        spoken={
            "request": conversation.request.hex(),
            "reply": conversation.reply.hex(),
            "closing": conversation.closing.hex(),
            "pause_s": conversation.pause_s,
        },
        **more,
    )


def run_reference(
    program: Path, conversation: Conversation, paths: Sequence[str], seconds: float, wake: str = "byte"
) -> Ran:
    """Repeat the same exchange with the C client. wake: its poll wakes for each "byte" or for the whole "reply"."""
    told = "".join(
        f"line {path} {conversation.pause_s} {wake}\n"
        f"ask {conversation.request.hex()} {conversation.reply.hex()} {conversation.closing.hex() or '-'}\n"
        for path in paths
    )
    done = subprocess.run(
        [*on_client_core(), str(program)],
        input=f"{told}run {seconds}\n",
        capture_output=True,
        text=True,
        check=True,
    )
    answer = json.loads(done.stdout)
    if answer["wrong"]:
        raise MeasurementError(f"the C client met {answer['wrong']} wrong replies")
    return _ran(answer)


def _ran(answer: Mapping[str, Any]) -> Ran:
    return Ran(tuple((one["exchanges"], one["seconds"]) for one in answer["lines"]), answer["processor_s"])
