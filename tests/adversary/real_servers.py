"""Random scripts over server processes, with real signals, limits and sockets; judged as the simulated ones.

    python tests/adversary/real_servers.py --seed 1 --scripts 60 --at-once 4
    python tests/adversary/real_servers.py --seed 1 --script 7

Simulator and servers are forked from this process, which has loaded all modules that they need.
"""

import argparse
import json
import os
import shutil
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from command_lines import load
from forked_scripts import workers
from real_scripts import RealScript


def _work(seed, numbers, folder, results):
    load()
    for number in numbers:
        place = folder / str(number)
        place.mkdir()
        os.chdir(place)
        os.environ.update(XDG_RUNTIME_DIR=str(place), XDG_STATE_HOME=str(place / "state"))
        failures, one = [], None
        try:
            one = RealScript(seed, number)
            failures = one.run()
        except Exception as error:  # noqa: BLE001 - reported as a failure of the script
            failures = [f"the campaign itself: {type(error).__name__}: {error}"]
        story = [f"  {at:8.2f} {text}" for at, text in (one.story if one else ())]
        text = "\n".join([f"real script {number} of seed {seed}:", *story, *(f"  FAILED {each}" for each in failures)])
        results.write(json.dumps([bool(failures), text if failures else ""]) + "\n")
        results.flush()


def main():
    words = argparse.ArgumentParser()
    words.add_argument("--scripts", type=int, default=60)
    words.add_argument("--seed", default="1")
    words.add_argument("--script", type=int, action="append")
    words.add_argument("--at-once", type=int, default=4)
    given = words.parse_args()
    numbers = given.script or list(range(given.scripts))
    folder = Path(tempfile.mkdtemp(prefix="dc"))
    began, done, failed = time.monotonic(), 0, 0
    at_once = min(given.at_once, len(numbers))
    for line in workers(at_once, lambda first, file: _work(given.seed, numbers[first::at_once], folder, file)):
        wrong, text = json.loads(line)
        done, failed = done + 1, failed + wrong
        if text:
            print(text, flush=True)
    shutil.rmtree(folder, ignore_errors=True)
    print(f"seed {given.seed}, {time.monotonic() - began:.0f} s: {done} scripts with real processes, {failed} failed")
    sys.exit(1 if failed or done != len(numbers) else 0)


if __name__ == "__main__":
    main()
