from .board import (
    Board as Board,
    DriveEvent as DriveEvent,
    DriveView as DriveView,
    WatchedValue as WatchedValue,
    state_words as state_words,
)
from .history import Trend as Trend
from .watched import WatchedLine as WatchedLine, lines_of as lines_of
from .watcher import Watcher as Watcher
