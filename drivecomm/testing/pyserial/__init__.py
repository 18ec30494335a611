"""Virtual lines for masters that use pyserial: a URL for a line in this process, and Python's clocks on the line's."""

from __future__ import annotations

import time
from contextlib import contextmanager
from functools import partial
from itertools import count
from typing import TYPE_CHECKING, Any
from unittest.mock import patch
from weakref import WeakValueDictionary

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivecomm.virtual import VirtualLine

_CLOCKS = ("monotonic", "perf_counter", "time")

_lines: WeakValueDictionary[str, VirtualLine] = WeakValueDictionary()
_numbers = count(1)


def serial_url(line: VirtualLine) -> str:
    """Return the URL under which `serial.serial_for_url` of this process opens the master's end of a line.

    It is in virtual time: a read with a timeout costs no time, however long it waits on the line's clock.
    """
    import serial

    if __name__ not in serial.protocol_handler_packages:
        serial.protocol_handler_packages.append(__name__)
    for url, each in _lines.items():
        if each is line:
            return url
    url = f"virtual://{next(_numbers)}"
    _lines[url] = line
    return url


def line_at(url: str) -> VirtualLine | None:
    """Return the line of a URL, None where there is none any more."""
    return _lines.get(url)


@contextmanager
def clock_of(line: VirtualLine) -> Iterator[None]:
    """Let `time.sleep` and the clocks of the module `time` follow the clock of a line for the time of the block.

    Without it a master that sleeps between its telegrams does so in real time, while the line's clock stands still.
    What was imported from the module by name before, such as `from time import sleep`, does not follow.
    """
    began = line.time
    followers: dict[str, Any] = {"sleep": line.advance}
    for name in _CLOCKS:
        followers[name] = partial(_shifted, line, getattr(time, name)() - began)
    with patch.multiple(time, **followers):
        yield


def _shifted(line: VirtualLine, by_s: float) -> float:
    return line.time + by_s
