"""Minimum work of a Python master on one line: write, poll, read and compare.

Any loss against the ideal rate is due to Python and the machine.
"""

from __future__ import annotations

import os
import select
import termios
import time
from typing import TYPE_CHECKING

from counting import in_turn

if TYPE_CHECKING:
    from counting import Counts, Job

# A sleep ends late, so the last part of a pause is a busy wait, as in the C client.
_SPIN_S = 150e-6
LOST_MS = 1000


class LostReplyError(Exception):
    """A reply is missing or wrong."""


def read_bare(job: Job) -> tuple[Counts, float]:
    """Repeat the exchange of the job on its one line."""
    (path,) = job["paths"]
    request, reply, closing = (bytes.fromhex(job["spoken"][name]) for name in ("request", "reply", "closing"))
    pause_s = job["spoken"]["pause_s"]
    port = open_whole(path, len(reply))
    try:
        poller = select.poll()
        poller.register(port, select.POLLIN)
        following, may_speak_at = request, 0.0

        def read() -> None:
            nonlocal following, may_speak_at
            if pause_s:
                _wait_until(may_speak_at)
            os.write(port, following)
            following = closing + request
            came = b""
            while len(came) < len(reply):
                if not poller.poll(LOST_MS):
                    raise LostReplyError("no reply came within a second")
                came += os.read(port, 4096)
            if came != reply:
                raise LostReplyError(f"the reply was {came.hex()} instead of {reply.hex()}")
            may_speak_at = time.monotonic() + pause_s

        return in_turn(read, job["seconds"])
    finally:
        os.close(port)


def open_whole(path: str, length: int) -> int:
    """Open a port that becomes readable when this many bytes have arrived."""
    port = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    attributes = termios.tcgetattr(port)
    attributes[6][termios.VMIN], attributes[6][termios.VTIME] = length, 0
    termios.tcsetattr(port, termios.TCSANOW, attributes)
    return port


def _wait_until(until: float) -> None:
    if (left := until - time.monotonic() - _SPIN_S) > 0:
        time.sleep(left)
    while time.monotonic() < until:
        pass
