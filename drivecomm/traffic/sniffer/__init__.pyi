from .detection import BAUD_RATES as BAUD_RATES, Detected as Detected, Overheard as Overheard, detect as detect
from .findings import (
    AmbiguousTelegram as AmbiguousTelegram,
    DamagedTelegram as DamagedTelegram,
    Finding as Finding,
    HeardTelegram as HeardTelegram,
    UnknownBytes as UnknownBytes,
)
from .line_monitor import LINE as LINE, Event as Event, Pair as Pair, Pairing as Pairing, Watch as Watch
from .names import ParameterNames as ParameterNames
from .readings import Candidate as Candidate, Reading as Reading, choose as choose
from .sniffer import Sniffer as Sniffer
