from .exchanges import (
    RecordedExchange as RecordedExchange,
    ReplyPart as ReplyPart,
    decoded_requests as decoded_requests,
    infer_sources as infer_sources,
    only_asks as only_asks,
    recorded_exchanges as recorded_exchanges,
    request_as_text as request_as_text,
)
from .recorded_drive import (
    RecordedCodec as RecordedCodec,
    RecordedRequest as RecordedRequest,
    recorded_drives as recorded_drives,
)
from .replay_line import ReplayError as ReplayError, replayed as replayed
from .replay_master import (
    PATIENCE_S as PATIENCE_S,
    ReplayedRequest as ReplayedRequest,
    ReplayMaster as ReplayMaster,
    Sending as Sending,
    difference as difference,
)
from .telegrams_of_logs import (
    Printed as Printed,
    by_the_masters_side as by_the_masters_side,
    telegrams_of_log as telegrams_of_log,
)
from .vector_files import heard_telegrams as heard_telegrams, vectors_text as vectors_text
