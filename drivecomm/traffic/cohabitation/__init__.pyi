from .alphabets import readable as readable
from .check import Cohabitation as Cohabitation, check_line as check_line, listen as listen, wait_for as wait_for
from .drives import line_drives_of as line_drives_of
from .search import arbitrary_telegrams as arbitrary_telegrams, try_out as try_out
from .traffic_graph import TelegramFinder as TelegramFinder, character_map as character_map
from .verdicts import (
    MistakeProof as MistakeProof,
    PairVerdict as PairVerdict,
    ProofTelegram as ProofTelegram,
    Safety as Safety,
)
