"""The page of supported drives has a row for every model, with cells that match the content of the model."""

import re

import pytest
from pages import ROOT
from supported_drives_page import MARK, NEVER_TRIED, PLACE, supported_drives

from drivecomm.models import load_model, model_names
from drivecomm.protocol import installed

GAUGE = """
format = 1
protocol = "modbus"
name = "gauge"
title = "Gauge drives"
source = "manual G-1 p. 3"
[identified_by]
product = "G.*"
[faults]
1 = "stuck"
[sources]
status = ["manual G-1 p. 9", "a program"]
[control.status]
running = ["1", 1, 1]
[[parameter]]
address = "1"
name = "state"
access = "r"
second_source = "a program"
[[parameter]]
address = "2"
name = "ramp"
sure = "derived"
"""


def rows(text):
    """Return the cells of each table row, by protocol and model."""
    found = {}
    for section in re.split(r"^## ", text, flags=re.MULTILINE)[1:]:
        protocol = re.search(r"Protocol `([^`]+)`", section)[1]
        for line in section.splitlines():
            cells = [each.strip() for each in line.strip("| ").split(" | ")]
            if len(cells) == 12 and cells[1].startswith("`"):
                assert (protocol, cells[1].strip("`")) not in found
                found[protocol, cells[1].strip("`")] = cells
    return found


@pytest.fixture(scope="module")
def told():
    return rows(supported_drives(installed.working()))


def test_page_has_one_row_for_every_model(told):
    models = {(each.name, name) for each in installed.working() for name in model_names(each.package, each.name)}
    assert set(told) == models


def test_row_matches_the_content_of_its_model(told):
    for (protocol, name), cells in told.items():
        model = load_model(installed[protocol].package, protocol, name)
        series, _, read, commanded, _, faults, panel, link_loss, plate, _, sure, tried = cells
        assert series == model.title.replace("|", "\\|")
        assert read.startswith(f"{len(model.quantities)} common name")
        assert commanded.startswith(("yes", "monitoring only"))
        assert faults.split(",")[0] == str(len(model.faults))
        assert panel == (f"{len(model.setup)} setting{'s'[: len(model.setup) - 1]}" if model.setup else "no page")
        assert link_loss == ("set and read back" if model.watchdog else "a sentence" if model.link_loss else "unknown")
        assert set(plate.split(", ")) - {"not found"} == {
            each.removeprefix("motor_rated_") for each in model.quantities if each.startswith("motor_rated_")
        }
        marks = {info.sure for info in model.parameters.values()}
        assert (tried == NEVER_TRIED) is ("field" not in marks)
        assert ("unconfirmed" in sure) is ("unconfirmed" in marks)


def test_row_of_a_series_shows_that_it_is_monitoring_only(tmp_path, monkeypatch):
    monkeypatch.setenv("DRIVECOMM_MODELS", str(tmp_path))
    (tmp_path / "modbus").mkdir()
    (tmp_path / "modbus" / "gauge.toml").write_text(GAUGE, encoding="utf-8")
    assert rows(supported_drives([installed["modbus"]]))["modbus", "gauge"] == [
        "Gauge drives",
        "`gauge`",
        "0 common names, 2 parameters",
        "monitoring only",
        "1 setting",
        "1",
        "no page",
        "unknown",
        "not found",
        "product",
        "1 page, 1 derived, 1 with a second source, 2 sources of commands and status",
        NEVER_TRIED,
    ]


def test_supported_drives_page_is_linked_from_readme_and_index():
    text = (ROOT / "docs" / PLACE).read_text(encoding="utf-8")
    assert text.count(MARK) == 1
    first_screen = "\n".join((ROOT / "README.md").read_text(encoding="utf-8").splitlines()[:10])
    assert f"](docs/{PLACE})" in first_screen
    assert f"]({PLACE})" in (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    assert PLACE in (ROOT / "mkdocs.yml").read_text(encoding="utf-8")


def test_page_explains_name_plates_that_were_not_found(told):
    text = (ROOT / "docs" / PLACE).read_text(encoding="utf-8")
    assert any("not found" in cells for cells in told.values())
    assert "## Name plates that were not found" in text
    assert "](#name-plates-that-were-not-found)" in text
