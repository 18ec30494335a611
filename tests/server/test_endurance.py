"""A server does not grow: a plant of 500 drives as fast as its values are written, and clients that come and go."""

import json
import subprocess
import sys
from pathlib import Path
from statistics import median

import pytest

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "endurance_of_a_server.py"

pytestmark = [
    pytest.mark.soak,
    pytest.mark.timeout(330),
    pytest.mark.skipif(sys.platform != "linux", reason="memory is read from /proc"),
]


@pytest.mark.parametrize(
    ("asked", "grown_mib", "grown_objects"),
    [
        # Four minutes of the plant: 480 000 values.
        # Answers are remembered for ten minutes, which is longer than this.
        (["--hours", "0.0667"], 45, 0.6),
        # Its lines polled, for some two minutes of theirs.
        (["--hours", "0.04", "--polled", "--lines", "4"], 25, 0.6),
    ],
    ids=["fed", "polled"],
)
def test_memory_is_flat(asked, grown_mib, grown_objects):
    """Between the first and the last quarter; what fills up first, such as the buffers of SQLite, is in the limit."""
    done = subprocess.run(
        [sys.executable, str(SCRIPT), *asked], capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr[-3000:]
    *points, last = map(json.loads, done.stdout.splitlines())
    quarter = len(points) // 4
    first, final = points[:quarter], points[-quarter:]

    def of(name, some):
        return median(point[name] for point in some)

    assert of("rss_mib", final) < of("rss_mib", first) + grown_mib, points
    assert of("objects", final) < of("objects", first) * (1 + grown_objects), points
    assert final[-1]["missing"] == 0
    assert all(point["wal_mb"] < 20 for point in points)
    # It was a server with clients, and not one that nobody asked.
    assert all(last["done"][what] > 0 for what in ("streams", "orders")), last
