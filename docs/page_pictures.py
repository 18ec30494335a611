"""Pictures of the web page of a server over a virtual plant, taken in Chromium while mkdocs runs.

Without Chromium or playwright, each picture is replaced by an empty one.
"""

from __future__ import annotations

import asyncio
import base64
import hashlib
import math
import os
import socket
import tempfile
import threading
import time
from contextlib import ExitStack, closing, contextmanager
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING

from drivecomm.plant import read_plant
from drivecomm.protocol import Reading
from drivecomm.server import (
    LOCAL,
    Caller,
    CommandRequest,
    CurrentValue,
    Role,
    Serving,
    User,
    add_user,
    new_token,
    token_hash,
)
from drivecomm.server.history import HistoryWriter
from drivecomm.testing import ServingThread
from drivecomm.virtual import ControlClient, PlantServer, VirtualPlant

if TYPE_CHECKING:
    from collections.abc import Iterator

    from playwright.sync_api import Browser, Page

    from drivecomm.server import ServedPlant

CHROMIUM = Path("/usr/bin/chromium")
PLANT = Path(__file__).parent / "page-plant.toml"
PAGE = Path(__file__).parents[1] / "drivecomm" / "server" / "http" / "page"
PICTURES = {
    "page-plant.png": ("", (1280, 800), "light"),
    "page-drive.png": ("#/drive/pump", (1280, 900), "light"),
    "page-trends.png": ("#/trends", (1280, 760), "light"),
    "page-phone.png": ("", (360, 740), "dark"),
}
"""Content, window size and view of each picture."""

_ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
              "--disable-component-update", "--disable-sync"]  # fmt: skip
_EMPTY = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAQAAAC1HAwCAAAAC0lEQVR42mNkYAAAAAYAAjCB0C8AAAAASUVORK5CYII="
)
_RUNNING = {"pump": 64, "mixer": 45, "blower": 80, "conveyor": 50}
"""Running motors, with their references in per cent."""
_BEFORE_S = 600
_OPEN_S = 20.0
_TIMEOUT_MS = 15000


def page_pictures(cache: Path) -> dict[str, bytes]:
    """Return all pictures as PNG, by file name.

    cache: a folder that keeps them until the page or its plant changes.
    """
    kept = cache / f"page-{_fingerprint()}"
    if not kept.exists():
        taken = _taken()
        if taken is None:
            return dict.fromkeys(PICTURES, _EMPTY)
        kept.mkdir(parents=True)
        for name, picture in taken.items():
            (kept / name).write_bytes(picture)
    return {name: (kept / name).read_bytes() for name in PICTURES}


def _fingerprint() -> str:
    digest = hashlib.sha256()
    for file in sorted([Path(__file__), PLANT, *PAGE.rglob("*.*")]):
        digest.update(f"{file.name}\0".encode() + file.read_bytes())
    return digest.hexdigest()[:16]


def _taken() -> dict[str, bytes] | None:
    try:
        from playwright.sync_api import sync_playwright
    except ModuleNotFoundError:
        return None
    if not CHROMIUM.exists():
        return None
    with (
        tempfile.TemporaryDirectory() as folder,
        _served(Path(folder)) as (address, token),
        sync_playwright() as started,
    ):
        browser = started.chromium.launch(executable_path=CHROMIUM, args=_ARGUMENTS)
        return {name: _picture(browser, name, address, token) for name in PICTURES}


def _picture(browser: Browser, name: str, address: str, token: str) -> bytes:
    place, (width, height), scheme = PICTURES[name]
    page: Page = browser.new_page(viewport={"width": width, "height": height}, color_scheme=scheme)
    page.set_default_timeout(_TIMEOUT_MS)
    page.add_init_script(f"sessionStorage.setItem('drivecomm-token', '{token}')")
    page.goto(address + place)
    page.wait_for_selector("html[data-link=live]")
    page.wait_for_timeout(2500)
    taken = page.screenshot()
    page.close()
    return taken


@contextmanager
def _served(folder: Path) -> Iterator[tuple[str, str]]:
    """Serve the plant of the pictures with its motors started; yield its address and an operator's token."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    file = folder / "plant.toml"
    file.write_text(PLANT.read_text(encoding="utf-8").replace(":8080", f":{port}"), encoding="utf-8")
    token = new_token()
    add_user(folder / "users.toml", User(name="asha", role=Role.OPERATE, token=token_hash(token)))
    _write_history(folder / "history.sqlite")
    before = os.environ.get("XDG_RUNTIME_DIR")
    os.environ["XDG_RUNTIME_DIR"] = str(folder)
    try:
        with ExitStack() as stack:
            virtual = PlantServer(VirtualPlant(read_plant(file)), control="127.0.0.1:0")
            stack.enter_context(closing(ServingThread(virtual)))
            control = stack.enter_context(ControlClient(virtual.control))
            plant = stack.enter_context(_running(Serving(file, port_of=lambda line: virtual.addresses[line.name])))
            asyncio.run(_start(plant))
            time.sleep(3)
            control.order("trip", drive="fan", code=14)
            control.order("power", drive="well", state="off")
            time.sleep(2)
            yield f"http://127.0.0.1:{port}/", token
    finally:
        if before is None:
            del os.environ["XDG_RUNTIME_DIR"]
        else:
            os.environ["XDG_RUNTIME_DIR"] = before


@contextmanager
def _running(serving: Serving) -> Iterator[ServedPlant]:
    """Run a server in a thread; yield its plant when it is ready."""
    served: list[ServedPlant] = []
    ready = threading.Event()

    def take(plant: ServedPlant) -> None:
        served.append(plant)
        ready.set()

    thread = threading.Thread(target=lambda: asyncio.run(serving.run(take)), daemon=True)
    thread.start()
    if not ready.wait(_OPEN_S):
        message = "the server of the pictures does not start"
        raise RuntimeError(message)
    try:
        yield served[0]
    finally:
        serving.end()
        thread.join(_OPEN_S)


async def _start(plant: ServedPlant) -> None:
    engineer = Caller(name="ravi", role=Role.COMMISSION, door=LOCAL)
    for drive, percent in _RUNNING.items():
        for verb, arguments in (("set_reference", {"percent": percent}), ("start", {})):
            answer = await plant.command(
                engineer, CommandRequest(drive=drive, verb=verb, arguments=arguments, id=f"{drive} {verb}")
            )
            if answer.error is not None:
                raise answer.error


def _write_history(file: Path) -> None:
    """Write a past for some drives before the server starts, as of motors with a varying load."""
    now = time.time()
    values = []
    for before_s in range(_BEFORE_S, 0, -2):
        time_s = now - before_s
        for place, (drive, hz) in enumerate((("pump", 32), ("mixer", 22), ("blower", 40))):
            swing = Decimal(f"{math.sin(before_s / (40 + 25 * place)) + 0.2 * math.sin(before_s / 3 + place):.2f}")
            for name, unit, value in (
                ("output_frequency", "Hz", hz + swing),
                ("output_current", "A", Decimal("4.1") + swing / 4),
            ):
                reading = Reading(parameter=name, value=value, raw=0, unit=unit, name=name, time_s=time_s)
                values.append(CurrentValue(drive=drive, name=name, reading=reading, quality="good", time_s=time_s))
    with closing(HistoryWriter(file)) as journal:
        journal.add_values(values)
