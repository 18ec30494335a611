"""Virtual drives under proof, with counters of their requests."""

from collections import Counter

import drivecomm
from drivecomm.models import load_model, packaged_models, read_model
from drivecomm.protocol import Framed, installed
from drivecomm.proving import ProofSubject, Proving
from drivecomm.virtual import DriveProxy, VirtualLine, virtual_drive


def all_models():
    """Return each packaged model of each installed protocol, by PROTOCOL/MODEL."""
    return {
        f"{plugin.name}/{path.stem}": read_model(path, plugin.name, plugin.package)
        for plugin in installed.working()
        for path in packaged_models(plugin.package)
    }


def model(protocol, name):
    return load_model(installed[protocol].package, protocol, name)


def address_for(protocol):
    """Return a drive address of a protocol that is not a common value of other parameters."""
    return next(each for each in installed[protocol].addresses if each)


class Counting(DriveProxy):
    """Wrapper of a drive that counts requests that move nothing, writes, and commands."""

    def __init__(self, inner, protocol):
        super().__init__(inner)
        self.counts = Counter()
        self._intent = installed[protocol].intent

    def hear(self, find, now):
        if isinstance(find, Framed):
            intent = self._intent(find.message)
            self.counts["commands"] += intent.commands
            self.counts["writes"] += intent.access == "write"
            self.counts["asks"] += intent.moves_nothing
        reply = super().hear(find, now)
        self.counts["turns"] += self.motor.running
        return reply


def proved(protocol, honest, drive, **options):
    """Prove a virtual drive against a model over a virtual line; return the proof."""
    line = VirtualLine([drive])
    with drivecomm.open_bus(line.port) as bus:
        one = bus.drive(protocol, drive.address, model=honest, read_only=True)
        proving = Proving(one, ProofSubject.of(protocol, honest, {}), **options)
        proving.run()
    return proving


def drive_of(protocol, known):
    return Counting(virtual_drive(protocol, address_for(protocol), model=known), protocol)


def contradictions(proving):
    return [each for each in proving.findings if each.verdict == "contradicts"]
