"""Benchmark run: measures the promised figures, prints them, and writes benchmarks/RESULTS.md.

    make bench          the whole, about 20 minutes
    make bench-quick    fewer repetitions and cases, under five minutes; writes no file
    python benchmarks/run.py [NAME ...] [--quick] [--strict] [--out FILE]

Lines are emulated in C with the timing of real ones, and the framework is compared with a bare C client, bare Python
and Modbus libraries in the same run. Measurements that other work on the machine disturbs are repeated for a few
minutes at most, and then marked void. Only a whole run without void figures replaces RESULTS.md.

Exit codes: 0 if all floors (with --strict: promises) hold; 1 if one is broken; 2 if nothing can be measured on this
machine; 3 if no floor is broken, but a figure is void or a goal has no measurement.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from clients import MasterBrokenError, PythonMaster
from compiling import CannotMeasureError, compile_programs
from cores import machine
from equipment import Equipment
from extent import FULL, QUICK
from goals import goals, unjudged
from lines import MOST_OTHERS, DisturbedError, Instrument, MeasurementError
from report import Section, promises
from yardstick import slowness, yardstick_us

if TYPE_CHECKING:
    from collections.abc import Sequence

    from report import Figure

RESULTS = Path(__file__).with_name("RESULTS.md")
MEASUREMENTS = (
    "scale",
    "efficiency",
    "processor_time",
    "tuned_drives",
    "listening",
    "neighbour",
    "blocks",
    "dead_drives",
    "scan_time",
    "forecast_accuracy",
    "served",
    "plant_of_50_lines",
    "served_plant",
    "model_load",
    "start_up",
)
"""Modules with a `measure` function, in the order of the run."""

# A yardstick that changed by more than this factor means a shared processor or a changed clock.
_MOST_CHANGED = 1.3


def main() -> int:
    """Run the measurements; return the exit code."""
    parser = argparse.ArgumentParser(description="Measure what the project promises.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"only these of {', '.join(MEASUREMENTS)}")
    parser.add_argument("--quick", action="store_true", help="fewer repetitions and cases; under five minutes")
    parser.add_argument("--strict", action="store_true", help="hold a quiet machine to the promises, not the floors")
    parser.add_argument("--out", type=Path, help="where to write; a whole run: benchmarks/RESULTS.md")
    chosen = parser.parse_args()
    unknown = [name for name in chosen.names if name not in MEASUREMENTS]
    if unknown:
        parser.error(f"nothing is called {unknown[0]}; there is {', '.join(MEASUREMENTS)}")
    about, slow = machine(), slowness()
    extent = QUICK if chosen.quick else FULL
    with TemporaryDirectory() as folder, PythonMaster() as master:
        try:
            programs = compile_programs(Path(folder))
        except CannotMeasureError as error:
            print(f"cannot measure: {error}", file=sys.stderr)
            return 2
        instrument = Instrument(programs.line_emulator, master, extent.tries, extent.spare_s)
        equipment = Equipment(extent=extent, instrument=instrument, programs=programs, master=master)
        sections = _measure(chosen.names or MEASUREMENTS, equipment)
    figures = [figure for section in sections for figure in section.figures]
    unjudged_goals = [] if chosen.names else unjudged(figures)
    command = " ".join(["python benchmarks/run.py", *chosen.names, *(["--quick"] if chosen.quick else [])])
    parts = [
        "# Results",
        "",
        f"`{command}`  ",
        f"{about}.  ",
        f"{instrument.accuracy()}  ",
        f"The yardstick took {slow:.1f} times its quiet length before the run, {slowness():.1f} times after it.",
        "",
        goals(figures, unjudged_goals),
        promises(figures),
        *(section.markdown() for section in sections),
    ]
    text = "\n".join(parts).rstrip() + "\n"
    print(text)
    whole = not (chosen.names or chosen.quick or unjudged_goals or any(section.voids for section in sections))
    out = chosen.out or (RESULTS if whole else None)
    if out is not None:
        out.write_text(text, encoding="utf-8")
    return _judged(sections, figures, unjudged_goals, strict=chosen.strict)


def _measure(names: Sequence[str], equipment: Equipment) -> list[Section]:
    """Run these measurements, then repeat disturbed ones while spare time is left."""
    done = {name: _sections(name, equipment) for name in names}
    for name, sections in done.items():
        voids = sum(section.voids for section in sections)
        if voids and equipment.instrument.spare_s > 0:
            began = time.monotonic()
            again = _sections(name, equipment)
            equipment.instrument.spare_s -= time.monotonic() - began
            if sum(section.voids for section in again) < voids:
                done[name] = again
    return [section for sections in done.values() for section in sections]


def _sections(name: str, equipment: Equipment) -> list[Section]:
    began, others, before = time.monotonic(), equipment.master.others_s(), yardstick_us()
    try:
        sections = import_module(name).measure(equipment)
    except (MeasurementError, MasterBrokenError, subprocess.CalledProcessError) as error:
        failed = not isinstance(error, DisturbedError)
        remark = f"{'**failed**' if failed else 'void'}: {error}"
        about = "Could not be measured."
        sections = [Section(title=name, about=about, head=(), remarks=[remark], void=not failed, failed=failed)]
    after, took = yardstick_us(), time.monotonic() - began
    share = (equipment.master.others_s() - others) / took
    disturbed = share > MOST_OTHERS or max(before, after) > _MOST_CHANGED * min(before, after)
    for section in sections:
        section.figures = [
            replace(figure, disturbed=not figure.exact and (figure.disturbed or disturbed))
            for figure in section.figures
        ]
    about = f"yardstick {before:.2f} us before and {after:.2f} us after it, others took {share:.0%} of a core"
    print(f"{name}: {took:.0f} s, {about}", file=sys.stderr, flush=True)
    return sections


def _judged(
    sections: Sequence[Section], figures: Sequence[Figure], unjudged_goals: Sequence[str], *, strict: bool
) -> int:
    """Print broken and void figures; return the exit code."""
    judged = [figure for figure in figures if not figure.disturbed]
    broken = [figure for figure in judged if not (figure.kept if strict else figure.above_floor)]
    for figure in broken:
        mark = figure.promise if strict else figure.floor
        limit = "at least" if figure.better == "more" else "at most"
        print(f"broken: {figure.name}: {figure.value:.4g}, must be {limit} {mark:.4g}", file=sys.stderr)
    failed = [section for section in sections if section.failed]
    for section in failed:
        print(f"failed: {section.title}: {section.remarks[0]}", file=sys.stderr)
    for goal in unjudged_goals:
        print(f"void or not measured: {goal}", file=sys.stderr)
    voids = sum(section.voids for section in sections)
    if voids:
        print(f"{voids} figures are void: the machine was busy with other things; repeat the run", file=sys.stderr)
    if broken or failed:
        return 1
    return 3 if voids or unjudged_goals else 0


if __name__ == "__main__":
    raise SystemExit(main())
