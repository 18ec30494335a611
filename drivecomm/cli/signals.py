"""Ctrl-C, and SIGTERM and SIGHUP, which every command treats as Ctrl-C, from its first moment to its last.

They raise KeyboardInterrupt; what must not be interrupted only gets an event. SIGHUP stays ignored where it was at the
start, as nohup wants it.
"""

from __future__ import annotations

import _thread
import os
import signal
import sys
import time
from contextlib import contextmanager, suppress
from threading import Event, Timer, main_thread
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

_NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
_ALL = tuple(signal.Signals[name] for name in _NAMES if name in signal.Signals.__members__)

# When an interruption that was lost is repeated: late enough to be out of where it was lost.
_REPEATED_AFTER_S = 0.001

# A terminal that is closed sends more than one, and people press Ctrl-C twice: that is the same wish.
_ONE_WISH_S = 1.0


class _State:
    """The first signal that came to the command, and when; loading: the command has not begun."""

    loading = True
    number = 0
    at = 0.0


def interrupted() -> int:
    """Return the number of the first signal that came to the command, 0 for none."""
    return _State.number


def interrupt() -> None:
    """Let the first signal raise KeyboardInterrupt, and later ones end what does not come to its end by that.

    Until `loaded` the first one ends the process: an exception does not get out of all that happens in an import, and
    nothing has been opened or sent.
    """
    _State.loading = True
    _take(_interrupt)
    sys.unraisablehook = _repeat


def interrupt_main_thread() -> None:
    """Interrupt the command from another thread as Ctrl-C does; also out of a call of the system that waits."""
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(main_thread().ident or 0, signal.SIGINT)
    else:
        _thread.interrupt_main()


def loaded() -> None:
    """Say that the command begins."""
    _State.loading, _State.number = False, 0


def ignore() -> None:
    """Let signals do nothing."""
    _take(_nothing)


def restore() -> None:
    """Let signals end the process as they end any other."""
    _take(signal.SIG_DFL)


class SignalledEvent(Event):
    """An event that a signal handler may set at any moment.

    `Event.set` takes a lock, for which a handler would wait for ever where it interrupts whoever has it: a wait, or
    another set, of the same thread. Once set, it stays so.
    """

    def __init__(self) -> None:
        super().__init__()
        self._happened = False
        self._gate = _thread.allocate_lock()
        self._gate.acquire()

    def is_set(self) -> bool:
        """Whether it was set."""
        return self._happened

    def set(self) -> None:
        """Set it, and let all go on who wait for it; waits for nobody."""
        self._happened = True
        # Somebody else, or this thread where it was interrupted, may have opened it.
        with suppress(RuntimeError):
            self._gate.release()

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until it is set, so many seconds at most; returns whether it is."""
        if not self._happened and self._gate.acquire(timeout=-1 if timeout is None else max(0.0, timeout)):
            # One after the other.
            self.set()
        return self._happened


@contextmanager
def until_stopped() -> Iterator[Event]:
    """Yield an event that signals set; they do nothing else within the block: for what must not be interrupted."""
    stop = SignalledEvent()

    def tell(number: int, _: object) -> None:
        _remember(number)
        stop.set()

    with _taken(tell):
        yield stop


@contextmanager
def calling(interrupt: Callable[[], object]) -> Iterator[None]:
    """Let the first signal call something within the block, and later ones end what does not end by that."""

    def tell(number: int, frame: object) -> None:
        if _State.number:
            _interrupt(number, frame)
        else:
            _remember(number)
            interrupt()

    with _taken(tell):
        yield


@contextmanager
def _taken(handler: Any) -> Iterator[None]:
    previous = _take(handler)
    try:
        yield
    finally:
        for number, before in previous.items():
            signal.signal(number, before)


def _take(handler: Any) -> dict[signal.Signals, Any]:
    """Return what was there before."""
    taken = (number for number in _ALL if not (number.name == "SIGHUP" and signal.getsignal(number) == signal.SIG_IGN))
    return {number: signal.signal(number, handler) for number in taken}


def _nothing(*_: object) -> None:
    pass


def _interrupt(number: int, _: object) -> None:
    if _State.loading or (_State.number and time.monotonic() - _State.at > _ONE_WISH_S):
        try:
            os.write(2, b"drivecomm: interrupted\n")
        finally:
            os._exit(128 + number)
    if _remember(number):
        raise KeyboardInterrupt


def _repeat(lost: sys.UnraisableHookArgs) -> None:
    """Interrupt again what was interrupted where no exception gets out, as in a finalizer; tell of any other error."""
    if not isinstance(lost.exc_value, KeyboardInterrupt):
        sys.__unraisablehook__(lost)
        return
    number, _State.number = _State.number, 0
    again = Timer(_REPEATED_AFTER_S, _thread.interrupt_main, (number,))
    again.daemon = True
    again.start()


def _remember(number: int) -> bool:
    """Remember the first signal; returns whether it is."""
    if _State.number:
        return False
    _State.number, _State.at = number, time.monotonic()
    return True
