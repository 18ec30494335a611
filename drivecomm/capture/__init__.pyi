from .files import CaptureWriter as CaptureWriter, read_capture as read_capture
from .growing_file import TRIED_AGAIN_S as TRIED_AGAIN_S, Gaps as Gaps, GrowingFile as GrowingFile
from .json_lines import JsonLines as JsonLines, read_json_lines as read_json_lines
from .pcapng_fields import MAGIC as MAGIC
from .pcapng_reading import read_pcapng as read_pcapng
from .pcapng_writing import Pcapng as Pcapng
from .pieces import Capture as Capture, Piece as Piece, Provenance as Provenance, Source as Source
from .recording import Record as Record, RecordedPort as RecordedPort, Recording as Recording
