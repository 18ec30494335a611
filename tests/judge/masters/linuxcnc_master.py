"""LinuxCNC driver as a continuous master: linuxcnc_master.py PORT; prints the values of its pins."""

import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "bench"))
sys.path.insert(0, str(Path(__file__).parents[2] / "protocols"))

from linuxcnc import driver


def main(port):
    with (
        tempfile.TemporaryDirectory() as folder,
        driver(Path(folder), "gs2_vfd", f"gs2_vfd -d {Path(port).resolve()} -r 9600 -p none -s 1") as spindle,
    ):
        spindle.set(speed_command=1380, spindle_fwd=1)
        while True:
            # The driver sends to its drive only when a pin changes.
            for on in (0, 1, 1, 1, 1, 1):
                spindle.set(spindle_on=on)
                print(f"output {spindle.get('frequency-out')} Hz", flush=True)
                time.sleep(0.2)


if __name__ == "__main__":
    main(sys.argv[1])
