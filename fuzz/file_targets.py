"""Fuzz targets that read files from people and other programs: vectors, models, plants, captures."""

from __future__ import annotations

import re
import sys
from contextlib import suppress
from dataclasses import replace
from importlib import resources
from io import BufferedReader, BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from mutation import mutate_bytes, mutate_json, mutate_toml
from target import FuzzTarget, expect

from drivecomm.capture import MAGIC, Capture, JsonLines, Pcapng, Piece, Provenance, capture_in
from drivecomm.errors import DriveCommError, FileFormatError
from drivecomm.models import model_names, read_model
from drivecomm.plant import read_plant
from drivecomm.protocol import LineSettings, installed
from drivecomm.testing import load_vectors, packaged_vectors

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from drivecomm.protocol import Protocol

_CAPTURE = Path("capture")
# A limit for seeds: larger ones only make each input slower.
_MOST_SEEDS = 400


def file_targets() -> Iterator[FuzzTarget]:
    """Yield a target for every reader of files."""
    plugins = list(installed.working())
    yield _toml("vector-files", load_vectors, tuple(_vector_files(plugins)))
    yield _toml("model-files", _read_model, tuple(_model_files(plugins)))
    yield _toml("plant-files", read_plant, (_documented(sys.modules[read_plant.__module__].__doc__),))
    captures = list(_captures(plugins))
    yield FuzzTarget(
        name="capture-json-lines",
        check=_check_json_lines,
        seeds=tuple(_file_of(JsonLines(capture.provenance), capture) for capture in captures),
        mutate=mutate_json,
    )
    yield FuzzTarget(
        name="capture-pcapng",
        check=_check_pcapng,
        seeds=tuple(_file_of(Pcapng(capture.provenance), capture) for capture in captures),
        mutate=mutate_bytes,
    )


class _FileReading:
    """Check that writes an input to a file and reads the file."""

    def __init__(self, read: Callable[[Path], object]) -> None:
        self._read = read
        self._folder = TemporaryDirectory(prefix="drivecomm-fuzz-")
        self._place = Path(self._folder.name) / "input.toml"

    def check(self, data: bytes) -> None:
        """Read the input from a file; raise any error except FileFormatError."""
        self._place.write_bytes(data)
        with suppress(FileFormatError):
            self._read(self._place)


def _toml(name: str, read: Callable[[Path], object], seeds: tuple[bytes, ...]) -> FuzzTarget:
    return FuzzTarget(name=name, check=_FileReading(read).check, seeds=seeds[:_MOST_SEEDS], mutate=mutate_toml)


def _vector_files(plugins: list[Protocol]) -> Iterator[bytes]:
    for plugin in plugins:
        text = (resources.files(plugin.package) / "vectors.toml").read_text(encoding="utf-8")
        yield from _one_entry_each(text, ("vector", "stream", "refuse", "exchange"), 100)


def _model_files(plugins: list[Protocol]) -> Iterator[bytes]:
    for plugin in plugins:
        for name in model_names(plugin.package, plugin.name):
            text = (resources.files(plugin.package) / "models" / f"{name}.toml").read_text(encoding="utf-8")
            yield from _one_entry_each(text, ("parameter", "faults"), 10)


def _one_entry_each(text: str, kinds: tuple[str, ...], most: int) -> Iterator[bytes]:
    """Yield up to `most` files with the head of this text and one of its different entries each."""
    head, *entries = re.split(rf"^(?=\[\[?(?:{'|'.join(kinds)})\]\]?$)", text, flags=re.MULTILINE)
    for entry in entries[:: 1 + len(entries) // most]:
        yield (head + entry).encode()


def _documented(doc: str | None) -> bytes:
    """Return the example file in the description of a format."""
    text = doc or ""
    return text[text.index("format = 1") :].encode()


def _read_model(place: Path) -> object:
    named = re.search(rb'^protocol = "([\w-]+)"', place.read_bytes(), flags=re.MULTILINE)
    return read_model(place, named[1].decode() if named else "vabus")


def _captures(plugins: list[Protocol]) -> Iterator[Capture]:
    for plugin in plugins:
        telegrams = [each for each in packaged_vectors(plugin).vectors if len(each.data) < 40][:4]
        settings = LineSettings(baudrate=19200, parity="E")
        pieces = [
            Piece(
                time_s=number / 8,
                data=each.data,
                source="master" if each.direction == "request" else "drive",
                line="hall" if number % 2 else "",
                settings=settings if number == 1 else None,
            )
            for number, each in enumerate(telegrams)
        ]
        about = Provenance(port="/dev/ttyUSB0", settings=plugin.facts.settings, drives=(f"{plugin.name}:1",))
        yield Capture(provenance=about, pieces=pieces)
        yield Capture(provenance=replace(about, settings=None, note="heard elsewhere"), pieces=pieces[:1])


def _file_of(form: JsonLines | Pcapng, capture: Capture) -> bytes:
    return form.opening() + b"".join(map(form.piece, capture.pieces))


def _check_json_lines(data: bytes) -> None:
    try:
        capture = _capture_in(data)
    except FileFormatError:
        return
    again = _written_again(JsonLines, capture)
    if again is None:
        return
    back = _capture_in(again)
    expect(back.provenance == capture.provenance, "a capture is from elsewhere after it was written again")
    expect(_heard(back) == _heard(capture), "a capture holds other pieces after it was written again")


def _check_pcapng(data: bytes) -> None:
    # Distinguish the two formats as `read_capture` does.
    if not data.startswith(MAGIC):
        return
    try:
        capture = _capture_in(data)
    except FileFormatError:
        return
    again = _written_again(Pcapng, capture)
    if again is None:
        return
    back = _capture_in(again)
    expect([each.data for each in back.pieces] == [each.data for each in capture.pieces], "other bytes when rewritten")


def _written_again(form: type[JsonLines | Pcapng], capture: Capture) -> bytes | None:
    """Return a capture written to a file again, or None if writing is refused."""
    try:
        return _file_of(form(capture.provenance), capture)
    except DriveCommError:
        return None


def _capture_in(data: bytes) -> Capture:
    return capture_in(_CAPTURE, BufferedReader(BytesIO(data)))


def _heard(capture: Capture) -> list[Piece]:
    return [replace(piece, time_s=round(piece.time_s, 9)) for piece in capture.pieces]
