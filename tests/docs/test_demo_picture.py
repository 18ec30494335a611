"""The picture of `drivecomm demo` shows what it prints now, and asks for nothing from elsewhere."""

import html
import re
import sys

from pages import ROOT

sys.path.insert(0, str(ROOT / "docs"))
import make_picture


def _texts(svg):
    return html.unescape(" ".join(re.findall(r"<text[^>]*>([^<]*)</text>", svg))).replace("\xa0", " ")


def test_the_picture_is_what_the_demo_prints():
    committed = make_picture.PICTURE.read_text(encoding="utf-8")
    assert _texts(make_picture.picture()) == _texts(committed), (
        "run python docs/make_picture.py and look at the picture"
    )
    assert "$ drivecomm demo" in _texts(committed)
    assert "One exchange in full" in _texts(committed)


def test_nothing_is_fetched():
    committed = make_picture.PICTURE.read_text(encoding="utf-8")
    assert "font-face" not in committed
    assert not re.findall(r"url\((?!#)|href=|@import|<image", committed)
