from .files import (
    CaptureReader as CaptureReader,
    CaptureWriter as CaptureWriter,
    capture_in as capture_in,
    open_capture as open_capture,
    read_capture as read_capture,
)
from .growing_file import TRIED_AGAIN_S as TRIED_AGAIN_S, GrowingFile as GrowingFile, WriteGaps as WriteGaps
from .json_lines import JsonLines as JsonLines
from .pcapng_fields import MAGIC as MAGIC
from .pcapng_writing import Pcapng as Pcapng
from .pieces import Capture as Capture, Piece as Piece, Provenance as Provenance, Source as Source
from .printed_bytes import bytes_of as bytes_of
from .printed_log import (
    PRINTED_LOG as PRINTED_LOG,
    LogPiece as LogPiece,
    PrintedLogReader as PrintedLogReader,
    read_log as read_log,
)
from .recording import Record as Record, RecordedPort as RecordedPort, Recording as Recording
