"""The short form of the campaign: the same random scripts each time, some at once.

DRIVECOMM_SCRIPTS and DRIVECOMM_SEED make it longer and another one; `campaign.py` is the same as a program.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from extents import extents

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="it needs forks, signals, /dev/full and /proc")
SCRIPTS = 12
# A script that hangs is ended by the campaign itself long before.
PATIENCE_S = 60 + 30 * int(os.environ.get("DRIVECOMM_SCRIPTS", str(SCRIPTS)))


@pytest.mark.soak
@pytest.mark.timeout(PATIENCE_S + 30)
@extents(1, SCRIPTS)
def test_no_motor_runs_that_nothing_lets_run_and_nothing_succeeds_that_did_not_happen(extent):
    given = {"DRIVECOMM_SCRIPTS": str(extent), "DRIVECOMM_SEED": "short", **os.environ}
    program = [sys.executable, str(Path(__file__).with_name("campaign.py")), "--at-once", "6"]
    done = subprocess.run(program, env=given, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
