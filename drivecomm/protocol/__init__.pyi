from .address_space import NO_ELEMENTS as NO_ELEMENTS, AddressSpace as AddressSpace, Elements as Elements
from .answered_verbs import needs_answer as needs_answer
from .argument_types import (
    choices_of as choices_of,
    is_duration as is_duration,
    is_whole as is_whole,
    wrong_argument as wrong_argument,
)
from .broadcast_stops import commanded_by_model as commanded_by_model, one_stop_fits_all as one_stop_fits_all
from .caching import cached as cached
from .code_texts import code_texts as code_texts, tables_beside as tables_beside
from .contract import (
    DESCRIBE as DESCRIBE,
    LINE_ERROR as LINE_ERROR,
    Capabilities as Capabilities,
    Intent as Intent,
    KnowsSeries as KnowsSeries,
    KnowsStarts as KnowsStarts,
    Memory as Memory,
    Operations as Operations,
    Protocol as Protocol,
    ReadsMany as ReadsMany,
    SeriesFound as SeriesFound,
)
from .drive_config import (
    LONGEST_DELAY_S as LONGEST_DELAY_S,
    NETWORK_VERBS as NETWORK_VERBS,
    DriveConfig as DriveConfig,
    LinkLossPolicy as LinkLossPolicy,
    NetworkAccess as NetworkAccess,
    PollGroup as PollGroup,
    Tag as Tag,
    parse_drive as parse_drive,
    parse_options as parse_options,
)
from .drive_repr import DriveRepr as DriveRepr
from .entry_points import later as later
from .exchange import (
    Ask as Ask,
    Exchange as Exchange,
    Pause as Pause,
    Tell as Tell,
    run_with_answers as run_with_answers,
    unless_refused as unless_refused,
    with_each_command as with_each_command,
    with_first_command as with_first_command,
    without_repeats as without_repeats,
)
from .float32 import float_bits as float_bits, float_of as float_of
from .framing import (
    Codec as Codec,
    Damaged as Damaged,
    Find as Find,
    Framed as Framed,
    Framer as Framer,
    Noise as Noise,
    begins_again as begins_again,
)
from .frozen_factory import frozen_factory as frozen_factory
from .line import (
    LINE_FACT_NAMES as LINE_FACT_NAMES,
    SETTING_NAMES as SETTING_NAMES,
    USUAL_BAUD_RATES as USUAL_BAUD_RATES,
    LineFacts as LineFacts,
    LineSettings as LineSettings,
    Parity as Parity,
    Timing as Timing,
)
from .machine_unit import (
    SPEED_QUANTITIES as SPEED_QUANTITIES,
    MachineUnit as MachineUnit,
    MachineValue as MachineValue,
)
from .model import (
    CERTAIN as CERTAIN,
    DOUBTFUL as DOUBTFUL,
    WATCHDOG_PROOF as WATCHDOG_PROOF,
    Access as Access,
    LinkLoss as LinkLoss,
    MadeFrom as MadeFrom,
    Model as Model,
    PanelSetting as PanelSetting,
    ParameterInfo as ParameterInfo,
    ParameterKind as ParameterKind,
    Proved as Proved,
    Purpose as Purpose,
    Storage as Storage,
    Sureness as Sureness,
    Watchdog as Watchdog,
)
from .motor import Motor as Motor, MotorCommand as MotorCommand
from .options import (
    ABOUT_THE_DRIVE as ABOUT_THE_DRIVE,
    CONFIRMED as CONFIRMED,
    CONFIRMED_FACTS as CONFIRMED_FACTS,
    checked_address as checked_address,
    line_overrides as line_overrides,
    option_names as option_names,
    protocol_options as protocol_options,
    resolve_options as resolve_options,
)
from .parameter_store import ParameterStore as ParameterStore
from .reading import (
    Quality as Quality,
    Reading as Reading,
    Value as Value,
    exact as exact,
    is_plain as is_plain,
    must_know_type as must_know_type,
    new_reading as new_reading,
    reference_limit_of as reference_limit_of,
    scaled as scaled,
    unscaled as unscaled,
    whole_number as whole_number,
)
from .refusal import Refusal as Refusal, refusals_as_address_errors as refusals_as_address_errors
from .registry import (
    Protocols as Protocols,
    decode as decode,
    encode as encode,
    installed as installed,
    protocols as protocols,
    unknown_protocol as unknown_protocol,
)
from .request_addressing import is_broadcast as is_broadcast, is_for as is_for
from .status import (
    DriveState as DriveState,
    DriveStatus as DriveStatus,
    StateName as StateName,
    Stop as Stop,
    StopName as StopName,
    way_to_stop as way_to_stop,
)
from .store_rule import check_store as check_store
from .telegram import (
    Direction as Direction,
    Message as Message,
    Telegram as Telegram,
    difference as difference,
    fields_of as fields_of,
)
from .virtual_drive import Refuses as Refuses, VirtualDrive as VirtualDrive, VirtualReply as VirtualReply
from .word_format import WORD_TYPES as WORD_TYPES, WordFormat as WordFormat
