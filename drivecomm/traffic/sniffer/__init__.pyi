from .choosing import Candidate as Candidate, choose as choose
from .detection import BAUD_RATES as BAUD_RATES, Detected as Detected, Overheard as Overheard, detect as detect
from .heard import (
    AmbiguousTelegram as AmbiguousTelegram,
    DamagedTelegram as DamagedTelegram,
    Finding as Finding,
    HeardTelegram as HeardTelegram,
    UnknownBytes as UnknownBytes,
)
from .names import ParameterNames as ParameterNames
from .pairing import Pair as Pair, Pairing as Pairing
from .readings import Reading as Reading
from .sniffer import Sniffer as Sniffer
from .tally import LINE as LINE
from .watching import Event as Event, Watch as Watch
