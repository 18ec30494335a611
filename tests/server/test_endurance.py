"""Memory of a server under load: a plant of 500 drives at full speed, and clients that connect and disconnect."""

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
        # Four minutes of the plant: 480 000 values. The run is shorter than the ten minutes for which
        # command results are remembered, so memory still grows by them.
        (["--hours", "0.0667"], 45, 0.6),
        # Lines are polled, for about two minutes of plant time.
        (["--hours", "0.04", "--polled", "--lines", "4"], 25, 0.6),
    ],
    ids=["fed", "polled"],
)
def test_memory_of_a_server_does_not_grow(asked, grown_mib, grown_objects):
    """Compare the first quarter of the run with the last; the limits allow for caches that fill up first."""
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
    # The run is valid only if the server had clients that sent requests.
    assert all(last["done"][what] > 0 for what in ("streams", "orders")), last
