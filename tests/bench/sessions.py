"""Recorded sessions of programs on virtual lines."""

import contextlib

import drivecomm
from drivecomm.capture import Capture, Provenance
from drivecomm.virtual import VirtualLine, virtual_drive

ADDRESSES = {"vabus": 1, "danfoss-fc": 3, "vlt3500": 5, "fuji": 7}
"""Drive address by protocol. USS is left out, because its telegrams are valid Danfoss FC telegrams as well."""
READS = {"vabus": "481", "danfoss-fc": "16-30", "vlt3500": "215", "fuji": "M21"}


class Recorded(list):
    """A recorder whose `capture` contains the pieces recorded so far."""

    def add(self, piece):
        self.append(piece)

    @property
    def capture(self):
        return Capture(provenance=Provenance(), pieces=list(self))


def everybody(**options):
    return VirtualLine([virtual_drive(name, address) for name, address in ADDRESSES.items()], **options)


def record(program, line=None):
    """Run a program on a bus; return the capture of the session and the program's result."""
    recorded = Recorded()
    with drivecomm.open_bus((line or everybody()).port, record=recorded) as bus:
        result = program(bus)
    return recorded.capture, result


def read_everybody(bus):
    return [bus.drive(name, address).read(READS[name]).raw for name, address in ADDRESSES.items()]


def work_with_everybody(bus):
    """Read from and command each drive, and try an absent drive."""
    seen = []
    for name, address in ADDRESSES.items():
        drive = bus.drive(name, address)
        seen.append(drive.read(READS[name]).raw)
        drive.set_reference(percent=20)
        drive.start()
        seen.append(drive.status().word)
        drive.stop()
    with contextlib.suppress(drivecomm.NoReplyError):
        bus.drive("fuji", 9, attempts=2).read("M21")
    return seen
