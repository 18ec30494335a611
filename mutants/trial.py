"""Trial of a mutated protocol package by the conformance kit; `planting.py` runs it in a separate process.

    python mutants/trial.py FOLDER PROTOCOL

Prints one JSON object: `check` and `reason` of the first check that fails, both empty if all pass.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path


def main(folder: str, protocol: str) -> None:
    """Run the quick conformance run, and the full one if the quick one passes; print the first failure."""
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
