from .command_order import CommandCall as CommandCall, CommandHistory as CommandHistory
from .damage import (
    Damage as Damage,
    likely_damage as likely_damage,
    telegrams_among_noise as telegrams_among_noise,
)
from .echo import Echo as Echo, EchoFilter as EchoFilter
from .health import (
    FIRST_PAUSE_S as FIRST_PAUSE_S,
    LONGEST_PAUSE_S as LONGEST_PAUSE_S,
    PROBING_SHARE as PROBING_SHARE,
    REOPEN_FIRST_S as REOPEN_FIRST_S,
    REOPEN_LONGEST_S as REOPEN_LONGEST_S,
    Backoff as Backoff,
    Health as Health,
    ProbingTime as ProbingTime,
    TuningWatch as TuningWatch,
    UsualDelays as UsualDelays,
)
from .held_back import HeldBack as HeldBack
from .link import Link as Link
from .logs import LOGGER_NAME as LOGGER_NAME, log_events as log_events
from .other_masters import CAREFUL_S as CAREFUL_S, SHARED_S as SHARED_S
from .peer import Peer as Peer, TraceEvent as TraceEvent
from .port import (
    Arrival as Arrival,
    Configure as Configure,
    Effect as Effect,
    LinkSteps as LinkSteps,
    Port as Port,
    PortProxy as PortProxy,
    Receive as Receive,
    Send as Send,
    SingleEffect as SingleEffect,
    Transaction as Transaction,
    Wait as Wait,
    split_transactions as split_transactions,
)
from .statistics import (
    COUNTERS as COUNTERS,
    REPLY_TIME_BOUNDS_MS as REPLY_TIME_BOUNDS_MS,
    ReplyTimes as ReplyTimes,
    Statistics as Statistics,
    total as total,
)
from .tracing import (
    ARROWS as ARROWS,
    combine_traces as combine_traces,
    fields_text as fields_text,
    hex_text as hex_text,
    line_text as line_text,
    trace_data as trace_data,
    trace_line as trace_line,
)
