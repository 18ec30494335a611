"""Masters at work on a line: the framework, its peers, the bare C client; each in a process of its own."""

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
    """What a Python master is to do.

    way: bare Python, bare selectors, blocking, threads, asyncio, poll plan, scan, or a peer. paths: its lines. seconds:
    how long it reads one parameter again and again on all of them. neighbour: a thread beside it that does nothing but
    compute. switch_interval_s: how often threads take turns, None for Python's own. spoken: what bare Python says and
    hears, as it knows no protocol.
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
    """What a master achieved: exchanges and seconds on each line, and its processor time."""

    lines: tuple[tuple[int, float], ...]
    processor_s: float

    @property
    def exchanges(self) -> int:
        """On all lines."""
        return sum(count for count, _ in self.lines)

    @property
    def rates(self) -> list[float]:
        """Exchanges a second of each line."""
        return [count / seconds if count else 0.0 for count, seconds in self.lines]

    @property
    def processor_us(self) -> float:
        """Processor time of one exchange."""
        return self.processor_s / self.exchanges * 1e6


class MasterBrokenError(Exception):
    """A master stopped with an error that no line can cause."""


class PythonMaster:
    """A Python process that does one job after the other, a context manager."""

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
        """Return the processor time that has nothing to do with the measurements so far."""
        return others_s(self._process.pid if self._process is not None else os.getpid())

    def work(self, job: Job) -> Ran:
        """Do a job. Raises CannotMeasureError when what it needs is not installed or not there yet.

        Raises MeasurementError when a reply did not come, MasterBrokenError when the program is at fault.
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
    """Return the job of reading on lines where this is said."""
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
    """Let the C client have the same conversation. wake: its poll wakes for each "byte" or for the whole "reply"."""
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
