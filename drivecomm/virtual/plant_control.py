"""Steering a plant that another program serves, through its control socket.

with PlantControl("127.0.0.1:4900") as control:
    control.order("trip", drive="pump", code=5)
"""

from __future__ import annotations

import json
import socket
from typing import TYPE_CHECKING, Any, Self

from drivecomm.errors import LinkDownError, PortError, UsageError
from drivecomm.virtual.control_door import parse_place

if TYPE_CHECKING:
    from types import TracebackType

_PATIENCE_S = 10.0


class PlantControl:
    """A connection to the control socket at HOST:PORT or unix:PATH.

    Raises UsageError for a text that is neither, PortError where no plant is.
    """

    def __init__(self, address: str) -> None:
        self.address = address
        place = parse_place(address)
        try:
            if place.path:
                self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
                self._socket.settimeout(_PATIENCE_S)
                self._socket.connect(place.path)
            else:
                self._socket = socket.create_connection((place.host, place.port), timeout=_PATIENCE_S)
        except OSError as error:
            raise PortError(
                f"no plant at {address} ({error.strerror or error}); start one with drivecomm simulate, "
                "which prints the place of its control socket"
            ) from error
        self._file = self._socket.makefile("rb")

    def order(self, order: str, **fields: Any) -> dict[str, Any]:
        """Give an order and return the answer, without its `ok`.

        The orders are trip, power, set, inject, fault and show, with the fields that `control_orders` tells. Raises
        UsageError when the plant refuses, LinkDownError when it has gone.
        """
        try:
            self._socket.sendall(json.dumps({"order": order, **fields}).encode() + b"\n")
            line = self._file.readline()
            answer = json.loads(line) if line else None
        except (OSError, ValueError) as error:
            raise LinkDownError(f"the plant at {self.address} does not answer ({error}); is it running?") from error
        if not isinstance(answer, dict):
            raise LinkDownError(f"the plant at {self.address} has gone; start it again")
        if not answer.pop("ok", False):
            raise UsageError(str(answer.get("error", "the plant refused without saying why")))
        return answer

    def close(self) -> None:
        """End the connection; the plant goes on."""
        self._file.close()
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()
