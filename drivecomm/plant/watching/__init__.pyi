from .asked import (
    OpenLine as OpenLine,
    SeenDrive as SeenDrive,
    WatchedLine as WatchedLine,
    has_answered as has_answered,
    is_silence as is_silence,
    lines_of as lines_of,
)
from .board import (
    Board as Board,
    DriveEvent as DriveEvent,
    DriveView as DriveView,
    Reachability as Reachability,
    Trend as Trend,
    WatchedValue as WatchedValue,
    changes as changes,
    state_words as state_words,
)
from .watcher import Watcher as Watcher
