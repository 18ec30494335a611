"""Fuzzing with atheris: libFuzzer, guided by coverage. Each target runs in a process of its own.

libFuzzer ends its process at the first new error, so a run shows the known errors and one new error at most.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import TYPE_CHECKING

from mutation import LONGEST
from outcome import Flaw, FuzzResult, known_flaws, store_input

if TYPE_CHECKING:
    from target import FuzzTarget

TITLE = "atheris, led by coverage"
_PROCESS = Path(__file__).with_name("atheris_process.py")
_MOST_MEMORY_MIB = 1024
_LONGEST_INPUT_S = 20


def run(target: FuzzTarget, *, runs: int | None, seconds: float | None, seed: int) -> FuzzResult:
    """Run a target up to its limit, or up to the first unknown flaw."""
    known = tuple(known_flaws(target).values())
    with TemporaryDirectory(prefix="drivecomm-fuzz-") as folder:
        corpus, broken = Path(folder) / "corpus", Path(folder) / "broken"
        corpus.mkdir()
        broken.mkdir()
        for number, data in enumerate([*target.seeds, *target.found()]):
            (corpus / f"{number:05}").write_bytes(data)
        command = [
            *(sys.executable, str(_PROCESS), target.name, str(corpus), f"-artifact_prefix={broken}/", f"-seed={seed}"),
            *(f"-max_len={2 * LONGEST}", f"-rss_limit_mb={_MOST_MEMORY_MIB}", f"-timeout={_LONGEST_INPUT_S}"),
            "-print_final_stats=1",
        ]
        if runs is not None:
            command.append(f"-atheris_runs={runs}")
        if seconds is not None:
            command.append(f"-max_total_time={max(1, round(seconds))}")
        began = perf_counter()
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)  # noqa: S603
        said = done.stdout + done.stderr
        flaws = [_flaw(target, path, said) for path in sorted(broken.iterdir())]
    if done.returncode and not flaws:
        raise RuntimeError(f"atheris ended with {done.returncode} for {target.name}: {said[-2000:]}")
    return FuzzResult(
        target=target.name,
        inputs=_number(said, r"number_of_executed_units: +(\d+)") or _number(said, r"Done (\d+) (?:runs )?in"),
        # If libFuzzer printed its own duration, use that: it excludes loading and instrumenting the code.
        seconds=_number(said, r"Done \d+ (?:runs )?in (\d+) second") or perf_counter() - began,
        flaws=(*known, *flaws),
        grown_mib=_grown_mib(said),
    )


def _flaw(target: FuzzTarget, path: Path, said: str) -> Flaw:
    kind = path.name.partition("-")[0]
    error = re.search(r"Uncaught Python exception: ===\n(.*)", said)
    places = re.findall(r'File "([^"]*)", line (\d+)', said)
    place = f"{Path(places[-1][0]).name}:{places[-1][1]}" if places else ""
    return Flaw(error=error[1] if error else kind, place=place, kept=store_input(target, path.read_bytes()))


def _grown_mib(said: str) -> int:
    """Return the growth of memory since the corpus was read; all memory if libFuzzer prints no sizes."""
    sizes = [int(size) for size in re.findall(r"\brss: (\d+)Mb", said)]
    peak = _number(said, r"peak_rss_mb: +(\d+)")
    return max(*sizes, peak) - sizes[0] if sizes else peak


def _number(said: str, pattern: str) -> int:
    found = re.findall(pattern, said)
    return int(found[-1]) if found else 0
