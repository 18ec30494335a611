"""The pages build without a warning, and ask for nothing from elsewhere."""

import os
import re
import subprocess
import sys

import pytest
from pages import ROOT

from drivecomm.protocol import installed

pytest.importorskip("mkdocs", reason="the pages need the extra named docs")
pytestmark = pytest.mark.soak

# What a browser fetches by itself, as against what a reader may click on.
FETCHED = re.compile(
    r"<(?:script|img|iframe|source)[^>]+src=[\"']?https?://"
    r"|<link[^>]+rel=[\"']?(?:stylesheet|preconnect|icon|preload)[^>]+href=[\"']?https?://"
    r"|@import[^;]*https?://|url\([\"']?https?://"
)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)],
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return folder


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
