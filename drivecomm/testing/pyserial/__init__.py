"""Virtual lines for masters with pyserial: a URL for a line in this process, and clocks in the line's time."""

from __future__ import annotations

import time
from contextlib import contextmanager
from functools import partial
from itertools import count
from threading import Condition
from typing import TYPE_CHECKING, Any
from unittest.mock import patch
from weakref import WeakKeyDictionary, WeakValueDictionary

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivecomm.virtual import VirtualLine

_CLOCKS = ("monotonic", "perf_counter", "time")

_lines: WeakValueDictionary[str, VirtualLine] = WeakValueDictionary()
_numbers = count(1)
_turns: WeakKeyDictionary[VirtualLine, Condition] = WeakKeyDictionary()


def serial_url(line: VirtualLine) -> str:
    """Return the URL with which `serial.serial_for_url` of this process opens the master's end of a line.

    The line runs in virtual time: a read with a timeout takes no real time, however long it waits on the line's clock.
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
    """Return the line of a URL, or None if it no longer exists."""
    return _lines.get(url)


def turn_on(line: VirtualLine) -> Condition:
    """Return the lock of a line for a master's threads; it is notified after time has passed or bytes were sent.

    Ports, sleeps and assertions of several threads use the line in turn.
    """
    return _turns.setdefault(line, Condition())


def advance(line: VirtualLine, seconds: float) -> None:
    """Advance the time of a line that several threads may use."""
    turn = turn_on(line)
    with turn:
        line.advance(seconds)
        turn.notify_all()


@contextmanager
def clock_of(line: VirtualLine) -> Iterator[None]:
    """Make `time.sleep` and the clocks of the module `time` follow a line's clock for the duration of the block.

    Without it, a master that sleeps between its telegrams sleeps in real time, while the line's clock stands still.
    Names imported before, as with `from time import sleep`, do not follow, nor do waits of other modules, such as
    `threading.Event.wait`.
    """
    began = line.time
    followers: dict[str, Any] = {"sleep": partial(advance, line)}
    for name in _CLOCKS:
        by_s = getattr(time, name)() - began
        followers[name] = partial(_shifted, line, by_s)
        followers[f"{name}_ns"] = partial(_shifted_ns, line, by_s)
    with patch.multiple(time, **followers):
        yield


def _shifted(line: VirtualLine, by_s: float) -> float:
    return line.time + by_s


def _shifted_ns(line: VirtualLine, by_s: float) -> int:
    return int((line.time + by_s) * 1e9)
