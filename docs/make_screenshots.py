"""Make pictures/watch-80x24.svg and watch-160x50.svg: what `drivecomm watch` shows of a virtual plant.

Run it again when the screen changes: `python docs/make_screenshots.py`. Everything is in virtual time, so that the same
program gives the same pictures.
"""

from __future__ import annotations

import asyncio
import re
from dataclasses import replace
from pathlib import Path

import drivecomm
from drivecomm.cli.watch.log_switch import LogSwitch
from drivecomm.cli.watch.screen import WatchScreen
from drivecomm.plant import read_plant
from drivecomm.plant.watching import Watcher, lines_of
from drivecomm.virtual import VirtualPlant

PICTURES = Path(__file__).parent / "pictures"
PLANT = PICTURES / "watch-plant.toml"
SIZES = {"watch-80x24.svg": (80, 24), "watch-160x50.svg": (160, 50)}
WATCHED_S = 60.0

REFERENCES = {"pump": {"hz": 32}, "fan": {"percent": 80}, "mixer": {"percent": 45}, "conveyor": {"hz": 25}}
"""Which motors turn when watching begins, and how fast they are to be."""

# Pictures must not load a font from elsewhere.
_FONT = re.compile(r"@font-face \{.*?\}\s*", re.DOTALL)


def plant_in_motion() -> VirtualPlant:
    """Return the plant of the pictures, its motors started."""
    plant = VirtualPlant(read_plant(PLANT))
    for name, line in plant.lines.items():
        with drivecomm.open_bus(line.port) as bus:
            for planned in plant.plant.on_line(name):
                if planned.name in REFERENCES:
                    drive = bus.drive(planned.protocol, planned.address, **planned.options)
                    drive.set_reference(**REFERENCES[planned.name])
                    drive.start()
    return plant


async def picture(width: int, height: int) -> str:
    """Return what the screen shows of the plant at the end of its time, as SVG."""
    plant = plant_in_motion()
    lines = [replace(line, port=plant.line(line.name).port) for line in lines_of(plant.plant)]
    watcher = Watcher(lines)
    screen = WatchScreen(watcher, title=PLANT.name, log=LogSwitch(None), duration_s=WATCHED_S)
    async with screen.run_test(size=(width, height)) as pilot:
        await screen.asked_all.wait()
        await pilot.pause()
        await pilot.press("down")
        screen.query_one("#message").update("")
        screen.show()
        await pilot.pause()
        svg = screen.export_screenshot(title=f"drivecomm watch {PLANT.name}")
    return _FONT.sub("", svg)


def main() -> None:
    """Draw both pictures."""
    for name, (width, height) in SIZES.items():
        (PICTURES / name).write_text(asyncio.run(picture(width, height)), encoding="utf-8")


if __name__ == "__main__":
    main()
