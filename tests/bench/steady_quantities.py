"""Parameters of a virtual drive that hold a set value and affect nothing else, so that wrong values show."""

from dataclasses import dataclass, field
from random import Random

import drivecomm
from drivecomm.errors import DriveCommError
from drivecomm.virtual import VirtualLine, virtual_drive

PARAMETERS = 40


@dataclass
class Quantity:
    """A parameter that keeps its set value.

    readings: physical value by raw value. writable: raw values that can be written.
    """

    address: str
    readings: dict = field(default_factory=dict)
    writable: list = field(default_factory=list)
    store: bool = False


@dataclass
class Bench:
    """One virtual drive on an undisturbed line, and the drive as the bus sees it."""

    random: Random
    line: VirtualLine
    virtual: object
    drive: object

    def held(self, name):
        try:
            return self.virtual.peek(name, self.line.time)
        except DriveCommError:
            return None

    def takes(self, name, raw):
        try:
            self.virtual.poke(name, raw)
            self.line.advance(2.0)
            return self.virtual.peek(name, self.line.time) == raw
        except (DriveCommError, ValueError):
            return False

    def write_works(self, quantity, raw, value):
        for store in (False, True):
            try:
                self.drive.write(quantity.address, value, store=store)
            except DriveCommError:
                continue
            quantity.store = store
            return self.held(quantity.address) == raw
        return False


def quantities(plugin, model, seed):
    """Return the steady parameters of a drive, found on an undisturbed line."""
    random = Random(seed)
    address = plugin.addresses[0]
    virtual = virtual_drive(plugin.name, address)
    line = VirtualLine([virtual])
    found = []
    with drivecomm.open_bus(line.port) as bus:
        bench = Bench(random, line, virtual, bus.drive(plugin.name, address, model=model))
        readable = [name for name in model.parameters if bench.held(name) is not None]
        for name in random.sample(readable, min(PARAMETERS, len(readable))):
            quantity = explore(bench, name, [each for each in readable if each != name])
            if quantity is not None:
                found.append(quantity)
    return found


def explore(bench, name, others):
    before = {each: bench.held(each) for each in others}
    original = bench.held(name)
    quantity = Quantity(name)
    for raw in candidates(bench.random, original):
        if not bench.takes(name, raw):
            continue
        try:
            reading = bench.drive.read(name)
        except DriveCommError:
            continue
        assert reading.raw == raw, f"{name} holds {raw!r} and reads {reading.raw!r} on an undisturbed line"
        quantity.readings[raw] = reading.value
    quantity.writable = [raw for raw, value in quantity.readings.items() if bench.write_works(quantity, raw, value)]
    bench.virtual.poke(name, original)
    untouched = all(bench.held(each) == before[each] for each in others)
    return quantity if len(quantity.readings) > 1 and untouched and not bench.virtual.motor.running else None


def candidates(random, original):
    """Return values that this parameter might accept, with the original first."""
    if isinstance(original, int):
        return distinct(original, (max(0, original + random.randint(-original // 2, original + 60)) for _ in range(6)))
    if original and all(character in "0123456789ABCDEF" for character in original):
        return distinct(original, (f"{random.randrange(16 ** len(original)):0{len(original)}X}" for _ in range(6)))
    letters = "ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"
    return distinct(original, ("".join(random.choices(letters, k=len(original))) for _ in range(6)))


def distinct(original, others):
    """Return each value once, in order of appearance; the order of a set would differ between runs."""
    return list(dict.fromkeys([original, *others]))
