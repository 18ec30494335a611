"""Handling of Ctrl-C, and of SIGTERM and SIGHUP, which every command treats like Ctrl-C during its whole run.

Signals raise KeyboardInterrupt; a section that must not be interrupted only gets an event. SIGHUP stays ignored if it
was ignored at the start, as nohup requires.
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

# Delay before a lost interruption is repeated, so that the code that lost it has ended.
_REPEATED_AFTER_S = 0.001

# A closing terminal sends more than one signal, and users press Ctrl-C twice; both count as one request.
_ONE_WISH_S = 1.0


class _State:
    """First signal that the command received, and its time; loading: whether the command has not begun yet."""

    loading = True
    number = 0
    at = 0.0


def interrupted() -> int:
    """Return the number of the first signal that the command received, 0 for none."""
    return _State.number


def interrupt() -> None:
    """Let the first signal raise KeyboardInterrupt, and later ones end the process if it is still running.

    Until `loaded` is called, the first signal ends the process: an exception may get lost during an import, and nothing
    has been opened or sent yet.
    """
    _State.loading = True
    _take(_interrupt)
    sys.unraisablehook = _repeat


def interrupt_main_thread() -> None:
    """Interrupt the command from another thread as Ctrl-C does, even out of a blocking system call."""
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(main_thread().ident or 0, signal.SIGINT)
    else:
        _thread.interrupt_main()


def loaded() -> None:
    """Mark the beginning of the command, after all imports."""
    _State.loading, _State.number = False, 0


def ignore() -> None:
    """Ignore signals."""
    _take(_nothing)


def restore() -> None:
    """Restore the default handling of signals, which ends the process."""
    _take(signal.SIG_DFL)


class SignalledEvent(Event):
    """Event that a signal handler may set at any moment.

    `Event.set` takes a lock. A handler that interrupts the holder of that lock, in a wait or another set of the same
    thread, would wait forever. Once set, this event stays set.
    """

    def __init__(self) -> None:
        super().__init__()
        self._happened = False
        self._gate = _thread.allocate_lock()
        self._gate.acquire()

    def is_set(self) -> bool:
        """Return whether the event is set."""
        return self._happened

    def set(self) -> None:
        """Set the event and wake all waiting threads; never blocks."""
        self._happened = True
        # Another thread, or this one before the interruption, may have released it already.
        with suppress(RuntimeError):
            self._gate.release()

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until the event is set, up to timeout seconds; return whether it is set."""
        if not self._happened and self._gate.acquire(timeout=-1 if timeout is None else max(0.0, timeout)):
            # Each waiting thread wakes the next one.
            self.set()
        return self._happened


@contextmanager
def until_stopped() -> Iterator[Event]:
    """Yield an event that signals set instead of interrupting; for sections that must not be interrupted."""
    stop = SignalledEvent()

    def tell(number: int, _: object) -> None:
        _remember(number)
        stop.set()

    with _taken(tell):
        yield stop


@contextmanager
def calling(interrupt: Callable[[], object]) -> Iterator[None]:
    """Let the first signal call a function within the block, and later ones end the process if it is still running."""

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
    """Install a handler and return the previous ones."""
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
    """Repeat an interruption that was lost where exceptions are ignored, as in a finalizer; report any other error."""
    if not isinstance(lost.exc_value, KeyboardInterrupt):
        sys.__unraisablehook__(lost)
        return
    number, _State.number = _State.number, 0
    again = Timer(_REPEATED_AFTER_S, _thread.interrupt_main, (number,))
    again.daemon = True
    again.start()


def _remember(number: int) -> bool:
    """Record the first signal; return whether this is the first one."""
    if _State.number:
        return False
    _State.number, _State.at = number, time.monotonic()
    return True
