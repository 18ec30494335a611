"""What a history costs: processor time and bytes a row, and how long its courses, segments and deletions take.

    python benchmarks/history.py                    # 300,000 rows, some seconds
    python benchmarks/history.py --rows 7200000     # an hour of 500 drives with four values a second

Beside it, the same rows go through a bare `executemany` into a table without index, in turns.
"""

from __future__ import annotations

import argparse
import sqlite3
import tempfile
import time
from decimal import Decimal
from pathlib import Path

from drivecomm.protocol import Reading
from drivecomm.server import CurrentValue
from drivecomm.server.history import History, Store

DRIVES, NAMES = 500, ("output_frequency", "output_current", "output_voltage", "status")
A_COMMIT = 1000
BEGAN_S = 1_795_000_000.0


def batch_of(first: int) -> list[CurrentValue]:
    """Return half a second of the plant: what changes, what hardly does, and a state."""
    found = []
    for number in range(first, first + A_COMMIT):
        place, time_s = number % (DRIVES * len(NAMES)), BEGAN_S + number / (DRIVES * len(NAMES))
        name = NAMES[place % len(NAMES)]
        raw = (number * 7919) % 5000
        value: Decimal | str = "running" if name == "status" else Decimal(raw).scaleb(-2)
        reading = Reading(parameter=f"24{place % 4}", value=value, raw=raw, unit="Hz", time_s=time_s)
        drive = f"drive {place // len(NAMES)}"
        found.append(CurrentValue(drive=drive, name=name, reading=reading, quality="good", time_s=time_s + 0.001))
    return found


def measure(rows: int, folder: Path) -> None:
    """Write so many rows and read them; print what it took."""
    file = folder / "history.sqlite"
    one, bare = Store(file), sqlite3.connect(folder / "bare.sqlite", isolation_level=None)
    bare.executescript(
        "PRAGMA journal_mode = WAL; PRAGMA synchronous = NORMAL; CREATE TABLE t (row INTEGER PRIMARY KEY, a, b, c)"
    )
    added = sorting = floor = longest = 0.0
    for first in range(0, rows, A_COMMIT):
        batch = batch_of(first)
        began = time.thread_time()
        one.add(batch, [])
        added += time.thread_time() - began
        began, wall = time.thread_time(), time.perf_counter()
        one.sort()
        sorting += time.thread_time() - began
        longest = max(longest, time.perf_counter() - wall)
        plain = [(first + n, n, first, n) for n in range(len(batch))]
        began = time.thread_time()
        bare.execute("BEGIN")
        bare.executemany("INSERT INTO t VALUES (?, ?, ?, ?)", plain)
        bare.execute("COMMIT")
        floor += time.thread_time() - began
    bare.close()
    one.close()
    us = 1e6 / rows
    print(f"rows                       {rows}")
    print(f"added, in CPU time         {added * us:.2f} us a row, of which a bare table takes {floor * us:.2f}")
    print(f"sorted into segments       {sorting * us:.2f} us a row; the longest took {longest * 1000:.0f} ms")
    print(f"file                       {file.stat().st_size / rows:.1f} bytes a row")
    _read(file, rows)
    one = Store(file)
    took = []
    for _ in range(5):
        began = time.perf_counter()
        one.drop_oldest(before_s=BEGAN_S * 2, megabytes=1e6)
        took.append(time.perf_counter() - began)
    one.close()
    print(f"a segment deleted          {max(took) * 1000:.0f} ms at most, in the writer's thread")


def _read(file: Path, rows: int) -> None:
    with History(file) as history:
        for text, read in (
            ("500 points of all of one", lambda: history.points("drive 7", NAMES[0])),
            ("points of its last minute", lambda: history.points("drive 7", NAMES[0], BEGAN_S + rows / 2000 - 60, 2e9)),
            ("latest of one drive", lambda: history.latest("drive 7")),
        ):
            began = time.perf_counter()
            found = len(read())
            print(f"{text:<26} {(time.perf_counter() - began) * 1000:.1f} ms, {found} of them")
        began = time.thread_time()
        count = sum(1 for _ in history.since(0))
        print(f"all in their order         {(time.thread_time() - began) / count * 1e6:.2f} us a row")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=int, default=300_000)
    with tempfile.TemporaryDirectory() as folder:
        measure(parser.parse_args().rows, Path(folder))
