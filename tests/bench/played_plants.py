"""Played plants on a broker: each publishes increasing values, and knows which of them the broker has acknowledged."""

import json
import threading
import time
from contextlib import contextmanager

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion

QUANTITIES = ("output_frequency", "output_current")
MOST_WAITING = 2000
"""Most messages that wait for a broker before `publishing` pauses."""


class PlayedPlants:
    """Plants that publish once per period on one connection; unacknowledged messages are resent after a loss."""

    def __init__(self, url, plants, drives, *, version="5", together=True):
        host, _, port = url.removeprefix("mqtt://").partition(":")
        self.published = 0
        self.events = 0
        self._names = [f"plant {number}" for number in range(plants)]
        self._drives, self._together = drives, together
        self._count = 0
        self._client = paho.Client(
            CallbackAPIVersion.VERSION2,
            client_id="plants",
            protocol=paho.MQTTv5 if version == "5" else paho.MQTTv311,
        )
        self._sent = self._taken = 0
        self._client.on_publish = self._on_publish
        self._client.max_inflight_messages_set(100)
        self._client.max_queued_messages_set(0)
        self._client.reconnect_delay_set(1, 1)
        self._client.connect(host, int(port))
        self._client.loop_start()

    def publish(self, start_ms=None):
        """Publish a value of each quantity, and an event of each plant."""
        self._count += 1
        time_ms = (round(time.time() * 1000) if start_ms is None else start_ms) + self._count
        for plant in self._names:
            below = f"drivecomm/{plant.replace(' ', '%20')}"
            for drive in range(self._drives):
                said = {
                    name: {"value": self._count, "unit": "Hz", "quality": "good", "time_s": time_ms / 1000}
                    for name in QUANTITIES
                }
                if self._together:
                    self._send(f"{below}/drive{drive}/values", said)
                else:
                    for name, each in said.items():
                        self._send(f"{below}/drive{drive}/{name}", each)
                self.published += len(said)
            event = {"number": self._count, "time_s": time_ms / 1000, "kind": "state", "text": "runs"}
            self._send(f"{below}/bridge/event", event)
            self.events += 1

    def say_that_one_is_there(self):
        """Announce a further plant that publishes neither values nor events."""
        self._send("drivecomm/further/bridge/state", {"state": "online"})

    def _send(self, topic, content):
        # A message published while the broker is away waits for it.
        self._client.publish(topic, json.dumps(content), qos=1)
        self._sent += 1

    def _on_publish(self, *_):
        self._taken += 1

    @property
    def backlog(self):
        """Number of messages that the broker has not taken yet."""
        return self._sent - self._taken

    def taken(self, seconds=60.0):
        """Wait until the broker has acknowledged all messages. seconds: longest time without any acknowledgement."""
        before, end = self._taken, time.monotonic() + seconds
        while self._taken < self._sent:
            if self._taken != before:
                before, end = self._taken, time.monotonic() + seconds
            assert time.monotonic() < end, "the broker does not take what is published"
            time.sleep(0.05)

    def close(self):
        self._client.disconnect()
        self._client.loop_stop()


@contextmanager
def played_plants(url, plants=3, drives=2, **kind):
    """Run played plants; yield them."""
    played = PlayedPlants(url, plants, drives, **kind)
    try:
        yield played
    finally:
        played.close()


@contextmanager
def publishing(played, period_s=0.02):
    """Publish periodically during the block, then wait until the broker has acknowledged everything."""
    end = threading.Event()

    def publish():
        while not end.wait(period_s):
            # A broker that stores each message on the disk may take fewer than are published.
            if played.backlog < MOST_WAITING:
                played.publish()

    thread = threading.Thread(target=publish, daemon=True)
    thread.start()
    try:
        yield
    finally:
        end.set()
        thread.join(10)
    played.taken()
