"""A pseudo-terminal that may be configured again and again, as a serial port may.

A pseudo-terminal of Linux has neither parity nor seven data bits. The C library therefore calls a change of settings
with these a success only if something else changes with it, so that a master could open its port once and never again.
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
    """Keep a flag set at this terminal that every master clears and that has no effect, for the time of the block."""
    import termios

    terminal = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    ended = Event()

    def keep() -> None:
        while not ended.wait(_LOOK_S):
            with suppress(termios.error):
                attributes = termios.tcgetattr(terminal)
                local = attributes[_LOCAL]
                # Without lines there is no end of one to be echoed.
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
