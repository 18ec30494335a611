"""Recorder between a broker and PostgreSQL: rate of stored values, and duration of a query for one day's trend.

    python benchmarks/record.py --to postgresql://drivecomm@127.0.0.1/empty

The broker (mosquitto) and the recorder (`drivecomm fleet record`) are real, in separate processes; the plants are
played. The database must be empty.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import paho.mqtt.client as paho
import psycopg
from fleet_of_gateways import _broker, _usage
from paho.mqtt.enums import CallbackAPIVersion

from drivecomm.errors import UsageError

_BEGAN = 1_790_000_000


class _Plants:
    """Publisher of values, one message per drive in turn. given: the numbers of plants, drives and quantities."""

    def __init__(self, url: str, given: argparse.Namespace) -> None:
        self._given, self.sent, self._taken, self._round = given, 0, 0, 0
        self._client = paho.Client(CallbackAPIVersion.VERSION2, protocol=paho.MQTTv5)
        self._client.max_inflight_messages_set(1000)
        self._client.on_publish = self._on_publish
        host, _, port = url.removeprefix("mqtt://").partition(":")
        self._client.connect(host, int(port))
        self._client.loop_start()

    def _on_publish(self, *_: object) -> None:
        self._taken += 1

    def begin(self) -> None:
        """Reset the counts after the broker has taken all earlier values."""
        while self._taken * self._given.quantities < self.sent:
            time.sleep(0.01)
        self.sent = self._taken = 0

    def publish(self) -> None:
        """Publish a value of each quantity of each drive."""
        given = self._given
        self._round += 1
        for number in range(given.plants * given.drives):
            plant, drive = divmod(number, given.drives)
            time_s = _BEGAN + self._round
            one = {"value": self._round / 100, "unit": "Hz", "quality": "good", "time_s": time_s}
            said = json.dumps({f"quantity_{each}": one for each in range(given.quantities)})
            self._client.publish(f"drivecomm/plant {plant}/drive {drive}/values", said, qos=1)
            self.sent += given.quantities

    def publish_for(self, seconds: float, rate: float) -> float:
        """Publish values at this rate for some seconds; return the rate that the broker accepted."""
        began, first = time.monotonic(), self.sent
        while (now := time.monotonic() - began) < seconds:
            if self.sent - first < now * rate:
                self.publish()
            else:
                time.sleep(0.005)
        while self._taken * self._given.quantities < self.sent:
            time.sleep(0.01)
        return (self.sent - first) / (time.monotonic() - began)

    def close(self) -> None:
        """Disconnect."""
        self._client.disconnect()
        self._client.loop_stop()


def _count(record: psycopg.Connection[tuple[int]]) -> int:
    found = record.execute("SELECT count(*) FROM drivecomm.value").fetchone()
    return found[0] if found else 0


def _measure_rate(given: argparse.Namespace, folder: Path) -> None:
    with _broker(folder) as (url, _):
        command = [sys.executable, "-m", "drivecomm", "fleet", "record", "--broker", url, "--to", given.to]
        with subprocess.Popen(command) as recorder:
            try:
                plants = _Plants(url, given)
                record: psycopg.Connection[tuple[int]] = psycopg.connect(given.to, autocommit=True)
                _wait_for(record, plants)
                used = _usage(recorder.pid)[0]
                taken = plants.publish_for(given.seconds, given.rate)
                published = time.monotonic()
                while _count(record) < plants.sent:
                    if time.monotonic() - published > 10 * given.seconds:
                        raise UsageError(f"{_count(record)} of {plants.sent} values are in the record")
                    time.sleep(0.1)
                behind = time.monotonic() - published
                print(
                    f"{taken:.0f} values/s from the broker into PostgreSQL for {given.seconds:g} s, the last of them "
                    f"{behind:.1f} s later; {_count(record)} in the record, {plants.sent} published; "
                    f"{1e6 * (_usage(recorder.pid)[0] - used) / plants.sent:.0f} us of the recorder's CPU each"
                )
                plants.close()
            finally:
                recorder.terminate()


def _wait_for(record: psycopg.Connection[tuple[int]], plants: _Plants) -> None:
    """Wait until the recorder stores values."""
    end = time.monotonic() + 30
    while time.monotonic() < end:
        if record.execute("SELECT to_regclass('drivecomm.value')").fetchone() != (None,):
            plants.publish()
            time.sleep(2.0)
            if _count(record):
                # Values published before the recorder subscribed do not count.
                plants.begin()
                before = -1
                while before != (before := _count(record)):
                    time.sleep(3.0)
                record.execute("TRUNCATE drivecomm.value")
                return
        time.sleep(0.2)
    raise UsageError("the recorder does not begin")


def _measure_trend(given: argparse.Namespace) -> None:
    with psycopg.connect(given.to, autocommit=True, options="-c search_path=drivecomm") as record:
        # Insert in order of arrival; quantity 1, the one queried later, gets a value each second.
        record.execute(
            "INSERT INTO value (quantity, time, number, remark) SELECT quantity.id, "
            "'2026-06-01Z'::timestamptz + second * INTERVAL '1 s', 50 + 10 * sin(second / 600.0), 1 "
            "FROM generate_series(0, 86399) AS second JOIN quantity ON second %% %s = 0 OR quantity.id = 1 "
            "ORDER BY second",
            (given.period,),
        )
        rows = _count(record)  # type: ignore[arg-type]
        record.execute("VACUUM ANALYZE value")
        size = record.execute("SELECT pg_total_relation_size('value')").fetchone()
        print(f"{rows} values, {size[0] / rows if size else 0:.0f} bytes each with the index")
        question = """
            SELECT date_bin('2 minutes', time, 'epoch'), avg(number), min(number), max(number) FROM sample
            WHERE plant = 'plant 0' AND drive = 'drive 0' AND quantity = 'quantity_0'
            AND time BETWEEN '2026-06-01Z' AND '2026-06-02Z' GROUP BY 1 ORDER BY 1"""
        times = []
        for _ in range(6):
            began = time.perf_counter()
            points = len(record.execute(question).fetchall())
            times.append(1000 * (time.perf_counter() - began))
        print(f"a day of one quantity, a value a second, {points} points: {times[0]:.0f} ms, then {min(times):.0f}")


def main() -> None:
    """Run the measurement and print its results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--to", required=True, help="an empty database of PostgreSQL")
    parser.add_argument("--plants", type=int, default=50)
    parser.add_argument("--drives", type=int, default=10, help="of each plant")
    parser.add_argument("--quantities", type=int, default=4, help="of each drive")
    parser.add_argument("--rate", type=float, default=20_000, help="values a second that are published")
    parser.add_argument("--seconds", type=float, default=30.0, help="how long is published")
    parser.add_argument("--period", type=int, default=10, help="seconds between two values of the day")
    given = parser.parse_args()
    with TemporaryDirectory(prefix="dc") as folder:
        _measure_rate(given, Path(folder))
    _measure_trend(given)


if __name__ == "__main__":
    main()
