"""pyserial's handler for virtual://NUMBER, found by its name: the master's end of a virtual line in this process."""

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
"""How long, in real time, a read without a timeout waits for another thread of the master to send something."""


class Serial(SerialBase):
    """A port in virtual time: its time passes while it is read with a timeout, and a little with each look at it."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self._line: VirtualLine | None = None
        self._end: VirtualPort | None = None
        self._buffer = bytearray()
        self._turn = Condition()
        super().__init__(*args, **kwargs)

    def open(self) -> None:
        """Open the master's end of the line. Raises SerialException for a line that is there no more."""
        if self.is_open:
            raise SerialException(f"{self.port} is open already")
        self._line = line_at(str(self.port))
        if self._line is None:
            raise SerialException(f"there is no virtual line {self.port} in this process; ask serial_url(line) for one")
        self._turn = turn_on(self._line)
        with self._turn, _as_pyserial_has_it():
            self._end = self._line.port()
        self._buffer.clear()
        self.is_open = True
        self._reconfigure_port()

    def close(self) -> None:
        """Let it go; what waits for it in another thread ends."""
        with self._turn:
            self.is_open = False
            self._turn.notify_all()

    @property
    def in_waiting(self) -> int:
        """How much has come. A look lets as much time pass as one character takes, so that a loop of looks ends."""
        end = self._opened()
        with self._turn, _as_pyserial_has_it():
            end.wait(end.now() + 11 / self.baudrate)
            self._buffer += end.take()
            return len(self._buffer)

    def read(self, size: int = 1) -> bytes:
        """Return so many bytes, or what has come until the timeout is over."""
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
                        f"nothing is on its way on {self.port}, and this read has no timeout; give the port a timeout"
                    )
            found = bytes(self._buffer[:size])
            del self._buffer[:size]
            return found

    def write(self, data: Any) -> int:
        """Send."""
        end, sent = self._opened(), bytes(data)
        with self._turn, _as_pyserial_has_it():
            end.write(sent)
            self._turn.notify_all()
        return len(sent)

    def flush(self) -> None:
        """Wait until all is out."""
        end = self._opened()
        with self._turn, _as_pyserial_has_it():
            end.wait(end.now() + (self._line.backlog_s if self._line else 0.0))

    def reset_input_buffer(self) -> None:
        """Throw away what has come."""
        end = self._opened()
        with self._turn, _as_pyserial_has_it():
            end.take()
            self._buffer.clear()

    def reset_output_buffer(self) -> None:
        """Nothing is held back here."""
        self._opened()

    @property
    def out_waiting(self) -> int:
        """Nothing is held back here."""
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
        """A break means nothing to drives here."""

    def _update_rts_state(self) -> None:
        """Nor do the lines beside the data."""

    def _update_dtr_state(self) -> None:
        """Nor do the lines beside the data."""

    cts = dsr = cd = True
    """A master that waits for them goes on, as with an adapter that ties them to its own."""
    ri = False


@contextmanager
def _as_pyserial_has_it() -> Iterator[None]:
    """Turn errors of the line into those of pyserial."""
    try:
        yield
    except (LinkError, UsageError) as error:
        raise SerialException(str(error)) from error
