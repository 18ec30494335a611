"""A fleet of real servers behind a real broker, in a terminal, as JSON and as a page, also with parts missing."""

import asyncio
import json
import threading
import time
import urllib.error
import urllib.request
from contextlib import closing, contextmanager
from functools import partial
from hashlib import sha256

import pytest
from mosquitto import mosquitto, needs_mosquitto
from running_server import running_server

from drivecomm.cli import main
from drivecomm.plant import read_plant
from drivecomm.server import ListenAddress
from drivecomm.server.broker import broker_settings
from drivecomm.server.fleet import Fleet, FleetSubscription, RecordPages, fleet_page
from drivecomm.server.record import open_record
from drivecomm.server.record.messages import RecordedSample, StandingAlarm, StandingAlarms
from drivecomm.server.record.writer import Writer
from drivecomm.testing import ServingThread
from drivecomm.tomlfile import TomlTable
from drivecomm.version import __version__
from drivecomm.virtual import PlantServer, VirtualPlant

PLANT = """\
format = 1
[server]
name = "{name}"
status_period_s = 0.1
history = false
[[door]]
kind = "mqtt"
broker = "{broker}"
[[line]]
name = "hall"
listen = "{listen}"
paced = false
[[drive]]
name = "pump"
title = "feed pump"
drive = "vabus:1"
line = "hall"
options = {{ model = "agile" }}
poll = [{{ parameters = ["output_frequency"], period_s = 0.1 }}]
"""

pytestmark = [needs_mosquitto, pytest.mark.soak]


@pytest.fixture(autouse=True)
def own_state(tmp_path, monkeypatch):
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))


@pytest.fixture
def broker(tmp_path):
    with mosquitto(tmp_path / "broker") as running:
        yield running


@contextmanager
def served(folder, name, broker):
    """Serve a plant with one virtual drive, which publishes its state to the broker."""
    virtual = folder / f"virtual-{name}.toml"
    virtual.write_text(PLANT.format(name=name, broker=broker.url, listen="tcp:127.0.0.1:0"))
    server = PlantServer(VirtualPlant(read_plant(virtual)), control="127.0.0.1:0")
    with closing(ServingThread(server)):
        own = folder / f"{name}.toml"
        listen = f"tcp:{server.addresses['hall'].partition('://')[2]}"
        own.write_text(PLANT.format(name=name, broker=broker.url, listen=listen))
        with running_server(own) as plant:
            yield plant


def soon(condition, seconds=15.0):
    end = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < end, "the condition did not become true"
        time.sleep(0.05)
    return found


@pytest.fixture
def run(capsys):
    def run(*arguments):
        code = main(["fleet", *arguments])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return run


def test_fleet_command_lists_plants_and_their_drives(tmp_path, broker, run):
    assert run(broker.url)[0] == 4
    with served(tmp_path, "mill", broker), served(tmp_path, "quarry", broker):

        def both():
            code, out, _ = run(broker.url, "--json")
            plants = [json.loads(line) for line in out.splitlines()]
            return plants if code == 0 and len(plants) == 2 and all(each["read_s"] for each in plants) else None

        plants = soon(both)
        assert [(each["name"], each["gateway"], each["drives"], each["answering"]) for each in plants] == [
            ("mill", "online", 1, 1),
            ("quarry", "online", 1, 1),
        ]
        _, out, _ = run(broker.url)
        head, mill, *_ = out.splitlines()
        assert head.split() == [
            *("plant", "server", "drives", "answer", "running", "faults", "silent", "alarms", "read"),
            *("version", "file", "file", "read"),
        ]
        assert __version__ in mill
        assert sha256((tmp_path / "mill.toml").read_bytes()).hexdigest()[:8] in mill
        assert out.splitlines()[-1] == "2 of 2 plants connected, 2 drives"
        code, out, _ = run(broker.url, "quarry")
        assert code == 0
        assert out.splitlines()[1].split()[:2] == ["pump", "agile"]
    code, out, _ = run(broker.url, "mill")
    assert code == 4
    assert "so the state of its drives is not known" in out


def test_fleet_command_reports_unknown_plant_and_missing_broker(broker, run):
    code, _, err = run(broker.url, "mill")
    assert code == 2
    assert "no plant 'mill' below drivecomm" in err
    code, _, err = run("mqtt://127.0.0.1:1")
    assert code == 3
    assert "cannot be reached" in err
    code, _, err = run("mqtt://broker.example.com")
    assert code == 2
    assert "insecure" in err
    code, _, err = run(broker.url, "--listen", "8090")
    assert code == 2
    assert "127.0.0.1:8090" in err


@contextmanager
def page(broker, past=None):
    """Serve the page of a fleet in a thread; yield a function that requests a path."""
    listening = ListenAddress("127.0.0.1", 0).open()
    place = f"http://127.0.0.1:{listening.getsockname()[1]}"
    opened, loops = threading.Event(), []

    async def serve():
        table = {"broker": broker.url}
        following = FleetSubscription(broker_settings(TomlTable(table, "here"), table), Fleet())
        loops.append((asyncio.get_running_loop(), asyncio.current_task()))
        hearing = asyncio.create_task(following.run())
        try:
            await fleet_page(following, listening, opened.set, past)
        finally:
            hearing.cancel()

    def run():
        with pytest.raises(asyncio.CancelledError):
            asyncio.run(serve())

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    assert opened.wait(10)

    def ask(path, **headers):
        with urllib.request.urlopen(urllib.request.Request(place + path, headers=headers), timeout=5) as answer:
            return answer.read(), answer.headers

    try:
        yield ask
    finally:
        loop, task = loops[0]
        loop.call_soon_threadsafe(task.cancel)
        thread.join(10)


def test_fleet_page_follows_the_broker_and_reports_its_loss(tmp_path, broker):
    with page(broker) as ask, served(tmp_path, "mill", broker):

        def plants():
            content = json.loads(ask("/plants")[0])
            return content if content["plants"] and content["plants"][0]["answering"] else None

        assert soon(plants)["plants"][0]["gateway"] == "online"

        def titled():
            drives = json.loads(ask("/plants/mill")[0])["list"]
            # The titles of drives arrive a little later than their names.
            return drives if all(drive["title"] for drive in drives) else None

        drives = soon(titled)
        assert [(drive["name"], drive["title"], drive["answers"]) for drive in drives] == [("pump", "feed pump", True)]
        with broker.away():
            gone = soon(lambda: (found := json.loads(ask("/plants")[0]))["problem"] and found)
            assert gone["plants"][0]["gateway"] == "unknown"
            assert gone["plants"][0]["answering"] == 0
        soon(
            lambda: (
                not (found := json.loads(ask("/plants")[0]))["problem"] and found["plants"][0]["gateway"] == "online"
            )
        )


def test_page_shows_alarms_and_trends_from_a_record(tmp_path, broker):
    open_it = partial(open_record, str(tmp_path / "record.sqlite"))
    alarm = StandingAlarm("a-1", "tripped", "pump", "fault <14>", 5000, None, 1, "", None)
    now_ms = round(time.time() * 1000)
    with closing(open_it()) as database:
        values = [
            RecordedSample(
                "mill", "pump", "output_frequency", now_ms - 1000 * each, str(each), None, "Hz", "good", "", "", None
            )
            for each in range(0, 3600, 60)
        ]
        Writer(database).write([StandingAlarms("mill", (alarm,)), *values])
    with page(broker, RecordPages(open_it)) as ask:
        assert json.loads(ask("/plants")[0])["has_record"] is True
        (shown,) = json.loads(ask("/alarms")[0])["alarms"]
        assert (shown["plant"], shown["text"], shown["ended_s"]) == ("mill", "fault <14>", None)
        picture, headers = ask("/plants/mill/pump/output_frequency/trend.svg")
        assert headers["Content-Type"] == "image/svg+xml"
        assert picture.startswith(b"<svg")
        assert b"up to 35" in picture
        for path in ("/plants/mill/pump/speed/trend.svg", "/plants/quarry/pump/output_frequency/trend.svg"):
            with pytest.raises(urllib.error.HTTPError) as missing:
                ask(path)
            assert missing.value.code == 404
            missing.value.close()


def test_fleet_page_without_a_record_has_no_alarms(broker):
    with page(broker) as ask:
        assert json.loads(ask("/plants")[0])["has_record"] is False
        with pytest.raises(urllib.error.HTTPError) as missing:
            ask("/alarms")
        assert missing.value.code == 404
        missing.value.close()


def test_fleet_page_serves_its_files_and_refuses_foreign_origins(broker):
    with page(broker) as ask:
        text, headers = ask("/")
        assert b"drivecomm fleet" in text
        assert "default-src 'self'" in headers["Content-Security-Policy"]
        assert b"plantsPage" in ask("/fleet/fleet.js")[0]
        assert ask("/page/themes.css")[0]
        for headers in ({"Host": "evil.example"}, {"Origin": "http://evil.example"}):
            with pytest.raises(urllib.error.HTTPError) as refused:
                ask("/plants", **headers)
            assert refused.value.code == 403
            refused.value.close()
        with pytest.raises(urllib.error.HTTPError) as missing:
            ask("/plants/mill")
        assert missing.value.code == 404
        missing.value.close()
