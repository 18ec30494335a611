"""Listening to a line on which others talk: what was said, who said it, what it answers and how long that took."""

from drivecomm.sniffer.detection import Detected as Detected
from drivecomm.sniffer.detection import detect as detect
from drivecomm.sniffer.heard import AmbiguousTelegram as AmbiguousTelegram
from drivecomm.sniffer.heard import DamagedTelegram as DamagedTelegram
from drivecomm.sniffer.heard import Finding as Finding
from drivecomm.sniffer.heard import HeardTelegram as HeardTelegram
from drivecomm.sniffer.heard import UnknownBytes as UnknownBytes
from drivecomm.sniffer.names import ParameterNames as ParameterNames
from drivecomm.sniffer.pairing import Pair as Pair
from drivecomm.sniffer.pairing import Pairing as Pairing
from drivecomm.sniffer.sniffer import Sniffer as Sniffer
from drivecomm.sniffer.watching import Event as Event
from drivecomm.sniffer.watching import Watch as Watch
