"""What was heard on a line, as data: pieces of bytes with their time, in files that other programs read, too."""

from drivecomm.capture.files import CaptureWriter as CaptureWriter
from drivecomm.capture.files import read_capture as read_capture
from drivecomm.capture.pieces import Capture as Capture
from drivecomm.capture.pieces import Piece as Piece
from drivecomm.capture.pieces import Provenance as Provenance
from drivecomm.capture.replayed import replayed as replayed
