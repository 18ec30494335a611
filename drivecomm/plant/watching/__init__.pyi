from .board import Board as Board, DriveView as DriveView, WatchedValue as WatchedValue
from .happenings import Happening as Happening, state_words as state_words
from .history import Trend as Trend
from .watched import WatchedDrive as WatchedDrive, WatchedLine as WatchedLine, lines_of as lines_of
from .watcher import Watcher as Watcher
