"""The pictures of `drivecomm watch` show what it shows now, and ask for nothing from elsewhere."""

import asyncio
import html
import re
import sys

import pytest
from pages import ROOT

sys.path.insert(0, str(ROOT / "docs"))
pytest.importorskip("textual", reason="the pictures need the extra named watch")
import make_screenshots

EVERYWHERE = [
    "watch-plant.toml",
    "6 drives",
    "1 fault",
    "1 silent",
    "FAULT",
    "14 earth fault",
    "no answer",
    "silent for",
    "at reference",
    "did not answer within",
    *("pump", "fan", "mixer", "conveyor", "well", "blower"),
    *("params", "trace", "trend", "log", "stop?", "stop!", "reset", "start", "quit"),
]
ONLY_WHERE_THERE_IS_ROOM = ["vabus:1", "danfoss-fc:12", "age s", "power kW"]


def _texts(svg):
    return html.unescape(" ".join(re.findall(r"<text[^>]*>([^<]*)</text>", svg))).replace("\xa0", " ")


@pytest.mark.parametrize("name", make_screenshots.SIZES)
def test_the_picture_is_what_the_screen_shows(name):
    committed = (make_screenshots.PICTURES / name).read_text(encoding="utf-8")
    drawn = asyncio.run(make_screenshots.picture(*make_screenshots.SIZES[name]))
    assert _texts(drawn) == _texts(committed), "run python docs/make_screenshots.py and look at the pictures"
    wanted = EVERYWHERE + (ONLY_WHERE_THERE_IS_ROOM if "160" in name else [])
    assert [text for text in wanted if text not in _texts(committed)] == []


@pytest.mark.parametrize("name", make_screenshots.SIZES)
def test_nothing_is_fetched(name):
    committed = (make_screenshots.PICTURES / name).read_text(encoding="utf-8")
    assert "font-face" not in committed
    assert not re.findall(r"url\((?!#)|href=|@import|<image", committed)
