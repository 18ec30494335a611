"""A pseudo-terminal with a chosen path, for programs that open a serial port of this machine."""

from __future__ import annotations

import contextlib
import os
import selectors
import termios
import tty
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivecomm.errors import PortError

if TYPE_CHECKING:
    from collections.abc import Mapping

_CHUNK = 512
_UNSET = 38400
"""Initial speed of a pseudo-terminal."""
_BAUD_RATES = {
    code: int(name[1:]) for name, code in vars(termios).items() if name.startswith("B") and name[1:].isdigit()
}


class PtyListener:
    """A symbolic link to a pseudo-terminal. Masters may open and close it repeatedly."""

    settings = None

    def __init__(self, path: str) -> None:
        self._path = Path(path)
        self._ours = -1
        self._theirs = -1
        self._terminal = ""
        self._selector: selectors.BaseSelector | None = None

    @property
    def address(self) -> str:
        """The path of the link."""
        return str(self._path)

    @property
    def descriptor(self) -> int | None:
        """The descriptor of our side of the pseudo-terminal; None when closed."""
        return None if self._ours < 0 else self._ours

    @property
    def told_settings(self) -> Mapping[str, Any]:
        """Speed and stop bits set by the master; empty while the speed is that of a new pseudo-terminal.

        Linux shows nothing else of the other side: 7E1 reads as 8 data bits without parity.
        """
        if self._theirs < 0:
            return {}
        _, _, control, _, _, speed, _ = termios.tcgetattr(self._ours)
        baudrate = _BAUD_RATES.get(speed)
        if baudrate is None or baudrate == _UNSET:
            return {}
        return {"baudrate": baudrate, "stopbits": 2 if control & termios.CSTOPB else 1}

    def open(self) -> None:
        """Create the pseudo-terminal and the link. Raises PortError."""
        try:
            # Remove an old link first: the new terminal may get the number to which the old link still points.
            self._make_room()
            self._ours, self._theirs = os.openpty()
            # Keep it open, so that it survives a master's close, and raw, for masters that never configure it.
            tty.setraw(self._theirs)
            self._terminal = os.ttyname(self._theirs)
            os.set_blocking(self._ours, False)
            self._selector = selectors.DefaultSelector()
            self._selector.register(self._ours, selectors.EVENT_READ)
            self._path.symlink_to(self._terminal)
        except OSError as error:
            self.close()
            raise PortError(
                f"cannot make a pseudo-terminal at {self._path} ({error.strerror or error}); "
                "choose a path in an existing folder with write permission"
            ) from error
        except PortError:
            self.close()
            raise

    def receive(self, wait_s: float) -> bytes:
        """Return bytes from a master, after waiting up to `wait_s` seconds."""
        if self._selector is None or not self._selector.select(wait_s):
            return b""
        try:
            return os.read(self._ours, _CHUNK)
        except BlockingIOError:
            return b""

    def send(self, data: bytes) -> None:
        """Send bytes; those that do not fit because no master reads are lost."""
        if self._selector is not None:
            with contextlib.suppress(BlockingIOError):
                os.write(self._ours, data)

    def close(self) -> None:
        """Remove the link, if it still points to our terminal, and close the pseudo-terminal."""
        if self._terminal:
            with contextlib.suppress(OSError):
                if str(self._path.readlink()) == self._terminal:
                    self._path.unlink()
            self._terminal = ""
        if self._selector is not None:
            self._selector.close()
            self._selector = None
        for descriptor in (self._ours, self._theirs):
            if descriptor >= 0:
                os.close(descriptor)
        self._ours = self._theirs = -1

    def _make_room(self) -> None:
        """Remove the dangling link of a server that was killed. Raises PortError if the path is in use."""
        if not self._path.exists():
            self._path.unlink(missing_ok=True)
            return
        if not self._path.is_symlink():
            raise PortError(f"{self._path} exists and is not a symbolic link; choose another path, or remove it")
        # Imported here, because only a path in use needs the search through all processes of the machine.
        from drivecomm.transport import server_of_terminal

        server = server_of_terminal(str(self._path)) or "another program"
        raise PortError(
            f"{self._path} leads to {self._path.resolve()}, which {server} serves; choose another path, or stop that "
            "program"
        )
