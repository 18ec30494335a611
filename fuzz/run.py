"""Fuzzer for all readers of foreign data; prints the number of inputs and their rate.

    make fuzz
    python fuzz/run.py [TARGET ...] [--runs N] [--seconds S] [--engine atheris|plain] [--seed N] [--list]

With atheris, inputs are guided by coverage; without it they are random mutations of valid ones. The exit code is 1 if
an error outside drivecomm's tree was raised or a property broke; the input is stored in fuzz/found.
"""

from __future__ import annotations

import argparse
import sys
from importlib.util import find_spec
from typing import TYPE_CHECKING

import atheris_engine
import plain_engine
from all_targets import all_targets

if TYPE_CHECKING:
    from outcome import FuzzResult

_ENGINES = {"atheris": atheris_engine, "plain": plain_engine}
_SECONDS = 10.0


def main() -> int:
    """Fuzz the targets; return the exit code."""
    targets = all_targets()
    parser = argparse.ArgumentParser(description="Fuzz everything that reads what others wrote.")
    parser.add_argument("names", nargs="*", metavar="TARGET", help="only these; all unless given")
    parser.add_argument("--runs", type=_positive, help="inputs for each target")
    parser.add_argument("--seconds", type=float, help=f"for each target; {_SECONDS:g} unless --runs is given")
    parser.add_argument("--engine", choices=_ENGINES, help="atheris where it is installed, plain elsewhere")
    parser.add_argument("--seed", type=int, default=1, help="another one gives other inputs")
    parser.add_argument("--list", action="store_true", help="name the targets and end")
    given = parser.parse_args()
    if unknown := sorted(set(given.names) - set(targets)):
        parser.error(f"there is no target {unknown[0]!r}; they are {', '.join(targets)}")
    if given.list:
        print("\n".join(targets))
        return 0
    engine = _ENGINES[given.engine or ("atheris" if find_spec("atheris") else "plain")]
    if engine is atheris_engine and not find_spec("atheris"):
        parser.error("atheris is not installed; install it with: pip install atheris")
    seconds = _SECONDS if given.seconds is None and given.runs is None else given.seconds
    print(f"Fuzzing with {engine.TITLE}, seed {given.seed}.")
    print(f"{'target':<22}{'inputs':>12}{'seconds':>9}{'inputs/s':>10}{'slowest':>10}{'memory':>10}  found", flush=True)
    sound = True
    for name in given.names or targets:
        outcome = engine.run(targets[name], runs=given.runs, seconds=seconds, seed=given.seed)
        print(_line(outcome), flush=True)
        for flaw in outcome.flaws:
            print(f"    {flaw.error}\n        at {flaw.place}, kept as {flaw.kept}", flush=True)
        sound = sound and not outcome.flaws
    return 0 if sound else 1


def _line(outcome: FuzzResult) -> str:
    slowest = "-" if outcome.slowest_s is None else f"{outcome.slowest_s * 1000:.1f} ms"
    return (
        f"{outcome.target:<22}{outcome.inputs:>12,}{outcome.seconds:>9.1f}{outcome.rate:>10,.0f}"
        f"{slowest:>10}{outcome.grown_mib:>6.0f} MiB  {len(outcome.flaws) or 'nothing'}"
    )


def _positive(text: str) -> int:
    number = int(text.replace("_", ""))
    if number < 1:
        raise argparse.ArgumentTypeError(f"{number} inputs are none; give 1 or more")
    return number


if __name__ == "__main__":
    sys.exit(main())
