from .argument_types import is_duration as is_duration, is_whole as is_whole, misfit as misfit
from .contract import (
    Capabilities as Capabilities,
    Memory as Memory,
    Operations as Operations,
    Protocol as Protocol,
    Purpose as Purpose,
    VirtualDrive as VirtualDrive,
    VirtualReply as VirtualReply,
)
from .decoding import decode as decode, encode as encode
from .exchange import Ask as Ask, Exchange as Exchange, Pause as Pause, Tell as Tell
from .framing import (
    Codec as Codec,
    Damaged as Damaged,
    Find as Find,
    Framed as Framed,
    Framer as Framer,
    Noise as Noise,
)
from .line import (
    LINE_FACT_NAMES as LINE_FACT_NAMES,
    LineFacts as LineFacts,
    LineSettings as LineSettings,
    Parity as Parity,
    Timing as Timing,
)
from .model import (
    Access as Access,
    Kind as Kind,
    LinkLoss as LinkLoss,
    Model as Model,
    ParameterInfo as ParameterInfo,
    Storage as Storage,
    Sureness as Sureness,
    Watchdog as Watchdog,
)
from .motor import Command as Command, Motor as Motor
from .numbers import exact as exact, scaled as scaled, unscaled as unscaled
from .options import option_names as option_names, sort_out as sort_out
from .reading import Reading as Reading, Value as Value
from .registry import (
    Protocols as Protocols,
    installed as installed,
    protocols as protocols,
    unknown_protocol as unknown_protocol,
)
from .status import DriveState as DriveState, DriveStatus as DriveStatus, Stop as Stop
from .telegram import Direction as Direction, Message as Message, Telegram as Telegram, fields_of as fields_of
