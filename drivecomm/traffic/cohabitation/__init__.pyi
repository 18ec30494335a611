from .alphabets import readable as readable
from .check import Cohabitation as Cohabitation, check_line as check_line, listen as listen, wait_for as wait_for
from .drives import partners_of as partners_of
from .search import arbitrary_telegrams as arbitrary_telegrams, try_out as try_out
from .traffic import Reader as Reader, character_map as character_map
from .verdicts import PairVerdict as PairVerdict, Proof as Proof, ProofTelegram as ProofTelegram, Safety as Safety
