"""Measure what the project promises, print it, and write benchmarks/RESULTS.md.

    make bench
    python benchmarks/run.py [NAME ...] [--quick] [--strict]

Lines are emulated in C with the timing of real ones, and what is measured is compared with a bare C client in the same
run. Exit code 1 when a floor is broken (with --strict: a promise), 2 when nothing can be measured here.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import dead_drives
import efficiency
import forecast_accuracy
import model_load
import neighbour
import peers
import plant_of_50_lines
import processor_time
import scale
import scan_time
import served
import start_up
import telegrams
import tuned_drives
from clients import MasterBrokenError, PythonMaster
from compiling import CannotMeasureError, compile_programs
from cores import machine
from equipment import Equipment
from extent import FULL, QUICK
from lines import DisturbedError, Instrument, MeasurementError
from report import Section, promises
from yardstick import slowness

RESULTS = Path(__file__).with_name("RESULTS.md")
MEASUREMENTS = {
    "efficiency": efficiency.measure,
    "processor_time": processor_time.measure,
    "tuned_drives": tuned_drives.measure,
    "scale": scale.measure,
    "neighbour": neighbour.measure,
    "dead_drives": dead_drives.measure,
    "scan_time": scan_time.measure,
    "forecast": forecast_accuracy.measure,
    "served": served.measure,
    "plant_of_50_lines": plant_of_50_lines.measure,
    "telegrams": telegrams.measure,
    "model_load": model_load.measure,
    "start_up": start_up.measure,
    "peers": peers.measure,
}


def main() -> int:
    """Measure; return the exit code."""
    parser = argparse.ArgumentParser(description="Measure what the project promises.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"only these of {', '.join(MEASUREMENTS)}")
    parser.add_argument("--quick", action="store_true", help="fewer repetitions and cases; under two minutes")
    parser.add_argument("--strict", action="store_true", help="hold a quiet machine to the promises, not the floors")
    parser.add_argument("--out", type=Path, default=RESULTS, help="where to write; benchmarks/RESULTS.md otherwise")
    chosen = parser.parse_args()
    unknown = [name for name in chosen.names if name not in MEASUREMENTS]
    if unknown:
        parser.error(f"nothing is called {unknown[0]}; there is {', '.join(MEASUREMENTS)}")
    about = machine()
    slow = slowness()
    with TemporaryDirectory() as folder:
        try:
            programs = compile_programs(Path(folder))
        except CannotMeasureError as error:
            print(f"cannot measure: {error}", file=sys.stderr)
            return 2
        extent = QUICK if chosen.quick else FULL
        instrument = Instrument(programs.line_emulator, extent.tries)
        with PythonMaster() as master:
            equipment = Equipment(extent=extent, instrument=instrument, programs=programs, master=master)
            sections = _measure(chosen.names or list(MEASUREMENTS), equipment)
    speed = f"The yardstick took {slow:.1f} times its quiet length before the run, {slowness():.1f} times after it."
    command = " ".join(["python benchmarks/run.py", *chosen.names, *(["--quick"] if chosen.quick else [])])
    parts = [
        "# Results",
        "",
        f"`{command}`  ",
        f"{about}.  ",
        f"{instrument.accuracy()}  ",
        speed,
        "",
        promises(sections),
    ]
    text = "\n".join([*parts, *(section.markdown() for section in sections)]).rstrip() + "\n"
    chosen.out.write_text(text, encoding="utf-8")
    print(text)
    figures = [figure for section in sections for figure in section.figures]
    judged = [figure for figure in figures if not figure.disturbed]
    broken = [figure for figure in judged if not (figure.kept if chosen.strict else figure.above_floor)]
    for figure in broken:
        mark = figure.promise if chosen.strict else figure.floor
        print(f"broken: {figure.name}: {figure.value:.4g}, must be {figure.better} than {mark:.4g}", file=sys.stderr)
    for section in sections:
        if section.failed:
            print(f"failed: {section.title}: {section.remarks[0]}", file=sys.stderr)
    if len(judged) < len(figures):
        print(f"{len(figures) - len(judged)} figures were disturbed and not judged", file=sys.stderr)
    return 1 if broken or any(section.failed for section in sections) else 0


def _measure(names: list[str], equipment: Equipment) -> list[Section]:
    sections: list[Section] = []
    for name in names:
        began = time.monotonic()
        try:
            sections += MEASUREMENTS[name](equipment)
        except (MeasurementError, MasterBrokenError, subprocess.CalledProcessError) as error:
            failed = not isinstance(error, DisturbedError)
            remark = f"{'**failed**' if failed else 'disturbed'}: {error}"
            about = "Could not be measured."
            sections.append(Section(title=name, about=about, head=(), remarks=[remark], failed=failed))
        print(f"{name}: {time.monotonic() - began:.0f} s", file=sys.stderr, flush=True)
    return sections


if __name__ == "__main__":
    raise SystemExit(main())
