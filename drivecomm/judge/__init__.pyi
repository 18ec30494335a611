from .catalogue import JudgeCase as JudgeCase, catalogue as catalogue
from .coverage import Coverage as Coverage, Covered as Covered
from .judge import AT_ONCE as AT_ONCE, Judge as Judge, seed_of as seed_of
from .junit import junit as junit
from .known_drive import KnownDrive as KnownDrive
from .manual import ManualMaster as ManualMaster
from .masters import Master as Master, StartedMaster as StartedMaster
from .order import TASKS as TASKS, JudgeOrder as JudgeOrder, JudgeTask as JudgeTask, parse_task as parse_task
from .order_files import read_order as read_order
from .report import JudgeReport as JudgeReport, as_data as as_data, page as page
from .verdicts import Verdict as Verdict
