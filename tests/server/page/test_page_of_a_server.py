"""The page on a real server over a virtual plant, from signing in to the end of the server."""

import asyncio
import os
import re
import signal
import socket
import threading
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

pytest.importorskip("playwright.sync_api", reason="the page is tested with playwright")

from playwright.sync_api import expect

from drivecomm.plant import read_plant
from drivecomm.server import Role, Serving, User, add_user, password_hash
from drivecomm.testing import ServingThread
from drivecomm.virtual import ControlClient, PlantServer, VirtualPlant

pytestmark = [pytest.mark.browser, pytest.mark.soak]

SLOW_MS = 15000
PLANT = """\
format = 1
[server]
name = "hall 2"
status_period_s = 0.2
users = "users.toml"
audit = "audit.jsonl"
history = {{ file = "history.sqlite" }}
[[door]]
kind = "http"
listen = "127.0.0.1:{port}"
[[line]]
name = "hall"
listen = "tcp:127.0.0.1:0"
[[drive]]
name = "pump"
title = "feed pump"
drive = "danfoss-fc:3"
options = {{ model = "fc302" }}
armed = true
link_loss = {{ policy = "ramp", watchdog_s = 5 }}
poll = [{{ parameters = ["output_frequency"], period_s = 0.2 }}]
network = {{ http = ["start", "reset", "reference"] }}
motor = {{ ramp_up_s = 1, ramp_down_s = 1 }}
[[alarm]]
name = "tripped"
on = "fault"
"""

RESET_ENDED = re.compile("pump: reset the fault.*because a stop went first|Donepump: reset the fault")


class RealServer:
    """A server in one thread, over virtual drives in another."""

    def __init__(self, folder, port):
        self.url = f"http://127.0.0.1:{port}/"
        self.file = folder / "plant.toml"
        self.file.write_text(PLANT.format(port=port))
        user = User(name="asha", role=Role.OPERATE, password=password_hash("a long password"))
        add_user(folder / "users.toml", user)
        self.serving = None

    def start(self, addresses):
        self.serving = Serving(self.file, port_of=lambda line: addresses[line.name])
        ready = threading.Event()
        self._thread = threading.Thread(
            target=lambda: asyncio.run(self.serving.run(lambda _: ready.set())), daemon=True
        )
        self._thread.start()
        assert ready.wait(15)

    def stop(self):
        self.serving.end()
        self._thread.join(15)


@contextmanager
def simulated(plant):
    server = PlantServer(VirtualPlant(plant), control="127.0.0.1:0")
    thread = ServingThread(server)
    try:
        with ControlClient(server.control) as control:
            yield server.addresses, control
    finally:
        thread.close()


@pytest.fixture
def page_server(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    return RealServer(tmp_path, port)


def test_page_works_from_signing_in_to_the_end_of_the_server(page_server, shown):
    with simulated(read_plant(page_server.file)) as (addresses, control):
        page_server.start(addresses)
        try:
            story(page_server, shown, control)
        finally:
            page_server.stop()


def story(page_server, shown, control):
    page = shown("#/account", live=False)
    expect(page.get_by_text("This plant is shown to its users only.")).to_be_visible(timeout=SLOW_MS)
    page.get_by_label("Name").fill("asha")
    page.get_by_role("textbox", name="Password").fill("a long password")
    page.get_by_role("button", name="Sign in", exact=True).click()
    page.wait_for_selector("html[data-link=live]", timeout=SLOW_MS)
    page.get_by_role("link", name="Plant", exact=True).click()
    pump = page.get_by_role("listitem", name="pump", exact=True)
    expect(pump).to_contain_text("ready")
    expect(pump).to_contain_text("0.0Hz")
    pump.get_by_role("link", name="pump").click()

    page.get_by_role("button", name="Take control").click()
    expect(page.get_by_text("You have control of this drive")).to_be_visible()
    page.get_by_label("Reference", exact=True).fill("50")
    page.get_by_role("button", name="Set", exact=True).click()
    expect(page.get_by_role("log")).to_contain_text("Donepump: reference 50 %")
    page.get_by_role("button", name="Start…").click()
    page.get_by_role("radio", name=re.compile("^ramp")).check()
    page.get_by_role("button", name="Start pump now").click()
    bar = page.locator(".drive-bar")
    expect(bar).to_contain_text("running", timeout=SLOW_MS)
    expect(page.get_by_role("row", name="Output frequency")).to_contain_text("25.0", timeout=SLOW_MS)
    expect(bar).to_contain_text("you command it")

    control.order("trip", drive="pump", code=14)
    expect(bar).to_contain_text("fault", timeout=SLOW_MS)
    expect(page.locator(".fault-box")).to_contain_text("earth fault")
    expect(page.locator(".event-list")).to_contain_text("earth fault")
    expect(page.locator("#alarm-count")).to_have_text("1", timeout=SLOW_MS)
    for _ in range(3):
        page.get_by_role("button", name="Reset the fault").click()
        expect(page.get_by_role("log")).to_contain_text(RESET_ENDED, timeout=SLOW_MS)
        # The server stops a kept motor that trips; on a slow machine that stop may overtake the reset.
        if "because a stop went first" not in page.get_by_role("log").inner_text():
            break
    expect(page.get_by_role("log")).to_contain_text("Donepump: reset the fault", timeout=SLOW_MS)
    expect(bar).to_contain_text("ready", timeout=SLOW_MS)

    control.order("power", drive="pump", state="off")
    expect(bar).to_contain_text("no answer", timeout=SLOW_MS)
    control.order("power", drive="pump", state="on")
    expect(bar).to_contain_text("ready", timeout=SLOW_MS)
    page.get_by_role("button", name="Stop pump").click()
    expect(page.get_by_role("log")).to_contain_text("Donepump: stop")

    page.get_by_role("link", name="Alarms").click()
    page.get_by_role("button", name="Acknowledge").click()
    expect(page.get_by_text("acknowledged by asha")).to_be_visible()
    page.go_back()

    page_server.serving.end()
    expect(page.locator("#banner")).to_contain_text("No connection since", timeout=SLOW_MS)
    expect(bar).to_contain_text("was ready")


def test_policy_acts_on_the_motor_of_a_killed_browser(page_server, launched):
    """A killed browser no longer renews its lease, like any other client."""
    mark = f"killed-{os.getpid()}"
    with simulated(read_plant(page_server.file)) as (addresses, control):
        page_server.start(addresses)
        try:
            page = launched(DRIVECOMM_TEST=mark).new_page()
            page.goto(f"{page_server.url}#/account", wait_until="domcontentloaded")
            page.get_by_label("Name").fill("asha")
            page.get_by_role("textbox", name="Password").fill("a long password")
            page.get_by_role("button", name="Sign in", exact=True).click()
            page.wait_for_selector("html[data-link=live]", timeout=SLOW_MS)
            page.get_by_role("link", name="Plant", exact=True).click()
            page.get_by_role("listitem", name="pump", exact=True).get_by_role("link", name="pump").click()
            page.get_by_role("button", name="Take control").click()
            page.get_by_label("Reference", exact=True).fill("50")
            page.get_by_role("button", name="Set", exact=True).click()
            page.get_by_role("button", name="Start…").click()
            page.get_by_role("radio", name=re.compile("^ramp")).check()
            page.get_by_role("button", name="Start pump now").click()
            expect(page.locator(".drive-bar")).to_contain_text("running", timeout=SLOW_MS)
            assert running(control)
            kill_marked(mark)
            killed = time.monotonic()
            # The limit is the longest lease plus the time of a ramp.
            while running(control):
                assert time.monotonic() < killed + 35
                time.sleep(0.1)
            told = [event.text for event in page_server.serving._core.table.events() if event.kind == "link loss"]
            assert any("did not renew the lease; the motor is released by its policy, ramp" in text for text in told)
            time.sleep(2)
            assert not running(control)
        finally:
            page_server.stop()


def running(control):
    return control.order("show")["drives"][0]["running"]


def kill_marked(mark):
    """Kill all processes that have this mark in their environment."""
    found = []
    for each in Path("/proc").iterdir():
        with suppress(OSError):
            if each.name.isdigit() and f"DRIVECOMM_TEST={mark}".encode() in (each / "environ").read_bytes().split(
                b"\0"
            ):
                found.append(int(each.name))
    assert found
    for process in found:
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)
