"""A plant in real time: all its lines and its control socket, in one thread."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

from drivecomm.errors import UsageError
from drivecomm.virtual.control_socket import ControlServer, parse_place
from drivecomm.virtual.listeners import parse_listen
from drivecomm.virtual.serving import LineServer, ServedLine

if TYPE_CHECKING:
    from threading import Event

    from drivecomm.virtual.virtual_plant import VirtualPlant


class PlantServer:
    """Serves each line of a plant where it says `listen`, and control at HOST:PORT or unix:PATH if a place is given.

    The plant's time begins when this is entered. While it runs, its thread alone may touch the plant; others give
    orders through the control socket. Raises UsageError for a line without `listen` and for a text that
    names no place; entering raises PortError when a place cannot be had.
    """

    def __init__(self, plant: VirtualPlant, *, control: str = "") -> None:
        self.plant = plant
        self._served: dict[str, ServedLine] = {}
        for line in plant.plant.lines:
            if not line.listen:
                raise UsageError(
                    f"line {line.name} has no listen key; set it to pty:PATH, tcp:HOST:PORT or rfc2217:HOST:PORT"
                )
            self._served[line.name] = ServedLine(plant.line(line.name), parse_listen(line.listen))
        self._control = ControlServer(parse_place(control), plant, self._be_now) if control else None
        self._server = LineServer(list(self._served.values()), self._control)

    @property
    def addresses(self) -> dict[str, str]:
        """What a master opens, by the name of the line."""
        return {name: served.listener.address for name, served in self._served.items()}

    @property
    def control(self) -> str:
        """Where the control socket is; empty if there is none."""
        return self._control.address if self._control else ""

    def now(self) -> float:
        """Return the time of the lines: seconds since this was entered."""
        return self._server.now()

    def run(self, stop: Event) -> None:
        """Serve until the event is set, and a tenth of a second at most after it; may be called again."""
        self._server.run(stop)

    def __enter__(self) -> Self:
        self._server.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._server.__exit__(*error)

    def _be_now(self) -> None:
        now = self._server.now()
        for served in self._served.values():
            served.follow(now)
