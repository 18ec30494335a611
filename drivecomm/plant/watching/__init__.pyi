from .asked import WatchedLine as WatchedLine, lines_of as lines_of
from .board import (
    Board as Board,
    DriveEvent as DriveEvent,
    DriveView as DriveView,
    Reachability as Reachability,
    Trend as Trend,
    WatchedValue as WatchedValue,
    state_words as state_words,
)
from .watcher import Watcher as Watcher
