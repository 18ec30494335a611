from .alphabets import readable as readable
from .check import Cohabitation as Cohabitation, check_line as check_line, listen as listen, wait_for as wait_for
from .drives import LineDrive as LineDrive, partners_of as partners_of
from .search import conversation as conversation, try_out as try_out
from .traffic import Reader as Reader, character_map as character_map
from .verdicts import Outcome as Outcome, Proof as Proof, ProofTelegram as ProofTelegram, Verdict as Verdict
