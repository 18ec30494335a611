"""Watching a plant: what its drives do now and did lately, apart from any screen."""

from drivecomm.watching.board import Board as Board
from drivecomm.watching.board import DriveView as DriveView
from drivecomm.watching.board import WatchedValue as WatchedValue
from drivecomm.watching.happenings import Happening as Happening
from drivecomm.watching.history import Trend as Trend
from drivecomm.watching.watched import WatchedDrive as WatchedDrive
from drivecomm.watching.watched import WatchedLine as WatchedLine
from drivecomm.watching.watched import lines_of as lines_of
from drivecomm.watching.watcher import Watcher as Watcher
