"""pyserial's handler for virtual://NUMBER, found by its module name: the master's end of a virtual line."""

from __future__ import annotations

from contextlib import contextmanager
from threading import Condition
from typing import TYPE_CHECKING, Any

from serial import PortNotOpenError, SerialBase, SerialException

from drivecomm.errors import LinkError, UsageError
from drivecomm.protocol import SETTING_NAMES, LineSettings
from drivecomm.testing.pyserial import line_at, turn_on

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivecomm.virtual import VirtualLine, VirtualPort

PATIENCE_S = 5.0
"""Real time in seconds for which a read without a timeout waits until another thread of the master sends something."""


class Serial(SerialBase):
    """A port in virtual time, which passes during reads with a timeout, and with each poll of `in_waiting`."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self._line: VirtualLine | None = None
        self._end: VirtualPort | None = None
        self._buffer = bytearray()
        self._turn = Condition()
        super().__init__(*args, **kwargs)

    def open(self) -> None:
        """Open the master's end of the line. Raises SerialException if the line no longer exists."""
        if self.is_open:
            raise SerialException(f"{self.port} is open already")
        self._line = line_at(str(self.port))
        if self._line is None:
            raise SerialException(
                f"there is no virtual line {self.port} in this process; get one from serial_url(line)"
            )
        self._turn = turn_on(self._line)
        with self._turn, _as_pyserial_has_it():
            self._end = self._line.port()
        self._buffer.clear()
        self.is_open = True
        self._reconfigure_port()

    def close(self) -> None:
        """Close the port; blocked reads in other threads end."""
        with self._turn:
            self.is_open = False
            self._turn.notify_all()

    @property
    def in_waiting(self) -> int:
        """Number of received bytes. Each call advances the time by one character, so that a polling loop ends."""
        end = self._opened()
        with self._turn, _as_pyserial_has_it():
            end.wait(end.now() + 11 / self.baudrate)
            self._buffer += end.take()
            return len(self._buffer)

    def read(self, size: int = 1) -> bytes:
        """Return up to `size` bytes: fewer if the timeout expires first."""
        end, line = self._opened(), self._line
        with self._turn, _as_pyserial_has_it():
            until = end.now() + (self.timeout or 0.0)
            while len(self._buffer) < size and self.is_open:
                if self.timeout is not None:
                    self._buffer += end.read(until, size - len(self._buffer))
                    break
                if line is not None and line.due < float("inf"):
                    self._buffer += end.read(line.due, size - len(self._buffer))
                elif not self._turn.wait(PATIENCE_S):
                    raise SerialException(
                        f"no bytes are pending on {self.port}, and this read has no timeout; give the port a timeout"
                    )
            found = bytes(self._buffer[:size])
            del self._buffer[:size]
            return found

    def write(self, data: Any) -> int:
        """Send the data, and return its length."""
        end, sent = self._opened(), bytes(data)
        with self._turn, _as_pyserial_has_it():
            end.write(sent)
            self._turn.notify_all()
        return len(sent)

    def flush(self) -> None:
        """Wait until all data is sent."""
        end = self._opened()
        with self._turn, _as_pyserial_has_it():
            end.wait(end.now() + (self._line.backlog_s if self._line else 0.0))

    def reset_input_buffer(self) -> None:
        """Discard all received bytes."""
        end = self._opened()
        with self._turn, _as_pyserial_has_it():
            end.take()
            self._buffer.clear()

    def reset_output_buffer(self) -> None:
        """Do nothing: no data is buffered for sending."""
        self._opened()

    @property
    def out_waiting(self) -> int:
        """Number of bytes buffered for sending; always 0."""
        self._opened()
        return 0

    def _opened(self) -> VirtualPort:
        if not self.is_open or self._end is None:
            raise PortNotOpenError
        return self._end

    def _reconfigure_port(self) -> None:
        end = self._opened()
        with self._turn, _as_pyserial_has_it():
            chosen = {name: getattr(self, name) for name in SETTING_NAMES}
            end.configure(LineSettings(**chosen))

    def _update_break_state(self) -> None:
        """Do nothing: virtual drives ignore a break."""

    def _update_rts_state(self) -> None:
        """Do nothing: virtual drives ignore RTS."""

    def _update_dtr_state(self) -> None:
        """Do nothing: virtual drives ignore DTR."""

    cts = dsr = cd = True
    """Always set, as by an adapter with these lines bridged, so that a master waiting for them continues."""
    ri = False


@contextmanager
def _as_pyserial_has_it() -> Iterator[None]:
    """Convert errors of the line to those of pyserial."""
    try:
        yield
    except (LinkError, UsageError) as error:
        raise SerialException(str(error)) from error
