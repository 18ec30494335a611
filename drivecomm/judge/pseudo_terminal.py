"""Pseudo-terminal that can be configured repeatedly, like a serial port.

A pseudo-terminal of Linux has neither parity nor seven data bits. So the C library reports success for a change to such
settings only if another setting changes as well, and a master could open its port only once.
"""

from __future__ import annotations

import os
from contextlib import contextmanager, suppress
from threading import Event, Thread
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

_LOOK_S = 0.004
_LOCAL = 3


@contextmanager
def reconfigurable(path: str) -> Iterator[None]:
    """Keep setting a flag without effect at this terminal, for the time of the block; every master clears the flag."""
    import termios

    terminal = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    ended = Event()

    def keep() -> None:
        while not ended.wait(_LOOK_S):
            with suppress(termios.error):
                attributes = termios.tcgetattr(terminal)
                local = attributes[_LOCAL]
                # Without canonical mode (ICANON) the flag ECHONL has no effect.
                if not local & (termios.ICANON | termios.ECHONL):
                    attributes[_LOCAL] = local | termios.ECHONL
                    termios.tcsetattr(terminal, termios.TCSANOW, attributes)

    thread = Thread(target=keep, name="drivecomm judge terminal", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        os.close(terminal)
