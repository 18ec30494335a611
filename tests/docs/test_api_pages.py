"""Every name that `drivecomm` and its packages export has a docstring where it is defined."""

import api_pages
import pytest
from pages import ROOT

griffe = pytest.importorskip("griffe", reason="the reference of the API needs the extra named docs")

PAGES = [api_pages.TOP, *(f"{api_pages.TOP}.{room}" for room in api_pages.ROOMS)]


@pytest.fixture(scope="module")
def sources():
    """Return the source tree of drivecomm as mkdocstrings reads it."""
    return griffe.load("drivecomm", search_paths=[str(ROOT)])


def _described(sources, place):
    found = sources[place.partition(".")[2]]
    while found.is_alias:
        found = found.target
    assert not found.is_module, place
    return bool(found.docstring)


@pytest.mark.parametrize("page", PAGES)
def test_every_name_of_an_api_page_has_a_docstring(sources, page):
    for module in api_pages.modules_of(page):
        places = [api_pages.place_of(module, name) for name in api_pages.names_of(module)]
        assert [place for place in places if not _described(sources, place)] == [], "write a docstring below the name"
