"""Minimum work of a Python master on many lines: one selector, and for each line write, read and compare."""

from __future__ import annotations

import contextlib
import os
import selectors
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bare_reader import LOST_MS, LostReplyError, open_whole
from counting import WARM_UP

if TYPE_CHECKING:
    from counting import Counts, Job


@dataclass(slots=True)
class _Line:
    port: int
    came: bytes = b""
    exchanges: int = 0
    ended: float = 0.0


def read_bare_lines(job: Job) -> tuple[Counts, float]:
    """Repeat the exchange of the job on all its lines without pauses."""
    request, reply = (bytes.fromhex(job["spoken"][name]) for name in ("request", "reply"))
    with contextlib.ExitStack() as opened, selectors.DefaultSelector() as selector:
        lines = []
        for path in job["paths"]:
            line = _Line(open_whole(path, len(reply)))
            opened.callback(os.close, line.port)
            selector.register(line.port, selectors.EVENT_READ, line)
            lines.append(line)

        def read(until: float) -> None:
            talking = len(lines)
            for line in lines:
                os.write(line.port, request)
            while talking:
                ready = selector.select(LOST_MS / 1000)
                if not ready:
                    raise LostReplyError("no reply came within a second")
                for key, _ in ready:
                    line = key.data
                    line.came += os.read(line.port, 4096)
                    if len(line.came) < len(reply):
                        continue
                    if line.came != reply:
                        raise LostReplyError(f"the reply was {line.came.hex()} instead of {reply.hex()}")
                    line.came = b""
                    line.exchanges += 1
                    line.ended = time.perf_counter()
                    if line.ended < until:
                        os.write(line.port, request)
                    else:
                        talking -= 1

        for _ in range(WARM_UP):
            read(until=0.0)
        for line in lines:
            line.exchanges = 0
        began, spent = time.perf_counter(), time.process_time()
        read(until=began + job["seconds"])
        return [(line.exchanges, line.ended - began) for line in lines], time.process_time() - spent
