"""Check that the lines of a plant can carry the server's requests: the polls of the file, and all status polls."""

from __future__ import annotations

import asyncio
import json
import os
import sys
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivecomm.line import PollPlan
from drivecomm.virtual import forecast

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from drivecomm.plant import Plant

CHECK_AFTER_S = 5.0
"""Delay before the check, because a server has more urgent work right after its start."""
_LOW_PRIORITY = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class LineLoad:
    """The load of a line by a server's own requests.

    utilisation: share of the line's time, from 0 to 1, and above 1 if the line cannot carry them. advice: how to make
    them fit.
    """

    line: str
    utilisation: float
    fits: bool
    advice: str
    status_period_s: float

    @property
    def text(self) -> str:
        """The load as a sentence."""
        asked = f"its polls, and the status of each drive every {self.status_period_s:g} s"
        need = f"{asked}, need {self.utilisation:.0%} of the line's time"
        return need if self.fits else f"does not keep up: {need}" + f"; {self.advice}" * bool(self.advice)


def line_loads(plant: Plant, status_period_s: float) -> Iterator[LineLoad]:
    """Yield the load of each line that has drives; takes a second or two for a large line, and opens no port."""
    for line in plant.lines:
        names = {drive.name for drive in plant.on_line(line.name)}
        if not names:
            continue
        reads = [read for read in plant.served_plan(status_period_s).reads if read.drive.name in names]
        found = forecast(PollPlan(reads=tuple(reads)))
        yield LineLoad(
            line=line.name,
            utilisation=found.utilisation,
            fits=found.fits,
            advice=found.advice[0] if found.advice and not found.fits else "",
            status_period_s=status_period_s,
        )


async def report_overload(path: Path, report: Callable[[str, str], None], after_s: float = CHECK_AFTER_S) -> None:
    """Report each line of a plant file that cannot keep up, by its name and a sentence.

    The check runs in a separate process with a low priority, so it does not delay the lines and doors of this one.
    """
    await asyncio.sleep(after_s)
    with suppress(OSError):
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "drivecomm", "serve", str(path), "--check", "--json"),
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.DEVNULL,
        )
        try:
            with suppress(OSError, AttributeError):
                os.setpriority(os.PRIO_PROCESS, process.pid, _LOW_PRIORITY)
            output, _ = await process.communicate()
        finally:
            if process.returncode is None:
                process.kill()
                await process.wait()
        for text in output.splitlines():
            with suppress(ValueError):
                told = json.loads(text)
                if told.get("fits") is False:
                    report(str(told["line"]), str(told["text"]))
