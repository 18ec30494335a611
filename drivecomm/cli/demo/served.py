"""Last stop of the tour: a virtual plant with its server, a value from its API, and a trip that appears as an event."""

from __future__ import annotations

import json
import logging
import time
from contextlib import closing
from http.client import HTTPConnection
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from drivecomm.testing import LineMaker

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.cli.demo.steps import Tour
    from drivecomm.testing import WatchedServer

PLANT = """\
format = 1

[[line]]
name = "hall"

[[drive]]
name = "fan"
drive = "danfoss-fc:3"
options = { model = "fc300" }
poll = [{ parameters = ["dc_link_voltage"], period_s = 0.1 }]

[server]
name = "hall 2"
status_period_s = 0.1

[[door]]
kind = "http"
"""
_FAULT = 14
_PATIENCE_S = 10.0
_NEEDED = ("fastapi", "uvicorn")


def served_plant(tour: Tour) -> None:
    """Serve a virtual plant, read a value from its HTTP API, and find a trip among its events."""
    tour.heading("The same plant file, simulated and served: drivecomm serve")
    missing = [name for name in _NEEDED if find_spec(name) is None]
    if missing:
        tour.console.print(f"  left out without {' and '.join(missing)}; install drivecomm[server]", markup=False)
        return
    # The tour prints the events itself, so the server's log must stay silent.
    logging.getLogger("drivecomm.server").addHandler(logging.NullHandler())
    with TemporaryDirectory() as folder, tour.step("serve a virtual plant") as tell:
        file = Path(folder) / "plant.toml"
        file.write_text(PLANT, encoding="utf-8")
        with LineMaker(0, folder=lambda: Path(folder)) as lines:
            server = lines.server(file)
            tour.console.print("  GET /api/v1/drives/fan", markup=False)
            value = _until(lambda: _value(server))
            shown = f"{value['reading']['value']} {value['reading']['unit']}"
            text = f"{value['name']} {shown}, {value['quality']}, {value['age_s']:.1f} s old"
            tour.console.print(f"    {text}", markup=False)
            server.plant.drive("fan").trip(_FAULT)
            tour.console.print("  GET /api/v1/events", markup=False)
            event = _until(lambda: _event(server, "fault"))
            tour.console.print(f"    {event['drive']}: {event['kind']}: {event['text']}", markup=False)
        tell(f"{text}; {event['text']}")


def _value(server: WatchedServer) -> dict[str, Any] | None:
    values = _asked(server, "/api/v1/drives/fan")["values"]
    return next((each for each in values if each["reading"] and each["name"] == "dc_link_voltage"), None)


def _event(server: WatchedServer, kind: str) -> dict[str, Any] | None:
    return next((each for each in _asked(server, "/api/v1/events") if each["kind"] == kind), None)


def _asked(server: WatchedServer, path: str) -> Any:
    host = server.url.partition("//")[2]
    with closing(HTTPConnection(host, timeout=_PATIENCE_S)) as connection:
        connection.request("GET", path)
        return json.load(connection.getresponse())


def _until(asked: Callable[[], dict[str, Any] | None]) -> dict[str, Any]:
    until = time.monotonic() + _PATIENCE_S
    while (found := asked()) is None:
        if time.monotonic() > until:
            raise AssertionError(f"not seen within {_PATIENCE_S:g} s")
        time.sleep(0.02)
    return found
