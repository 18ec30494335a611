"""Model tables on the pages of protocols: common names, watchdogs, and identification rules."""

import re

import pytest
from markdown_tables import code
from protocol_pages import protocol_page

from drivecomm.models import load_model, model_names, quantities
from drivecomm.protocol import installed


@pytest.fixture(scope="module", params=[plugin.name for plugin in installed.working()])
def plugin(request):
    return installed[request.param]


def sections(page):
    """Return the part of the page about each model, by the name of the model."""
    tables = page.partition("\n## Model tables\n")[2]
    parts = re.split(r"^### .*: `([^`]+)`$", tables, flags=re.MULTILINE)[1:]
    return dict(zip(parts[::2], parts[1::2], strict=True))


def test_protocol_page_lists_common_names_with_unit_and_parameter(plugin):
    told = sections(protocol_page(plugin))
    models = {name: load_model(plugin.package, plugin.name, name) for name in model_names(plugin.package, plugin.name)}
    assert set(told) == set(models)
    shown = "".join(told.values())
    for name, model in models.items():
        for common, address in model.quantities.items():
            unit = quantities()[common].unit or " "
            row = re.compile(
                rf"^\| `{common}` \| {re.escape(unit)} \| [^|]+ \| `{re.escape(address)}` \|", re.MULTILINE
            )
            own = row.search(told[name])
            assert own or "Its common names are" in told[name] or "It has all parameters of" in told[name]
            assert row.search(shown)


def test_protocol_page_shows_watchdogs_and_identification_rules(plugin):
    told = sections(protocol_page(plugin))
    for name, text in told.items():
        model = load_model(plugin.package, plugin.name, name)
        for key, pattern in model.identified_by.items():
            assert f"{key} {code(pattern)}" in text
        if model.watchdog:
            assert f"| time, in seconds | `{model.watchdog.time}` |" in "".join(told.values())
            assert model.watchdog.source in "".join(told.values())
