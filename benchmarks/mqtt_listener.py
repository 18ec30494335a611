"""Somebody on a broker who counts what comes and how old it is; a process of its own for `mqtt_door.py`.

    python benchmarks/mqtt_listener.py PORT PREFIX

Each line on its standard input is answered with what it has seen since the one before.
"""

from __future__ import annotations

import json
import sys
import threading
import time
from typing import Any

import paho.mqtt.client as mqtt
from paho.mqtt.enums import CallbackAPIVersion


class Counts:
    """What was seen since it was last asked for."""

    def __init__(self) -> None:
        self._guard = threading.Lock()
        self._ages: list[float] = []
        self._historical, self._last_row, self._disorder, self._messages = 0, 0, 0, 0

    def take(self, topic: str, payload: bytes) -> None:
        """Take a message."""
        now = time.time()
        if topic.endswith("/historical"):
            # Only its beginning is read: a listener that falls behind would see old live values.
            content = json.loads(payload[: payload.index(b',"values"')] + b"}")
            with self._guard:
                self._messages += 1
                self._disorder += content["first_row"] <= self._last_row
                self._last_row = content["last_row"]
                self._historical += payload.count(b'{"drive":')
        elif "/bridge/" not in topic and not topic.endswith("/availability"):
            content = json.loads(payload)
            values = content.values() if topic.endswith("/values") else [content]
            with self._guard:
                self._messages += 1
                self._ages += [now - each["time_s"] for each in values if "repeated" not in each]

    def told(self) -> dict[str, Any]:
        """Return it, and begin anew."""
        with self._guard:
            ages, self._ages = sorted(self._ages), []
            historical, self._historical = self._historical, 0
            messages, self._messages = self._messages, 0
            found = {"live": len(ages), "historical": historical, "messages": messages, "disorder": self._disorder}
        if ages:
            found |= {"p50_s": ages[len(ages) // 2], "p99_s": ages[int(0.99 * len(ages))], "longest_s": ages[-1]}
        return found


def main() -> None:
    """Count until standard input ends."""
    counts, ready = Counts(), threading.Event()
    client = mqtt.Client(CallbackAPIVersion.VERSION2)
    client.on_message = lambda _client, _data, message: counts.take(message.topic, message.payload)
    client.on_subscribe = lambda *_: ready.set()
    client.connect("127.0.0.1", int(sys.argv[1]))
    client.loop_start()
    client.subscribe(f"{sys.argv[2]}/#", qos=1)
    ready.wait(10)
    print("ready", flush=True)
    for _ in sys.stdin:
        print(json.dumps(counts.told()), flush=True)
    client.loop_stop()


if __name__ == "__main__":
    main()
