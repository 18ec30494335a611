"""A virtual plant and its server in threads of this process, for tests of programs that use a server."""

from __future__ import annotations

import asyncio
import os
from contextlib import ExitStack, contextmanager
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event, Thread
from typing import TYPE_CHECKING, Any

from drivecomm.errors import UsageError
from drivecomm.plant import OpenPlant, open_plant
from drivecomm.tomlfile import TomlTable

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivecomm.plant import PlantLine
    from drivecomm.testing.watched_plant import WatchedPlant

_PATIENCE_S = 30.0


class WatchedServer:
    """A running server over virtual drives that answer in real time; closed by `close`.

    file: the plant file of the server. plant: the virtual drives, their telegrams and events. url: address of the HTTP
    API on a free loopback port, whatever port the file gives. socket: path of the local socket.
    """

    def __init__(self, file: Path, plant: WatchedPlant) -> None:
        self.file = file
        self.plant = plant
        self._ready = Event()
        self._error: BaseException | None = None
        self._stack = ExitStack()
        try:
            self._serve()
        except BaseException:
            self._stack.close()
            raise

    @cached_property
    def client(self) -> OpenPlant:
        """The plant as `drivecomm.open_plant` gives it to any program: drives by name, through the server."""
        return self._stack.enter_context(open_plant(self.file))

    def close(self) -> None:
        """Stop the server. Called automatically at the end of the test."""
        self._stack.close()

    def __repr__(self) -> str:
        return f"<WatchedServer {self.file.name} at {self.url}>"

    def _serve(self) -> None:
        from drivecomm.server import Serving, read_settings
        from drivecomm.server.http import http_door

        said = next((table.content for kind, table in read_settings(self.file).doors if kind == "http"), {})
        door = http_door(TomlTable({**said, "listen": "127.0.0.1:0"}, str(self.file), name="door (http)"))
        self._serving = Serving(self.file, port_of=self._port_of, doors=[door])
        thread = Thread(target=self._run, name="drivecomm server", daemon=True)
        thread.start()
        self._stack.callback(thread.join, _PATIENCE_S)
        self._stack.callback(self._serving.end)
        if not self._ready.wait(_PATIENCE_S):
            raise UsageError(f"the server of {self.file} is not ready within {_PATIENCE_S:g} s")
        if self._error is not None:
            raise self._error
        if not door.port:
            raise UsageError(f"the HTTP door of {self.file} does not open; is drivecomm[server] installed?")
        self.url = f"{'https' if said.get('certificate') else 'http'}://127.0.0.1:{door.port}"
        self.socket = self._serving.socket

    def _run(self) -> None:
        try:
            asyncio.run(self._serving.run(lambda _: self._ready.set()))
        except BaseException as error:  # noqa: BLE001 - raised in the test's thread
            self._error = error
        finally:
            self._ready.set()

    def _port_of(self, line: PlantLine) -> Any:
        return self.plant.line(line.name).port


@contextmanager
def folders_of_servers() -> Iterator[None]:
    """Give the servers of this process empty temporary state and runtime folders, and remove them afterwards.

    Programs started by this process look for servers there as well. The test's own folder is not used, because paths of
    sockets must be short.
    """
    names = ("STATE_DIRECTORY", "RUNTIME_DIRECTORY")
    before = {name: os.environ.get(name) for name in names}
    with TemporaryDirectory(prefix="drivecomm-", ignore_cleanup_errors=True) as folder:
        for name in names:
            own = Path(folder) / name[:5].lower()
            own.mkdir(mode=0o700)
            os.environ[name] = str(own)
        try:
            yield
        finally:
            for name, value in before.items():
                if value is None:
                    del os.environ[name]
                else:
                    os.environ[name] = value
