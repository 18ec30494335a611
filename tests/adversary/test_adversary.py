"""Short campaign: the same random scripts each time, some of them concurrently.

DRIVECOMM_SCRIPTS and DRIVECOMM_SEED change its length and its scripts; `campaign.py` runs the same as a program.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from extents import extents

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="it needs forks, signals, /dev/full and /proc")
SCRIPTS = 12
# The campaign itself ends a hanging script long before this timeout.
PATIENCE_S = 60 + 30 * int(os.environ.get("DRIVECOMM_SCRIPTS", str(SCRIPTS)))


@pytest.mark.soak
@pytest.mark.timeout(PATIENCE_S + 30)
@extents(1, SCRIPTS)
def test_random_command_lines_keep_the_invariant_of_the_plant(extent):
    given = {"DRIVECOMM_SCRIPTS": str(extent), "DRIVECOMM_SEED": "short", **os.environ}
    program = [sys.executable, str(Path(__file__).with_name("campaign.py")), "--at-once", "6"]
    done = subprocess.run(program, env=given, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
