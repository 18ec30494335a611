"""Every value of the history reaches the broker despite failures: once live, or marked as historical."""

import json
import os
import signal
import socket
import subprocess
import threading
import time
from collections import Counter
from contextlib import contextmanager, suppress
from itertools import pairwise
from pathlib import Path

import pytest
from mosquitto import mosquitto, needs_mosquitto
from processes import QUICK, serving

from drivecomm.client import parsed
from drivecomm.server.history import History

pytestmark = [needs_mosquitto, pytest.mark.skipif(os.name != "posix", reason="signals and unix sockets are POSIX's")]

DOOR = """
[[door]]
kind = "mqtt"
broker = "mqtt://127.0.0.1:{port}"
prefix = "hall"
messages = "{messages}"
"""
HISTORY = QUICK + 'history = {{ file = "{file}" }}\n'


class Cable:
    """Proxy between a server and its broker. When it is cut, only the server loses the broker, not the listener."""

    def __init__(self, port):
        self._port, self._pairs, self._whole = port, [], True
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port = self._listening.getsockname()[1]
        self._threads = []
        self._begin(self._accept)

    def _begin(self, what, *ends):
        self._threads.append(threading.Thread(target=what, args=ends, daemon=True))
        self._threads[-1].start()

    def _accept(self):
        with suppress(OSError):
            while True:
                one, _ = self._listening.accept()
                if not self._whole:
                    one.close()
                    continue
                other = socket.create_connection(("127.0.0.1", self._port))
                self._pairs.append((one, other))
                for ends in ((one, other), (other, one)):
                    self._begin(self._carry, *ends)

    def _carry(self, source, target):
        with suppress(OSError):
            while data := source.recv(1 << 16):
                target.sendall(data)
        for end in (source, target):
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
        source.close()

    @contextmanager
    def cut(self):
        self._whole = False
        for pair in self._pairs:
            for end in pair:
                with suppress(OSError):
                    end.shutdown(socket.SHUT_RDWR)
        self._pairs.clear()
        try:
            yield
        finally:
            self._whole = True

    def close(self):
        # Closing a socket does not wake a thread that waits in accept; shutting it down does.
        with suppress(OSError):
            self._listening.shutdown(socket.SHUT_RDWR)
        self._listening.close()
        with self.cut():
            for thread in self._threads:
                thread.join(5)


class Listener:
    """Mosquitto's own client, whose output goes to a file."""

    def __init__(self, broker, file):
        self._file = file
        with file.open("wb") as out:
            self.process = subprocess.Popen(
                ["mosquitto_sub", "-p", str(broker.port), "-t", "hall/#", "-q", "1", "-R", "-F", "%t\t%p"], stdout=out
            )

    def end(self):
        self.process.kill()
        self.process.wait()

    def messages(self):
        text = self._file.read_text()
        lines = text[: text.rfind("\n") + 1].splitlines()
        return [(topic, parsed(payload)) for topic, _, payload in (line.partition("\t") for line in lines) if payload]

    def live(self):
        """Return drive, name and time of each live value in order of arrival, without repetitions."""
        found = []
        for topic, content in self.messages():
            _, drive, *rest = topic.split("/")
            if drive == "bridge" or rest[-1:] in (["availability"], ["drift"]):
                continue
            values = content if rest == ["values"] else {rest[0]: content}
            found += [
                (drive, name, round(each["time_s"] * 1000)) for name, each in values.items() if not each.get("repeated")
            ]
        return found

    def historical(self):
        """Return drive, name and time of each historical value in order of arrival."""
        return [
            (each["drive"], each["name"], round(each["time_s"] * 1000))
            for topic, content in self.messages()
            if topic == "hall/bridge/historical"
            for each in content["values"]
        ]


def rows_of(file):
    with History(file) as history:
        return [(each.row, (each.drive, each.name, round(each.time_s * 1000))) for each in history.since(0)]


def in_order(keys):
    last = {}
    for drive, name, time_ms in keys:
        if time_ms <= last.get((drive, name), 0):
            return False
        last[drive, name] = time_ms
    return True


@contextmanager
def published(tmp_path, messages="quantities"):
    """Yield a server, the cable to its broker, and a listener on the broker."""
    with mosquitto(tmp_path / "broker", "max_queued_messages 0") as broker:
        cable = Cable(broker.port)
        listener = Listener(broker, tmp_path / "heard.txt")
        time.sleep(0.3)
        head = HISTORY.format(file=tmp_path / "history.sqlite")
        try:
            with serving(tmp_path, head=head, tail=DOOR.format(port=cable.port, messages=messages)) as served:
                served.until(lambda: len(listener.live()) > 20)
                yield served, cable, listener
        finally:
            listener.end()
            cable.close()


def compare(tmp_path, served, listener):
    """Check that every value read until now was received; return the rows, and the live and historical values."""
    state = next(Path(served.environment["STATE_DIRECTORY"]).glob("*/mqtt-*.json"))
    until_row = rows_of(tmp_path / "history.sqlite")[-1][0]
    served.until(lambda: json.loads(state.read_text())["row"] >= until_row, 20)
    live, historical = listener.live(), listener.historical()
    rows = [key for row, key in rows_of(tmp_path / "history.sqlite") if row <= until_row]
    missing = set(rows) - set(live) - set(historical)
    assert not missing, (len(missing), len(rows), sorted(missing)[:5])
    # A value that is sent twice is marked as historical the second time.
    assert max(Counter(live).values()) == 1
    assert in_order(live)
    return rows, live, historical


@pytest.mark.soak
@pytest.mark.parametrize("messages", ["quantities", "drives"])
def test_values_missed_without_a_broker_follow_in_order(tmp_path, messages):
    with published(tmp_path, messages) as (served, cable, listener):
        with cable.cut():
            time.sleep(2)
        cut = len(listener.live())
        served.until(lambda: len(listener.live()) > cut + 20 and listener.historical(), 15)
        _, live, historical = compare(tmp_path, served, listener)
        assert in_order(historical)
        # Only values in flight when the cable was cut may arrive twice.
        assert len(historical) >= 20
        twice = set(live) & set(historical)
        assert len(twice) <= 40, (len(twice), len(historical), len(live))


@pytest.mark.soak
def test_no_value_is_missing_after_kills_with_and_without_a_broker(tmp_path):
    with published(tmp_path) as (served, cable, listener):
        for _ in range(2):
            time.sleep(3)
            served.start()
        with cable.cut():
            time.sleep(2)
            # The server is killed and restarted without a broker.
            served.start()
            time.sleep(3)
            served.process.send_signal(signal.SIGKILL)
            served.process.wait()
        served.start()
        before = len(listener.live())
        served.until(lambda: len(listener.live()) > before + 20, 20)
        rows, live, historical = compare(tmp_path, served, listener)
        # Each run publishes in the order of the history; a killed run's unfinished batch is repeated by the next run.
        back = sum(later[2] < earlier[2] - 1000 for earlier, later in pairwise(historical))
        assert back <= 4, back
        assert len(rows) > 200
        assert len(set(live)) < len(rows)


@pytest.mark.soak
def test_killed_broker_loses_no_value_and_gets_the_latest_ones_again(tmp_path):
    """The broker loses its retained messages; a later subscriber finds the latest values again."""
    with mosquitto(tmp_path / "broker") as broker:
        head = HISTORY.format(file=tmp_path / "history.sqlite")
        with serving(tmp_path, head=head, tail=DOOR.format(port=broker.port, messages="quantities")) as served:
            time.sleep(2)
            with broker.away():
                time.sleep(2)
            listener = Listener(broker, tmp_path / "heard.txt")
            try:
                served.until(lambda: any(topic == "hall/bridge/state" for topic, _ in listener.messages()), 6)
                served.until(listener.historical, 10)
                topics = {topic for topic, _ in listener.messages()}
                wanted = {"hall/fan/availability", "hall/pump/status", "hall/fan/output_frequency", "hall/bridge/info"}
                assert wanted <= topics
                assert in_order(listener.historical())
            finally:
                listener.end()
