"""The site builds without a warning, loads nothing from other hosts, and contains its generated pages and pictures."""

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

# A build takes longer than all other tests of pages; `make docs` builds the site as well.
pytestmark = pytest.mark.soak

# References that a browser loads by itself, unlike links for the reader.
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
    # A larger terminal shows more columns.
    "watch-160x50.svg": [*WATCHED, "vabus:1", "danfoss-fc:12", "age s", "power kW"],
}


def test_site_loads_nothing_from_other_hosts(site):
    for page in [*site.rglob("*.html"), *site.rglob("*.css"), *site.rglob("*.svg")]:
        found = FETCHED.search(page.read_text(encoding="utf-8"))
        assert not found, f"{page.relative_to(site)}: {found[0]}"


def test_every_protocol_has_a_page_with_its_telegrams(site):
    for plugin in installed.working():
        text = (site / "reference" / "protocols" / f"{plugin.name}.html").read_text(encoding="utf-8")
        for title in plugin.forms():
            assert title in text


def test_site_does_not_publish_scripts(site):
    assert not list(site.rglob("*.py"))


@pytest.mark.parametrize("name", SHOWN)
def test_picture_shows_the_expected_texts(site, name):
    """Pictures are generated from the present output of commands; these are the texts a reader has to see."""
    picture = (site / "pictures" / name).read_text(encoding="utf-8")
    text = html.unescape(" ".join(re.findall(r"<text[^>]*>([^<]*)</text>", picture))).replace("\xa0", " ")
    assert [each for each in SHOWN[name] if each not in text] == []
    assert not FETCHED_BY_A_PICTURE.search(picture)


def test_every_generated_picture_is_used_on_a_page(site):
    pages = "".join(page.read_text(encoding="utf-8") for page in (ROOT / "docs").rglob("*.md"))
    made = {picture.name for picture in (site / "pictures").iterdir()}
    assert made == set(SHOWN) | set(PICTURES) | set(OF_DOORS)
    assert all(f"pictures/{name})" in pages for name in made)


def test_every_public_name_is_on_a_page(site):
    """Each name has an anchor with its full name: that of its package, or that of `drivecomm`."""
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


def test_commands_page_of_the_site_has_an_anchor_for_every_command(site):
    page = (site / "reference" / "commands.html").read_text(encoding="utf-8")
    for name, _ in all_commands():
        assert f'id="drivecomm-{name.replace(" ", "-")}"' in page, name
