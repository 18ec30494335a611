"""Scripted drive at a real port, played by a thread in real time."""

from __future__ import annotations

import tempfile
import time
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread
from typing import TYPE_CHECKING, Literal, TypeAlias

from drivecomm.testing.checking import CheckFailure
from drivecomm.testing.script import Script
from drivecomm.virtual import parse_listen

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivecomm.testing.exchange_vectors import ExchangeVector
    from drivecomm.testing.script import Arriving
    from drivecomm.virtual import Listener

PortKind: TypeAlias = Literal["pty", "tcp", "rfc2217"]

_TICK_S = 0.02
# A reading thread may learn of bytes some time after they were sent, but never before.
_SLACK_S = 0.005
# The last bytes may still be on their way when the call returns.
_LAST_BYTES_S = 2.0
_QUIET_S = 0.03


class LivePartner:
    """Player of one vector's steps at a listener, in real time. Each instance plays one script."""

    def __init__(self, vector: ExchangeVector, listener: Listener) -> None:
        self._vector = vector
        self._listener = listener
        self._stop = Event()
        self._done = Event()
        self._script: Script | None = None
        self._failure: CheckFailure | None = None
        self._coming: list[Arriving] = []
        # The thread starts now: some ports need to exchange data before a master can open them.
        self._thread = Thread(target=self._serve, name="conformance")
        self._thread.start()

    @property
    def address(self) -> str:
        """Address of the port, for the master to open."""
        return self._listener.address

    def begin(self, reply_time_s: float) -> None:
        """Start to play the steps. reply_time_s: the drive's reply timeout."""
        script = Script(self._vector.steps, reply_time_s=reply_time_s, wire_s=lambda _: 0.0, slack_s=_SLACK_S)
        self._coming = script.begin(time.monotonic())
        self._script = script

    def end(self) -> None:
        """Wait a short time until all steps are played, and check them. Raises CheckFailure."""
        self._done.wait(_LAST_BYTES_S)
        # Nothing may arrive after the last step.
        self._stop.wait(_QUIET_S)
        self.stop()
        self.check_so_far()
        if self._script is not None:
            self._script.over(time.monotonic())

    def check_so_far(self) -> None:
        """Raise CheckFailure if the master has deviated from the script so far."""
        if self._failure is not None:
            raise self._failure

    def stop(self) -> None:
        """Stop the thread."""
        self._stop.set()
        self._thread.join()

    def _serve(self) -> None:
        came = b""
        while self._script is None and not self._stop.is_set():
            # Keep the first request if it arrives during this wait.
            came += self._listener.receive(_TICK_S)
        if self._script is not None:
            self._play(self._script, came)

    def _play(self, script: Script, came: bytes) -> None:
        while not self._stop.is_set():
            while self._coming and self._coming[0].begins <= time.monotonic():
                self._listener.send(self._coming.pop(0).data)
            expected = script.expected()
            if not expected and not self._coming:
                self._done.set()
            if not came or (len(came) < len(expected) and expected.startswith(came)):
                due_s = self._coming[0].begins - time.monotonic() if self._coming else _TICK_S
                came += self._listener.receive(max(0.0, min(_TICK_S, due_s)))
                continue
            length = len(expected) or len(came)
            try:
                self._coming += script.sent(came[:length], time.monotonic())
            except CheckFailure as failure:
                self._failure = failure
                self._done.set()
                return
            came = came[length:]


@contextmanager
def live_partner(kind: PortKind, vector: ExchangeVector) -> Iterator[LivePartner]:
    """Yield a partner at a port of this kind; thread and port are closed afterwards."""
    with tempfile.TemporaryDirectory(prefix="drivecomm-") as folder:
        place = f"pty:{Path(folder) / 'line'}" if kind == "pty" else f"{kind}:127.0.0.1:0"
        listener = parse_listen(place)
        listener.open()
        partner = LivePartner(vector, listener)
        try:
            yield partner
        finally:
            partner.stop()
            listener.close()
