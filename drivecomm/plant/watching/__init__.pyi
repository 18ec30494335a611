from .board import (
    Board as Board,
    DriveEvent as DriveEvent,
    DriveView as DriveView,
    Trend as Trend,
    WatchedValue as WatchedValue,
    state_words as state_words,
)
from .watched import WatchedLine as WatchedLine, lines_of as lines_of
from .watcher import Watcher as Watcher
