from .journal import Journal as Journal
from .reading import History as History
from .records import (
    FaultLogEntry as FaultLogEntry,
    PastCommand as PastCommand,
    PastEvent as PastEvent,
    PastValue as PastValue,
    Quantity as Quantity,
    log_row as log_row,
)
from .store import Store as Store
from .summaries import Summary as Summary, summarized as summarized
from .thinning import Point as Point
