"""The pages build without a warning, and ask for nothing from elsewhere; what the site makes itself is in it."""

import html
import re
import zlib

import api_pages
import pytest
from commands_page import all_commands
from door_pictures import PICTURES as OF_DOORS
from page_pictures import PICTURES
from pages import ROOT

from drivecomm.protocol import installed

# Building it takes longer than all other pages' tests; `make docs` builds it, too.
pytestmark = pytest.mark.soak

# What a browser fetches by itself, as against what a reader may click on.
FETCHED = re.compile(
    r"<(?:script|img|iframe|source)[^>]+src=[\"']?https?://"
    r"|<link[^>]+rel=[\"']?(?:stylesheet|preconnect|icon|preload)[^>]+href=[\"']?https?://"
    r"|@import[^;]*https?://|url\([\"']?https?://"
)
FETCHED_BY_A_PICTURE = re.compile(r"font-face|url\((?!#)|href=|@import|<image")

WATCHED = [
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
SHOWN = {
    "demo.svg": ["$ drivecomm demo", "One exchange in full"],
    "watch-80x24.svg": WATCHED,
    # Where there is more room.
    "watch-160x50.svg": [*WATCHED, "vabus:1", "danfoss-fc:12", "age s", "power kW"],
}


def test_nothing_is_fetched_from_elsewhere(site):
    for page in [*site.rglob("*.html"), *site.rglob("*.css"), *site.rglob("*.svg")]:
        found = FETCHED.search(page.read_text(encoding="utf-8"))
        assert not found, f"{page.relative_to(site)}: {found[0]}"


def test_every_protocol_has_a_page_with_its_telegrams(site):
    for plugin in installed.working():
        text = (site / "reference" / "protocols" / f"{plugin.name}.html").read_text(encoding="utf-8")
        for title in plugin.forms():
            assert title in text


def test_the_scripts_are_not_published(site):
    assert not list(site.rglob("*.py"))


@pytest.mark.parametrize("name", SHOWN)
def test_pictures(site, name):
    """They are made of what the commands show now; here is what a reader is to see in them."""
    picture = (site / "pictures" / name).read_text(encoding="utf-8")
    text = html.unescape(" ".join(re.findall(r"<text[^>]*>([^<]*)</text>", picture))).replace("\xa0", " ")
    assert [each for each in SHOWN[name] if each not in text] == []
    assert not FETCHED_BY_A_PICTURE.search(picture)


def test_every_picture_is_shown(site):
    pages = "".join(page.read_text(encoding="utf-8") for page in (ROOT / "docs").rglob("*.md"))
    made = {picture.name for picture in (site / "pictures").iterdir()}
    assert made == set(SHOWN) | set(PICTURES) | set(OF_DOORS)
    assert all(f"pictures/{name})" in pages for name in made)


def test_every_public_name_stands_on_a_page(site):
    """Each has an anchor by its full name: that of its room, or that of `drivecomm`."""
    inventory = zlib.decompress((site / "objects.inv").read_bytes().split(b"\n", 4)[4]).decode()
    listed = {line.split(" ")[0]: line.split(" ")[3] for line in inventory.splitlines()}
    pages = [api_pages.TOP, *(f"{api_pages.TOP}.{room}" for room in api_pages.ROOMS)]
    modules = {module.__name__: module for page in pages for module in api_pages.modules_of(page)}
    errors = set(api_pages.names_of(modules["drivecomm.errors"]))
    places = [
        api_pages.place_of(module, each)
        for name, module in modules.items()
        for each in api_pages.names_of(module)
        if not (name == api_pages.TOP and each in errors)
    ]
    assert [place for place in places if place not in listed] == []
    assert not [name for name in listed if "._" in name]
    for place in {place.partition("#")[0] for place in listed.values()}:
        assert (site / place).exists()


def test_every_command_has_its_section(site):
    page = (site / "reference" / "commands.html").read_text(encoding="utf-8")
    for name, _ in all_commands():
        assert f'id="drivecomm-{name.replace(" ", "-")}"' in page, name
