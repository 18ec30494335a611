"""Processor time of the sniffer, of a capture on the command line, and of diagnosing damaged telegrams."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from conversation import READS
from report import Figure, Section

import drivecomm
from drivecomm.capture import CaptureWriter, Piece, Provenance
from drivecomm.errors import TelegramError
from drivecomm.protocol import LineSettings
from drivecomm.traffic.sniffer import Sniffer
from drivecomm.virtual import VirtualLine, virtual_drive

if TYPE_CHECKING:
    from collections.abc import Sequence

    from equipment import Equipment

    from drivecomm.protocol import Direction, Protocol

_SETTINGS = LineSettings()
_EXCHANGES = 1000
_DRIVES = 3
# Mean time of the four decoders on the machine of the promises; all results are scaled to it.
_DECODER_US = 2.0
_MILLION = 1_000_000
_TIMES = 8
_PROMISES = {"one": 15.0, "four": 25.0, "damaged": 6.0, "million": 30.0}
_FLOOR = 1.5
_PROGRAM = """
import sys, time
from drivecomm.cli import main
main(sys.argv[1:])
print(time.process_time(), file=sys.stderr)
"""
_OPTIONS: dict[str, list[str]] = {"as a table": ["--table"], "as text": []}


def measure(equipment: Equipment) -> list[Section]:
    """Measure polled lines of one protocol each, and one line of all four, with a new value in every read."""
    section = Section(
        title="Listening",
        about=(
            "Processor microseconds a telegram of lines that are polled, where every value read is a new one. The "
            f"promises are on the scale on which the four decoders take {_DECODER_US:g} in the mean of this run."
        ),
        head=("line", "decode", "sniff, its protocol known", "sniff, four protocols", "what is wrong"),
    )
    plugins = {name: drivecomm.protocols()[name] for name in READS}
    lines = {name: _polled([name]) for name in READS}
    mixed = _polled(list(READS))
    taken: dict[str, list[tuple[float, ...]]] = {name: [] for name in READS}
    of_mixed: list[float] = []
    # Measure in turns, so that a slow second of the processor affects all lines alike.
    for _ in range(_TIMES * equipment.extent.repetitions):
        for name, plugin in plugins.items():
            taken[name].append(
                (
                    _decode_us(plugin, lines[name]),
                    _sniff_us([plugin], lines[name]),
                    _sniff_us(plugins.values(), lines[name]),
                    _damaged_us(plugin, lines[name]),
                )
            )
        of_mixed.append(_sniff_us(plugins.values(), mixed))
    least = {name: [min(column) for column in zip(*each, strict=True)] for name, each in taken.items()}
    section.rows += [(name, *(f"{each:.1f}" for each in columns)) for name, columns in least.items()]
    decoding, known, _, damaged = zip(*least.values(), strict=True)
    four = min(of_mixed)
    section.rows.append(("all four on one line", "", "", f"{four:.1f}", ""))
    scale = _DECODER_US * len(decoding) / sum(decoding)
    measured = {"one": max(known) * scale, "four": four * scale, "damaged": max(damaged) * scale}
    names = {
        "one": "us a telegram, sniffer, one protocol, the slowest",
        "four": "us a telegram, sniffer, four protocols on one line",
        "damaged": "us to tell what is wrong with a telegram, the slowest",
    }
    for way, options in _OPTIONS.items():
        measured[way] = _million_s(mixed, options, equipment.extent.repetitions) * scale
        names[way] = f"s for a million telegrams on the command line, {way}"
    for key, name in names.items():
        promise = _PROMISES.get(key, _PROMISES["million"])
        figure = Figure(name=name, value=measured[key], promise=promise, floor=_FLOOR * promise, better="less")
        section.figures.append(figure)
    return [section]


def _polled(names: Sequence[str]) -> list[tuple[Direction, Piece]]:
    """Return the telegrams on a line whose drives are polled in turn, with a new value each time."""
    addresses = [(name, 1 + number + _DRIVES * place) for place, name in enumerate(names) for number in range(_DRIVES)]
    line = VirtualLine([virtual_drive(name, address, baudrate=9600) for name, address in addresses])
    said: list[tuple[Direction, Piece]] = []
    line.monitors.append(
        lambda sent: said.append(
            (
                "request" if sent.source == "master" else "reply",
                Piece(time_s=sent.ended, data=sent.data, settings=_SETTINGS),
            )
        )
    )
    random = Random(1)
    with drivecomm.open_bus(line.port) as bus:
        drives = [(bus.drive(name, address, baudrate=9600), READS[name]) for name, address in addresses]
        for number in range(_EXCHANGES):
            place = number % len(drives)
            drive, parameter = drives[place]
            held = line.drives[place].peek(parameter, line.time)
            line.drives[place].poke(parameter, _another(held, random.randrange(1, 9999)))
            drive.read(parameter)
    return said


def _another(held: int | str, number: int) -> int | str:
    """Return a number in the raw form of the drive's present value."""
    if not isinstance(held, str):
        return number
    return f"{number / 10:.1f}" if "." in held or not held.isalnum() else f"{number:0{len(held)}d}"


def _decode_us(plugin: Protocol, said: Sequence[tuple[Direction, Piece]]) -> float:
    codec = plugin.codec(plugin.options())
    todo = [(piece.data, direction) for direction, piece in said]
    began = time.process_time()
    for data, direction in todo:
        codec.decode(data, direction)
    return (time.process_time() - began) / len(todo) * 1e6


def _sniff_us(plugins: Sequence[Protocol], said: Sequence[tuple[Direction, Piece]]) -> float:
    sniffer = Sniffer(plugins)
    # Exclude one-time work: the sniffer first has to detect the protocols.
    heard = sum(len(sniffer.feed(piece)) for _, piece in said[:100])
    began = time.process_time()
    heard += sum(len(sniffer.feed(piece)) for _, piece in said[100:]) + len(sniffer.finish())
    taken = time.process_time() - began
    if heard != len(said):
        raise AssertionError(f"{heard} of {len(said)} telegrams were found")
    return taken / (len(said) - 100) * 1e6


def _damaged_us(plugin: Protocol, said: Sequence[tuple[Direction, Piece]]) -> float:
    codec, random = plugin.codec(plugin.options()), Random(2)
    damaged = []
    for direction, piece in said:
        data = bytearray(piece.data)
        data[random.randrange(len(data))] ^= 1 << random.randrange(7)
        try:
            codec.decode(bytes(data), direction)
        except TelegramError:
            damaged.append((bytes(data), direction))
    began = time.process_time()
    for data, direction in damaged:
        try:
            codec.decode(data, direction)
        except TelegramError:
            continue
    return (time.process_time() - began) / len(damaged) * 1e6


def _million_s(said: Sequence[tuple[Direction, Piece]], options: list[str], repetitions: int) -> float:
    """Return the processor seconds for a million telegrams: a long run minus a short one, without the start-up."""
    with TemporaryDirectory() as folder:
        turns = [[_processor_s(Path(folder), said * times, options) for times in (1, 6)] for _ in range(repetitions)]
    few, many = (min(column) for column in zip(*turns, strict=True))
    return (many - few) / (5 * len(said)) * _MILLION


def _processor_s(folder: Path, said: Sequence[tuple[Direction, Piece]], options: list[str]) -> float:
    path, later_s = folder / "long.jsonl", 0.0
    with CaptureWriter(path, Provenance(settings=_SETTINGS)) as writer:
        before_s = 0.0
        for _, piece in said:
            if piece.time_s + later_s < before_s:
                later_s = before_s + 1.0
            before_s = piece.time_s + later_s
            writer.add(Piece(time_s=before_s, data=piece.data))
    done = subprocess.run(
        [sys.executable, "-c", _PROGRAM, "sniff", str(path), *options],
        check=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    return float(done.stderr.split()[-1])
