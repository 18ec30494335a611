from .exchanges import (
    Exchanged as Exchanged,
    Part as Part,
    described as described,
    exchanged as exchanged,
    meanings as meanings,
    only_asks as only_asks,
    telling_apart as telling_apart,
)
from .recorded_drive import (
    RecordedCodec as RecordedCodec,
    RecordedRequest as RecordedRequest,
    recorded_drives as recorded_drives,
)
from .replay_line import ReplayError as ReplayError, replayed as replayed
from .replay_master import (
    PATIENCE_S as PATIENCE_S,
    Asking as Asking,
    Outcome as Outcome,
    Sending as Sending,
    difference as difference,
)
from .vector_files import heard_telegrams as heard_telegrams, vectors_text as vectors_text
