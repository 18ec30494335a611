"""The page of a fleet in a browser: an overview of plants, the drives of one plant, and the warning about old data."""

import asyncio
import contextlib
import json
import socket
import threading
import time
from types import SimpleNamespace

import pytest

pytest.importorskip("playwright.sync_api", reason="the page is tested with playwright")

from playwright.sync_api import expect

from drivecomm.server.fleet import Fleet, fleet_page

pytestmark = [pytest.mark.browser, pytest.mark.soak]


class PlayedFleet:
    """A fleet whose broker is played by the test, and the thread that serves its page."""

    def __init__(self):
        self.following = SimpleNamespace(fleet=Fleet(), problem="")
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self._listening.getsockname()[1]}/"
        self._opened = threading.Event()
        self._thread = threading.Thread(target=asyncio.run, args=(self._serve(),))

    async def _serve(self):
        self._loop, self._task = asyncio.get_running_loop(), asyncio.current_task()
        with contextlib.suppress(asyncio.CancelledError):
            await fleet_page(self.following, self._listening, self._opened.set)

    def start(self):
        self._thread.start()
        assert self._opened.wait(10)

    def stop(self):
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._task.cancel)
            self._thread.join(10)

    def tell(self, plant, *drives, gateway="online"):
        """Publish the messages of a plant's server: each drive with its status."""
        listed = [{"name": name, "model": "agile"} for name, _ in drives]
        said = {
            "bridge/state": {"state": gateway, "session": "x", "plant": plant, "version": "1", "since_s": 1.5},
            "bridge/info": {"drives": listed},
        }
        for name, status in drives:
            said[f"{name}/availability"] = {"state": "online" if status else "offline"}
            if status:
                said[f"{name}/status"] = {"unit": "", "quality": "good", "time_s": time.time(), **status}
                output = {"value": 31.5, "unit": "Hz", "quality": "good", "time_s": time.time()}
                said[f"{name}/output_frequency"] = output
        for topic, content in said.items():
            self._loop.call_soon_threadsafe(
                self.following.fleet.take, f"drivecomm/{plant}/{topic}", json.dumps(content).encode()
            )


RUNNING, FAULT = {"value": "running"}, {"value": "fault", "text": "14 earth fault"}


@pytest.fixture
def played():
    fleet = PlayedFleet()
    fleet.start()
    yield fleet
    fleet.stop()


@pytest.fixture
def page(watched, played):
    return watched(played.url)


def tile(page, name):
    return page.get_by_role("list", name="Plants").get_by_role("listitem").filter(has_text=name)


def test_fleet_page_lists_plants_and_their_summaries(played, page):
    expect(page.get_by_text("No plant has published anything on this broker yet.")).to_be_visible()
    played.tell("mill", ("pump", RUNNING), ("fan", FAULT), ("mixer", None))
    played.tell("quarry", ("crusher", RUNNING), gateway="offline")
    expect(page.get_by_text("1 of 2 plants are connected")).to_be_visible()
    mill, quarry = tile(page, "mill"), tile(page, "quarry")
    expect(mill).to_contain_text("2 of 3 answer")
    expect(mill.locator("dd")).to_have_text(["1", "1", "1"])
    expect(mill).to_have_attribute("data-state", "fault")
    # The drives of a plant without a server are unknown.
    expect(quarry).to_contain_text("not connected")
    expect(quarry.locator("dd")).to_have_text(["\N{EN DASH}"] * 3)


def test_fleet_page_shows_the_drives_of_a_plant(played, page):
    played.tell("mill", ("pump", RUNNING), ("fan", FAULT), ("mixer", None))
    page.get_by_role("link", name="mill").click()
    rows = page.locator("tbody tr")
    expect(rows).to_have_count(3)
    expect(rows.nth(0)).to_contain_text("running")
    expect(rows.nth(0)).to_contain_text("31.5 Hz")
    expect(rows.nth(1)).to_contain_text("fault: 14 earth fault")
    expect(rows.nth(2)).to_contain_text("does not answer")
    expect(rows.nth(2)).not_to_contain_text("Hz")
    played.tell("mill", ("pump", RUNNING), gateway="offline")
    expect(page.get_by_text("what the drives do is not known")).to_be_visible()
    expect(rows.nth(0)).not_to_contain_text("running")
    page.get_by_role("link", name="Back to all plants").click()
    expect(tile(page, "mill")).to_be_visible()


def test_fleet_page_warns_about_old_data(played, page):
    played.tell("mill", ("pump", RUNNING))
    expect(tile(page, "mill")).to_contain_text("1 of 1 answer")
    expect(page.get_by_role("alert")).to_be_hidden()
    played.following.problem = "broker 127.0.0.1:1883: no connection"
    expect(page.get_by_role("alert")).to_contain_text("What is shown is old: broker 127.0.0.1:1883")
    played.following.problem = ""
    expect(page.get_by_role("alert")).to_be_hidden()
    played.stop()
    expect(page.get_by_role("alert")).to_contain_text("the fleet view does not answer")


def test_fleet_page_shows_names_as_plain_text(played, page):
    played.tell("<b>mill & co", ("<i>pump", RUNNING))
    page.get_by_role("link", name="<b>mill & co").click()
    expect(page.locator("tbody tr").nth(0)).to_contain_text("<i>pump")
    assert page.locator("tbody i").count() == 0
