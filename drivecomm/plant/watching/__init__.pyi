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
from .watched_drive import (
    OpenLine as OpenLine,
    TrackedDrive as TrackedDrive,
    WatchedLine as WatchedLine,
    has_answered as has_answered,
    is_silence as is_silence,
    lines_of as lines_of,
)
from .watcher import Watcher as Watcher
