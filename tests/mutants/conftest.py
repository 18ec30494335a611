"""What plants mutants is no package: its modules are found as those of a script are."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "mutants"))
