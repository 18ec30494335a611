"""A thread that serves virtual drives while a test goes on, and does not fail in silence."""

from __future__ import annotations

from threading import Event, Thread
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from types import TracebackType


class Serves(Protocol):
    """What serves until it is told to stop; entering opens its ports."""

    def run(self, stop: Event) -> None:
        """Serve until the event is set."""
        ...

    def __enter__(self) -> object: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None: ...


class ServingThread:
    """Serves from the beginning until it is closed. Raises PortError when a port cannot be had."""

    def __init__(self, server: Serves) -> None:
        self._server = server
        self._stop = Event()
        self._error: BaseException | None = None
        server.__enter__()
        self._thread = Thread(target=self._serve, name="drivecomm virtual line", daemon=True)
        self._thread.start()

    def check(self) -> None:
        """Raise RuntimeError when serving has come to an end by an error."""
        if self._error is not None:
            raise RuntimeError(f"the virtual line is not served any more: {self._error!r}") from self._error

    def close(self) -> None:
        """End the thread and close the ports; raise the error that ended serving before. May be called again."""
        self._stop.set()
        self._thread.join()
        self._server.__exit__(None, None, None)
        error, self._error = self._error, None
        if error is not None:
            raise error

    def _serve(self) -> None:
        try:
            self._server.run(self._stop)
        except BaseException as error:  # noqa: BLE001 - told to the test, whose thread is another one
            self._error = error
