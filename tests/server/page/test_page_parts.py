"""Parts of the page: drives by area, trends of several drives, the drive's own fault log, and accessibility."""

import os
import re
import time
from pathlib import Path

import pytest

pytest.importorskip("playwright.sync_api", reason="the page is tested with playwright")

from playwright.sync_api import expect

pytestmark = [pytest.mark.browser, pytest.mark.soak]

PLACES = ("#/", "#/drive/fan", "#/drive/mixer", "#/trends", "#/events", "#/alarms", "#/account")


def headings(page):
    page.wait_for_selector(".tile")
    return page.locator(".area:visible > h2").all_text_contents()


def fault(value, text):
    return {"place": 1, "value": value, "text": text, "time_s": time.time()}


def test_page_groups_drives_by_line_if_no_drive_has_a_group(shown):
    page = shown()
    assert headings(page) == ["hall", "yard"]
    assert page.locator(".area").first.locator("h3").all_text_contents() == ["pump", "mixer"]


def test_page_groups_drives_by_their_first_group(page_server, shown):
    page_server.drives["pump"]["groups"] = ["water", "hall 2"]
    page_server.drives["mixer"]["groups"] = ["water"]
    page = shown()
    assert headings(page) == ["water", "Without a group"]


def test_page_hides_an_area_without_matching_drives(page_server, shown):
    page_server.trip("fan", 14, "earth fault")
    page = shown()
    page.get_by_role("button", name="fault").click()
    expect(page.locator(".area:visible > h2")).to_have_text(["yard"])


def test_page_shows_the_fault_log_without_empty_or_repeated_entries(page_server, shown):
    page_server.drives["fan"]["fault_log"] = [
        fault("14", "earth fault"), fault("14", "earth fault"), fault("4", "mains phase loss"), fault("0", ""),
    ]  # fmt: skip
    page = shown("#/drive/fan")
    table = page.get_by_role("table", name="The drive's own fault log")
    expect(table.locator("tbody tr")).to_have_text(
        [re.compile("earth fault *14 *2"), re.compile("mains phase loss *4 *1")]
    )
    page.evaluate("location.hash = '#/drive/pump'")
    expect(page.get_by_role("heading", name="pump")).to_be_visible()
    expect(table).to_be_hidden()


class TestTrendsOfSeveralDrives:
    def test_chart_follows_the_values_of_the_selected_drives(self, page_server, shown):
        page = shown("#/trends")
        chart = page.locator(".chart")
        expect(chart).to_have_attribute(
            "aria-label", re.compile("output frequency: pump 0.00 Hz, fan 0.00 Hz, mixer 0.00 Hz")
        )
        page_server.move("pump", "output_frequency", "32.00")
        expect(chart).to_have_attribute("aria-label", re.compile("pump 32.00 Hz"))
        page.get_by_role("checkbox", name="fan").uncheck()
        expect(chart).to_have_attribute("aria-label", re.compile("pump 32.00 Hz, mixer 0.00 Hz"))
        expect(page.locator(".drive-choice svg")).to_have_count(2)

    def test_selecting_another_value_shows_all_drives_that_have_it(self, page_server, shown):
        del page_server.drives["fan"]["read"]["output_current"]
        page = shown("#/trends")
        page.get_by_label("Value", exact=True).select_option("output_current")
        expect(page.locator(".drive-choice label")).to_have_count(2)
        expect(page.locator(".chart")).to_have_attribute(
            "aria-label", re.compile("output current: pump 0.0 A, mixer 0.0 A")
        )

    def test_number_of_selected_drives_is_limited_by_distinct_colours(self, page_server, shown):
        page_server.drives = {f"drive{n}": page_server._drive(f"drive{n}", n) for n in range(9)}
        page = shown("#/trends")
        for number in (4, 5):
            page.get_by_role("checkbox", name=f"drive{number}").check()
        expect(page.get_by_role("checkbox", name="drive6")).to_be_disabled()
        page.get_by_role("checkbox", name="drive0").uncheck()
        expect(page.get_by_role("checkbox", name="drive6")).to_be_enabled()


@pytest.fixture(scope="module")
def axe():
    """Return the accessibility checker axe-core as a script; skip the test without it."""
    file = Path(os.environ.get("DRIVECOMM_NODE_MODULES", "")) / "axe-core" / "axe.min.js"
    if not file.is_file():
        pytest.skip("axe-core is not in DRIVECOMM_NODE_MODULES")
    return file.read_text(encoding="utf-8")


@pytest.mark.foreign
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", [(1280, 900), (390, 844)])
def test_accessibility_checker_reports_no_violation_with_forty_drives(axe, page_server, shown, scheme, size):
    names = ["fan", "mixer", *(f"drive{number}" for number in range(38))]
    page_server.drives = {name: page_server._drive(name, number) for number, name in enumerate(names)}
    page_server.drives["fan"]["fault_log"] = [fault("14", "earth fault")]
    page_server.trip("fan", 14, "earth fault")
    page_server.silence("mixer")
    page_server.alarm("fan", "fan has tripped")
    page = shown(viewport={"width": size[0], "height": size[1]}, color_scheme=scheme)
    for place in PLACES:
        page.evaluate(f"location.hash = '{place}'")
        page.wait_for_timeout(300)
        page.evaluate(axe)
        found = page.evaluate("async () => (await axe.run()).violations.map((v) => [v.id, v.impact, v.nodes[0].html])")
        assert found == [], place
        assert page.evaluate("document.documentElement.scrollWidth") == size[0], place
