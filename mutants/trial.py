"""Judge the package that stands in a folder; run by `planting.py` in a process of its own.

    python mutants/trial.py FOLDER PROTOCOL

Prints one JSON object: `check` and `reason` of the first check that does not hold, both empty when all hold.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path


def main(folder: str, protocol: str) -> None:
    """Judge, quickly first; what stands the quick extent is put through everything."""
    sys.path.insert(0, folder)
    package = __import__("drivecomm_" + protocol.replace("-", "_"))
    if Path(str(package.__file__)).parent.parent != Path(folder):
        raise SystemExit(f"{package.__file__} was judged and not what stands in {folder}")

    from drivecomm.protocol import installed
    from drivecomm.testing import (
        FULL,
        QUICK,
        first_failure,
    )

    verdict = first_failure(installed[protocol], QUICK) or first_failure(installed[protocol], FULL)
    found = {"check": "", "reason": ""} if verdict is None else {"check": verdict.check.name, "reason": verdict.reason}
    print(json.dumps(found))


if __name__ == "__main__":
    main(*sys.argv[1:])
