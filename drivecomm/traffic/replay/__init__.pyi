from .asking_again import (
    PATIENCE_S as PATIENCE_S,
    Asking as Asking,
    Outcome as Outcome,
    Sending as Sending,
    difference as difference,
)
from .conversation import Exchanged as Exchanged, Part as Part, exchanged as exchanged
from .recorded_drive import (
    RecordedCodec as RecordedCodec,
    RecordedRequest as RecordedRequest,
    recorded_drives as recorded_drives,
)
from .replayed import ReplayError as ReplayError, replayed as replayed
from .requests import described as described, meanings as meanings, only_asks as only_asks
from .telling_apart import telling_apart as telling_apart
from .vector_text import _written as _written, heard_telegrams as heard_telegrams, vectors_text as vectors_text
