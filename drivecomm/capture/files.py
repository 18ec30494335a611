"""Capture files: JSON Lines (.jsonl) and pcapng (.pcapng), and reading of logs printed by other programs.

with CaptureWriter("pumps.jsonl", Provenance(began=datetime.now(UTC), port="/dev/ttyUSB0")) as writer:
    writer.add(Piece(time_s=0.009, data=b"...", source="master"))
capture = read_capture("pumps.jsonl")
with open_capture("pumps.jsonl") as reader:
    for piece in reader: ...
"""

from __future__ import annotations

from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Self

from drivecomm.capture.growing_file import GrowingFile
from drivecomm.capture.json_lines import JsonLines, JsonLinesReader
from drivecomm.capture.pcapng_fields import MAGIC
from drivecomm.capture.pcapng_reading import PcapngReader
from drivecomm.capture.pcapng_writing import Pcapng
from drivecomm.capture.pieces import LONGEST_S, Capture
from drivecomm.capture.printed_log import PrintedLogReader
from drivecomm.errors import FileFormatError, UsageError
from drivecomm.tomlfile import no_such_file

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from io import BufferedReader

    from drivecomm.capture.pieces import Piece, Provenance

_HELD = 16384
"""Number of pieces held back for sorting; the same number again is held while more are read."""
_PCAP = (b"\xa1\xb2\xc3\xd4", b"\xd4\xc3\xb2\xa1", b"\xa1\xb2\x3c\x4d", b"\x4d\x3c\xb2\xa1")


_FORMS: Mapping[str, type[JsonLines | Pcapng]] = {".jsonl": JsonLines, ".pcapng": Pcapng}


def read_capture(path: str | Path) -> Capture:
    """Return the contents of a capture file in either format, whatever its name, sorted by time.

    A file of neither format is read as a log printed by another program; `remarks` lists its unreadable lines. A last
    line or block that is incomplete, because its program was killed, is skipped and listed as well. Raises
    FileFormatError with the file, the position in it and the reason.
    """
    place = Path(path)
    with _opened(place) as file, _readable(place):
        return capture_in(place, file)


def capture_in(path: Path, file: BufferedReader) -> Capture:
    """Return the contents of an open capture file like `read_capture`. path: name for messages."""
    reader = _reader(path, file, None)
    pieces = sorted(reader.pieces(), key=_time)
    return Capture(provenance=reader.provenance, pieces=pieces, remarks=tuple(reader.remarks))


class CaptureReader:
    """Iterator over the pieces of a capture file, sorted by time and read on demand; a context manager.

    Only as many pieces are held as are needed to sort neighbours, however large the file is. A file of up to about ten
    thousand pieces is sorted completely. It can be iterated once. Raises FileFormatError like `read_capture`, and for a
    piece that is too far out of order.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = _opened(path)
        try:
            with _readable(path):
                self._reader = _reader(path, self._file, _HELD)
        except BaseException:
            self._file.close()
            raise

    @property
    def provenance(self) -> Provenance:
        """Origin of the capture."""
        return self._reader.provenance

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences about skipped content; complete after all pieces have been read."""
        return tuple(self._reader.remarks)

    def __iter__(self) -> Iterator[Piece]:
        with _readable(self._path):
            held: list[Piece] = []
            coming, latest_s = self._reader.pieces(), 0.0
            while more := list(islice(coming, _HELD)):
                held = sorted(held + more, key=_time)
                if held[0].time_s < latest_s:
                    raise FileFormatError(
                        f"{self._path}: the piece at {held[0].time_s} s is more than {_HELD} pieces behind its place"
                    )
                ready, held = held[:-_HELD], held[-_HELD:]
                yield from ready
                latest_s = ready[-1].time_s if ready else latest_s
            yield from held

    def close(self) -> None:
        """Close the file; may be called again."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def open_capture(path: str | Path) -> CaptureReader:
    """Open a capture file in either format, whatever its name, to iterate over it however large it is."""
    return CaptureReader(Path(path))


def _reader(path: Path, file: BufferedReader, ahead: int | None) -> JsonLinesReader | PcapngReader | PrintedLogReader:
    began = file.peek(len(MAGIC))[: len(MAGIC)]
    if began == MAGIC:
        return PcapngReader(path, file, ahead)
    if began in _PCAP:
        raise FileFormatError(f"{path}: is a pcap file; save it as pcapng, for example with Wireshark")
    if path.suffix.lower() not in _FORMS and not began.startswith(b"{"):
        return PrintedLogReader(path, file)
    return JsonLinesReader(path, file)


def _opened(path: Path) -> BufferedReader:
    with _readable(path):
        return path.open("rb")


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    try:
        yield
    except FileNotFoundError:
        raise FileFormatError(no_such_file(path)) from None
    except OSError as error:
        raise FileFormatError(f"{path}: cannot read the capture ({error.strerror or error})") from error


def _time(piece: Piece) -> float:
    return piece.time_s


def check_place(path: Path) -> None:
    """Raise UsageError unless a capture can be written to this path; an existing file stays unchanged."""
    _form_of(path)
    existed = path.exists()
    try:
        path.open("ab").close()
        if not existed:
            path.unlink()
    except OSError as error:
        raise _cannot_write(path, error) from error


class CaptureWriter:
    """Writer of a capture file, which replaces an existing one; a context manager.

    path: its suffix selects the format, .jsonl or .pcapng. provenance: origin of the capture. Usable from several
    threads. Each piece is passed to the operating system immediately: if the program is killed, no added piece is lost,
    and at most the last one is incomplete. Raises UsageError for another suffix or if the file cannot be created.
    """

    def __init__(self, path: str | Path, provenance: Provenance) -> None:
        self._path = Path(path)
        self._form = _form_of(self._path)(provenance)
        self._lock = Lock()
        opening = self._form.opening()
        self._file: GrowingFile | None = None
        try:
            self._file = GrowingFile(self._path)
            self._file.add(opening)
        except OSError as error:
            self.close()
            raise _cannot_write(self._path, error) from error

    def add(self, piece: Piece) -> None:
        """Append a whole piece, or nothing if that fails. A piece without bytes is ignored.

        Raises UsageError for a time outside the capture. Raises FileFormatError if the file cannot be written, after
        which the call may be repeated.
        """
        if not 0 <= piece.time_s <= LONGEST_S:
            raise UsageError(f"a time of {piece.time_s} s is outside the range of a capture, 0 to 3e9 s")
        if not piece.data:
            return
        with self._lock:
            if self._file is None:
                raise UsageError(f"{self._path}: the capture is closed")
            try:
                self._file.add(self._form.piece(piece))
            except OSError as error:
                self._form.take_back()
                raise _cannot_write(self._path, error) from error

    def close(self) -> None:
        """Close the file; may be called again."""
        with self._lock:
            if self._file is not None:
                self._file.close()
                self._file = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _form_of(path: Path) -> type[JsonLines | Pcapng]:
    form = _FORMS.get(path.suffix.lower())
    if form is None:
        raise FileFormatError(f"{path} is not a capture file; name it .jsonl, or .pcapng for Wireshark")
    return form


def _cannot_write(path: Path, error: OSError) -> FileFormatError:
    return FileFormatError(f"{path}: the capture cannot be written ({error.strerror or error}); choose another file")
