"""A capture as a test: library code runs against the recorded drives in virtual time and must send the same requests.

with replayed("pumps.jsonl") as line, drivecomm.open_bus(line.port) as bus:
    assert bus.drive("vabus", 1).read("481").value == 1000
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Self

from drivecomm.capture import Capture, read_capture
from drivecomm.protocol import installed
from drivecomm.traffic.replay.exchanges import recorded_exchanges, request_as_text
from drivecomm.virtual import VirtualPort

if TYPE_CHECKING:
    from pathlib import Path

    from drivecomm.protocol import LineSettings


class ReplayError(AssertionError):
    """The code under test deviated from the capture."""


def replayed(capture: str | Path | Capture) -> Replayed:
    """Return a line that replays a capture, as a context manager. A path is read first.

    Raises FileFormatError if the file is not a capture, UsageError if the capture does not name the sources.
    """
    return Replayed(capture if isinstance(capture, Capture) else read_capture(capture))


class Replayed:
    """A line with the drives of a capture, for one master that must send the recorded requests in the same order.

    The clock is virtual. A reply comes as long after its request as in the capture and in the same pieces, whenever the
    request is sent. Any other request raises ReplayError, an AssertionError that names the first difference. Leaving
    the block with requests unsent raises ReplayError as well.
    """

    def __init__(self, capture: Capture) -> None:
        self._left = deque(enumerate(recorded_exchanges(capture), start=1))
        self._arriving: deque[tuple[float, bytes]] = deque()
        self._settings: LineSettings | None = None
        self._free_at = 0.0
        self.time = 0.0
        """The line's time, in seconds; it passes only while the master waits."""
        # Replies may have been recorded without character times, for example from a pseudo-terminal; accept them.
        self.paced = self.broken = False

    def port(self) -> VirtualPort:
        """Open the master's end of the line, for `drivecomm.open_bus` and `open_bus_async`."""
        return VirtualPort(self)

    def configure(self, settings: LineSettings) -> None:
        """Set the master's line settings, which determine the time that a request takes."""
        self._settings = settings

    def transmit(self, data: bytes) -> None:
        """Send a request of the master. Raises ReplayError if it differs from the capture."""
        if not self._left:
            raise ReplayError(f"the capture has ended, but {request_as_text(data, installed.working())} is sent")
        number, wanted = self._left[0]
        if data != wanted.request:
            plugins = list(installed.working())
            raise ReplayError(
                f"request {number}, at {wanted.asked_s:.3f} s of the capture, was "
                f"{request_as_text(wanted.request, plugins)}; now {request_as_text(data, plugins)} is sent"
            )
        self._left.popleft()
        wire_s = self._settings.wire_s(len(data)) if self._settings is not None else 0.0
        self._free_at = max(self.time, self._free_at) + wire_s
        self._arriving += [(self._free_at + part.after_s, part.data) for part in wanted.parts]

    def receive(self, until: float, at_least: int) -> bytes:
        """Pass time until at least this many bytes have arrived, or until the given time; return the bytes."""
        came = self.take()
        while len(came) < at_least and self._arriving and self._arriving[0][0] <= until:
            self.time = max(self.time, self._arriving[0][0])
            came += self.take()
        if len(came) < at_least:
            self.pass_time(until)
        return came

    def take(self) -> bytes:
        """Return the bytes that have arrived by now."""
        came = b""
        while self._arriving and self._arriving[0][0] <= self.time:
            came += self._arriving.popleft()[1]
        return came

    def pass_time(self, until: float) -> None:
        """Advance the clock to this time; ignore a time in the past."""
        self.time = max(self.time, until)

    def finish(self) -> None:
        """Raise ReplayError if requests of the capture were not sent."""
        if self._left:
            number, wanted = self._left[0]
            raise ReplayError(
                f"{len(self._left)} requests of the capture were not sent; the first is request {number}, "
                f"at {wanted.asked_s:.3f} s: {request_as_text(wanted.request, installed.working())}"
            )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is None:
            self.finish()
