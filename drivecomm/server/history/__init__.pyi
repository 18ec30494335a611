from .journal import HistoryWriter as HistoryWriter
from .reading import History as History
from .records import (
    FaultLogEntry as FaultLogEntry,
    PastCommand as PastCommand,
    PastEvent as PastEvent,
    PastValue as PastValue,
    StoredQuantity as StoredQuantity,
    log_row as log_row,
)
from .store import HistoryFile as HistoryFile
from .summaries import PeriodSummary as PeriodSummary, summarized as summarized
from .thinning import CoursePoint as CoursePoint
