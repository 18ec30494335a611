"""Measure what the project promises about its own costs, and write benchmarks/RESULTS.md.

    make bench

Start-up costs are differences to a bare interpreter in the same run, medians of interleaved repetitions. Exchanges run
on a virtual line, so that only processor time counts; the figure includes the virtual drive.
"""

from __future__ import annotations

import platform
import statistics
import subprocess
import sys
import time
from pathlib import Path

import drivecomm
from drivecomm.conformance.vectors import packaged_vectors
from drivecomm.virtual import VirtualLine, virtual_drive

REPETITIONS = 21
EXCHANGES = 2000
RESULTS = Path(__file__).with_name("RESULTS.md")

STARTS = {
    "import drivecomm": (["-c", "import drivecomm"], 60.0),
    "drivecomm --version": (["-m", "drivecomm", "--version"], 150.0),
    "drivecomm --help": (["-m", "drivecomm", "--help"], None),
    "drivecomm protocols": (["-m", "drivecomm", "protocols"], None),
}
READS = {"vabus": "481", "danfoss-fc": "16-13", "vlt3500": "215", "fuji": "M09"}


def start_ms(arguments: list[str]) -> float:
    """Return the milliseconds that a fresh interpreter takes for this."""
    began = time.perf_counter()
    subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
    return (time.perf_counter() - began) * 1000


def start_up() -> list[tuple[str, float, float | None]]:
    """Return name, milliseconds over a bare interpreter, and the limit."""
    taken: dict[str, list[float]] = {name: [] for name in STARTS}
    bare: list[float] = []
    for _ in range(REPETITIONS):
        bare.append(start_ms(["-c", "pass"]))
        for name, (arguments, _limit) in STARTS.items():
            taken[name].append(start_ms(arguments))
    floor = statistics.median(bare)
    return [(name, statistics.median(taken[name]) - floor, limit) for name, (_, limit) in STARTS.items()]


def exchange_us(protocol: str) -> float:
    """Return the processor time of one read in microseconds, virtual drive included."""
    line = VirtualLine([virtual_drive(protocol, 1)])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive(protocol, 1)
        drive.read(READS[protocol])
        began = time.process_time()
        for _ in range(EXCHANGES):
            drive.read(READS[protocol])
        return (time.process_time() - began) / EXCHANGES * 1e6


def codec_us(protocol: str) -> tuple[float, float]:
    """Return microseconds to decode and to encode one telegram, mean over the protocol's own vectors."""
    plugin = drivecomm.protocols()[protocol]
    codec = plugin.codec(plugin.options())
    vectors = [one for one in packaged_vectors(plugin).vectors if one.valid and one.canonical and not one.options]
    messages = [codec.decode(one.data, one.direction) for one in vectors]
    rounds = max(1, 4000 // len(vectors))
    began = time.process_time()
    for _ in range(rounds):
        for one in vectors:
            codec.decode(one.data, one.direction)
    decoded = time.process_time()
    for _ in range(rounds):
        for message in messages:
            codec.encode(message)
    count = rounds * len(vectors) / 1e6
    return (decoded - began) / count, (time.process_time() - decoded) / count


def main() -> int:
    """Measure, print, write; exit code 1 when a limit is broken."""
    rows = ["# Results", "", f"`make bench`, CPython {platform.python_version()}, {platform.system()}.", ""]
    rows += ["## Start-up", "", "Over a bare interpreter, median.", ""]
    rows += ["| what | ms more | limit |", "|---|---|---|"]
    broken = False
    for name, taken, limit in start_up():
        rows.append(f"| `{name}` | {taken:.0f} | {'' if limit is None else f'{limit:.0f}'} |")
        broken |= limit is not None and taken > limit
    rows += [
        "",
        "## Telegrams and exchanges",
        "",
        "Processor time in microseconds; an exchange includes the drive.",
        "",
    ]
    rows += ["| protocol | decode | encode | read on a virtual line | exchanges a second |", "|---|---|---|---|---|"]
    for protocol in READS:
        decoding, encoding = codec_us(protocol)
        exchange = exchange_us(protocol)
        rows.append(f"| {protocol} | {decoding:.1f} | {encoding:.1f} | {exchange:.0f} | {1e6 / exchange:.0f} |")
    text = "\n".join(rows) + "\n"
    RESULTS.write_text(text, encoding="utf-8")
    print(text)
    return 1 if broken else 0


if __name__ == "__main__":
    raise SystemExit(main())
