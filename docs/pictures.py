"""Pictures of terminals, made from the output of `drivecomm demo` and `drivecomm watch` while mkdocs runs.

Everything in them happens in virtual time, so the same program gives the same pictures.
"""

from __future__ import annotations

import asyncio
import hashlib
import io
import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.text import Text

import drivecomm
from drivecomm.cli.watch.command import LogSwitch
from drivecomm.cli.watch.screen import WatchScreen
from drivecomm.plant import read_plant
from drivecomm.plant.watching import Watcher, lines_of
from drivecomm.virtual import VirtualPlant

if TYPE_CHECKING:
    from collections.abc import Iterator

PLANT = Path(__file__).parent / "watch-plant.toml"
SIZES = ((80, 24), (160, 50))
WATCHED_S = 60.0
REFERENCES = {"pump": {"hz": 32}, "fan": {"percent": 80}, "mixer": {"percent": 45}, "conveyor": {"hz": 25}}
"""Running motors at the start of watching, with their references."""

_LONGEST = 66
# Heading of the demo's last part, which is cut off if it comes before the line limit.
_END = "Refusals"
# Pictures must not load a font from the network.
_FONT = re.compile(r"@font-face \{.*?\}\s*", re.DOTALL)


def pictures(cache: Path) -> dict[str, str]:
    """Return all pictures as SVG, by file name.

    cache: a folder that keeps them until their sources change.
    """
    kept = cache / f"pictures-{_fingerprint()}.json"
    if kept.exists():
        return json.loads(kept.read_text(encoding="utf-8"))
    drawn = {"demo.svg": demo_picture(), **asyncio.run(watch_pictures())}
    drawn = {name: _FONT.sub("", picture) for name, picture in drawn.items()}
    cache.mkdir(parents=True, exist_ok=True)
    for old in cache.glob("pictures-*.json"):
        old.unlink(missing_ok=True)
    kept.write_text(json.dumps(drawn), encoding="utf-8")
    return drawn


def _fingerprint() -> str:
    """Return a hash that changes with any file of the framework or a protocol, or with a drawing library."""
    digest = hashlib.sha256()
    for file in sorted([Path(__file__), PLANT, *_files_of("drivecomm"), *_files_of("protocols")]):
        digest.update(f"{file}\0".encode() + file.read_bytes())
    digest.update(repr([version(name) for name in ("rich", "textual")]).encode())
    return digest.hexdigest()[:16]


def _files_of(folder: str) -> Iterator[Path]:
    for file in (Path(__file__).parents[1] / folder).rglob("*"):
        if file.is_file() and file.suffix != ".pyc":
            yield file


def demo_picture() -> str:
    """Run the demo, and return a drawing of its first lines in colour."""
    environment = {**os.environ, "FORCE_COLOR": "1", "COLORTERM": "truecolor", "TERM": "xterm-256color"}
    command = [sys.executable, "-m", "drivecomm", "demo"]
    shown = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)  # noqa: S603
    lines = Text.from_ansi(f"$ drivecomm demo\n{shown.stdout}").split("\n")
    for line in lines:
        line.rstrip()
    end = next((place for place, line in enumerate(lines) if line.plain.startswith(_END)), _LONGEST)
    console = Console(record=True, width=112, file=io.StringIO())
    for line in lines[: min(end, _LONGEST)]:
        console.print(line)
    console.print("...")
    return console.export_svg(title="drivecomm demo")


async def watch_pictures() -> dict[str, str]:
    """Return drawings of the watch screen at the end of a plant's run, in terminals of all sizes."""
    plant = _plant_in_motion()
    lines = [replace(line, port=plant.line(line.name).port) for line in lines_of(plant.plant)]
    screen = WatchScreen(Watcher(lines), title=PLANT.name, log=LogSwitch(None), duration_s=WATCHED_S)
    drawn = {}
    async with screen.run_test(size=SIZES[0]) as pilot:
        await screen.asked_all.wait()
        await pilot.pause()
        await pilot.press("down")
        for width, height in SIZES:
            await pilot.resize_terminal(width, height)
            screen.query_one("#message").update("")
            screen.show()
            await pilot.pause()
            drawn[f"watch-{width}x{height}.svg"] = screen.export_screenshot(title=f"drivecomm watch {PLANT.name}")
    return drawn


def _plant_in_motion() -> VirtualPlant:
    """Return the plant of the pictures with its motors started."""
    plant = VirtualPlant(read_plant(PLANT))
    for name, line in plant.lines.items():
        with drivecomm.open_bus(line.port) as bus:
            for planned in plant.plant.on_line(name):
                if planned.name in REFERENCES:
                    drive = bus.drive(planned.protocol, planned.address, **planned.options)
                    drive.set_reference(**REFERENCES[planned.name])
                    drive.start()
    return plant
