"""Automatic mutants: runs mutmut on a room to find mistakes that its tests do not detect.

    make mutants-any ROOM=line
    python mutants/any.py ROOM[/MODULE] [--tests FOLDER ...]

It works on a copy, so no file here changes, and prints each surviving mutant as a diff. Many survivors change nothing
that matters. One that does gets a test; if it is about a stop, a link, a lease or a kept motor, it also joins the
permanent mutants.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from shutil import copytree, ignore_patterns

ROOT = Path(__file__).resolve().parent.parent
BESIDE = ("protocols", "docs", "benchmarks")
"""Further folders that the tests read, in addition to the mutated code."""
SETTINGS = """
[tool.mutmut]
source_paths = ["drivecomm"]
only_mutate = ["{mutated}"]
also_copy = {beside}
pytest_add_cli_args = ["-m", "not soak", "-p", "no:xdist"]
pytest_add_cli_args_test_selection = {tests}
"""


def main() -> int:
    """Run mutmut and print the survivors; return the exit code, 1 if any mutant survived."""
    parser = argparse.ArgumentParser(description="Look for mistakes that the tests of a room would not notice.")
    parser.add_argument("room", help="a folder of drivecomm/, or a module of one such as line/queue")
    parser.add_argument("--tests", nargs="+", metavar="FOLDER", help="what judges them; tests/ROOM unless given")
    given = parser.parse_args()
    place = ROOT / "drivecomm" / given.room
    mutated = f"drivecomm/{given.room}/*" if place.is_dir() else f"drivecomm/{given.room.removesuffix('.py')}.py"
    tests = given.tests or [f"tests/{given.room.partition('/')[0]}"]
    if missing := [each for each in (mutated.removesuffix("/*"), *tests) if not (ROOT / each).exists()]:
        parser.error(f"there is no {missing[0]}")
    with tempfile.TemporaryDirectory() as folder:
        for each in ("drivecomm", "tests", *BESIDE):
            copytree(ROOT / each, Path(folder, each), ignore=ignore_patterns("__pycache__"))
        Path(folder, "README.md").write_bytes((ROOT / "README.md").read_bytes())
        settings = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
        # With double quotes, a list of texts is the same in Python and in TOML.
        written = [str([*names]).replace("'", '"') for names in (tests, (*BESIDE, "README.md"))]
        chosen = SETTINGS.format(mutated=mutated, tests=written[0], beside=written[1])
        Path(folder, "pyproject.toml").write_text(settings + chosen, encoding="utf-8")
        return _judged(folder)


def _judged(folder: str) -> int:
    def mutmut(*words: str) -> subprocess.CompletedProcess[str]:
        stream = subprocess.PIPE if words[0] != "run" else None
        return subprocess.run(
            [sys.executable, "-m", "mutmut", *words], cwd=folder, stdout=stream, text=True, check=False
        )

    done = mutmut("run", "--max-children", str(os.cpu_count()))
    if done.returncode:
        return done.returncode
    survivors = [line.split(":")[0].strip() for line in mutmut("results").stdout.splitlines() if "survived" in line]
    for name in survivors:
        print(mutmut("show", name).stdout)
    print(f"{len(survivors)} survived")
    return 1 if survivors else 0


if __name__ == "__main__":
    sys.exit(main())
