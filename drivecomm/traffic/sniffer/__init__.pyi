from .detection import Detected as Detected, LineSample as LineSample, detect as detect
from .expected_drives import protocols_for as protocols_for, recorded_with as recorded_with
from .line_monitor import (
    LINE as LINE,
    LineEvent as LineEvent,
    LineMonitor as LineMonitor,
    Pair as Pair,
    Pairing as Pairing,
)
from .names import HeardParameterNames as HeardParameterNames
from .readings import Candidate as Candidate, TelegramReading as TelegramReading, choose as choose
from .sniffer import Sniffer as Sniffer
from .traffic_items import (
    AmbiguousTelegram as AmbiguousTelegram,
    DamagedTelegram as DamagedTelegram,
    HeardTelegram as HeardTelegram,
    TrafficItem as TrafficItem,
    UnknownBytes as UnknownBytes,
)
