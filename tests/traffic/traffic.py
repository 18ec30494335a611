"""Traffic of a virtual plant, and the telegrams that were really sent."""

from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from random import Random

import drivecomm
from drivecomm.capture import Piece
from drivecomm.errors import DriveCommError
from drivecomm.models import load_model
from drivecomm.plant import FaultPlan
from drivecomm.protocol import installed
from drivecomm.traffic.sniffer import HeardTelegram, Sniffer
from drivecomm.virtual import VirtualLine, virtual_drive

SETTINGS = {"baudrate": 9600, "bytesize": 8, "parity": "N"}
PROTOCOLS = tuple(each for each in installed.working() if each.name not in ("movilink", "weg"))
"""Without MOVILINK: a process block to Danfoss drive 3 on these lines is also a sound telegram of MOVILINK.

Without WEG: its drives acknowledge like those of VABus.
"""
MODELS = {
    "vabus": "agile",
    "danfoss-fc": "fc300",
    "vlt3500": "vlt3500",
    "fuji": "frenic",
    "modbus": "danfoss-fc",
    "uss": "micromaster4",
}
DIRECTIONS = {"master": "request", "drive": "reply"}


class Meant(bytes):
    """Bytes that arrive unchanged."""


class Recorded(FaultPlan):
    """Faults that mark the bytes that they leave unchanged."""

    def request(self, data):
        return marked(data, super().request(data))

    def reply(self, data):
        return marked(data, super().reply(data))


def marked(data, arriving):
    return [(delay, Meant(data) if each == data else each) for delay, each in arriving]


@dataclass
class Traffic:
    """All transmissions on the wire."""

    sent: list

    @property
    def undamaged(self):
        """Number of unchanged telegrams on the wire by direction, bytes and time."""
        return Counter(told(one) for one in self.sent if isinstance(one.data, Meant) and not one.garbled)

    @property
    def on_the_wire(self):
        return Counter(told(one) for one in self.sent)

    def pieces(self):
        """Return one piece for each transmission, without its source."""
        return [Piece(time_s=one.ended, data=one.data, settings=one.settings) for one in self.sent]


def told(one):
    return DIRECTIONS.get(one.source), bytes(one.data), round(one.ended, 6)


@cache
def model_of(protocol):
    return load_model(installed[protocol].package, protocol, MODELS[protocol])


def drives_of(names, **settings):
    return [virtual_drive(protocol, address, model=model_of(protocol), **settings) for protocol, address in names]


ALL = (("vabus", 1), ("vabus", 2), ("danfoss-fc", 3), ("vlt3500", 4), ("fuji", 5))


def actions(bus, names, random, **settings):
    """Return actions on the drives of a plant: reads, writes, status requests and references."""
    read = {
        "vabus": ("481", "480", "10"),
        "danfoss-fc": ("16-30", "3-41", "16-14"),
        "vlt3500": ("516", "502[17]", "513"),
        "fuji": ("F07", "M09", "F03"),
    }
    written = {"vabus": "480", "danfoss-fc": "3-41", "fuji": "F07"}
    reference = {"vabus": "520", "fuji": "S01"}
    doing = []
    for protocol, address in names:
        drive = bus.drive(protocol, address, model=model_of(protocol), **settings)
        doing += [lambda drive=drive, parameter=parameter: drive.read(parameter) for parameter in read[protocol]]
        if protocol in written:
            name = written[protocol]
            doing.append(lambda drive=drive, name=name: drive.write(name, random.randint(1, 40)))
        doing.append(lambda drive=drive: drive.status())
        if protocol == "danfoss-fc":
            # With a reference, the drive would be read first, but each action here sends one telegram.
            doing.append(lambda drive=drive: drive.call("control_word", word=0x043C | random.randint(0, 3)))
            continue
        name = reference.get(protocol)
        doing.append(lambda drive=drive, name=name: _refer(drive, name, random.randint(0, 100)))
    return doing


def _refer(drive, name, percent):
    """Set the reference with one request and one reply, as a master does that reads nothing before."""
    if name is None:
        drive.set_reference(percent=percent)
    else:
        drive.write(name, percent if name == "520" else percent * 200)


PAUSES = (0.0, 0.005, 0.03, 0.4)


def plant(seconds, *, telegrams=10**9, rate=0.0, seed=0, names=ALL, pauses=PAUSES, settings=SETTINGS, **faults):
    """Return the traffic of this time in seconds, of at most about `telegrams` telegrams."""
    random = Random(seed)
    plan = Recorded(rate=rate, seed=seed, **faults)
    line = VirtualLine(drives_of(names, **settings), faults=plan)
    sent = []
    line.monitors.append(sent.append)
    with drivecomm.open_bus(line.port) as bus:
        doing = actions(bus, names, random, **settings)
        while line.time < seconds and len(sent) < telegrams:
            with suppress(DriveCommError):
                random.choice(doing)()
            line.advance(random.choice(pauses))
    line.advance(10)
    return Traffic(sent)


def sniffed(pieces, protocols=PROTOCOLS, **options):
    sniffer = Sniffer(protocols, **options)
    found = [finding for piece in pieces for finding in sniffer.feed(piece)]
    return found + sniffer.finish()


def telegrams(findings):
    return [finding for finding in findings if isinstance(finding, HeardTelegram)]


def heard(findings):
    return Counter((one.direction, one.data, round(one.time_s, 6)) for one in telegrams(findings))
