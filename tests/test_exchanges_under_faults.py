"""Many exchanges on a line where every tenth transmission is disturbed: late, cut, changed, doubled or gone.

A reading may fail, and then with an error of the tree. What it may never do is show a value that the drive did not
hold for that parameter at a time when it could have been asked for it. DRIVECOMM_EXCHANGES sets the number of exchanges
for each protocol, DRIVECOMM_SEED another course of events.
"""

import os
from collections import Counter
from dataclasses import dataclass, field
from random import Random

import pytest

import drivecomm
from drivecomm.errors import DriveCommError
from drivecomm.models import load_model
from drivecomm.registry import installed
from drivecomm.virtual import FaultPlan, VirtualLine, virtual_drive
from drivecomm.virtual.faults import Fault

EXCHANGES = int(os.environ.get("DRIVECOMM_EXCHANGES", "3000"))
SEED = int(os.environ.get("DRIVECOMM_SEED", "20"))

PARAMETERS = 40
DELAY_S = 1.0

# A request and its reply can both be late, and the link asks up to three times.
HORIZON_S = 2 * DELAY_S + 2.0


@dataclass
class Quantity:
    """A parameter that stays as it is set. readings: raw to physical value. writable: the raws that a write can set."""

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


def quantities(plugin, model):
    """Find out on an undisturbed line which parameters hold what is put into them and touch nothing else."""
    random = Random(SEED)
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
    """Values that this parameter might hold as well."""
    if isinstance(original, int):
        return distinct(original, (max(0, original + random.randint(-original // 2, original + 60)) for _ in range(6)))
    if original and all(character in "0123456789ABCDEF" for character in original):
        return distinct(original, (f"{random.randrange(16 ** len(original)):0{len(original)}X}" for _ in range(6)))
    letters = "ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"
    return distinct(original, ("".join(random.choices(letters, k=len(original))) for _ in range(6)))


def distinct(original, others):
    """Each value once, in the order in which they came: the order of a set is not the same in every run."""
    return list(dict.fromkeys([original, *others]))


class Watched:
    """A virtual drive, and what it held when."""

    def __init__(self, drive):
        self.line = None
        self._drive = drive
        self._held = {}
        self._asked = {}
        self._current = ""
        self._written = {}

    def __getattr__(self, name):
        return getattr(self._drive, name)

    def hear(self, find, now):
        answer = self._drive.hear(find, now)
        # Whoever it was for: a disturbed address can make a write one for another drive, or for all.
        self._look(now)
        return answer

    def begin(self, name):
        """Remember that this question is put, and what is held then; returns the time."""
        now = self.line.time
        self._note(name, now)
        times = [time for time in self._asked.get(name, []) if now - time < HORIZON_S]
        self._asked[name] = [*times, now]
        self._current = name
        return now

    def wrote(self, name, now):
        """Keep looking at this parameter: the write may be carried out later, and twice."""
        self._written[name] = now

    def poke(self, name, raw):
        now = self.line.time
        self._note(name, now)
        self._drive.poke(name, raw)
        self._note(name, now)

    def held_for(self, name, since):
        """Return the values that were held at any time since then."""
        history = self._held[name]
        start = max((place for place, (time, _) in enumerate(history) if time <= since), default=0)
        return [raw for _, raw in history[start:]]

    def could_answer(self, name):
        """Return the values that an answer to this question can show, late ones of the same question included."""
        return self.held_for(name, min(self._asked[name]))

    def _look(self, now):
        if self._current:
            # Some registers say what the drive has heard, so they change by what happens on the line.
            self._note(self._current, now)
        for name, written in list(self._written.items()):
            if now - written > HORIZON_S:
                del self._written[name]
            else:
                self._note(name, now)

    def _note(self, name, now):
        raw = self._drive.peek(name, now)
        history = self._held.setdefault(name, [])
        if not history or history[-1][1] != raw:
            history.append((now, raw))
            del history[:-200]


@pytest.mark.parametrize("plugin", list(installed.working()), ids=lambda plugin: plugin.name)
def test_no_wrong_value_and_no_stray_error(plugin):
    model = load_model(plugin.package, plugin.name, plugin.default_model)
    known = quantities(plugin, model)
    writable = [quantity for quantity in known if quantity.writable]
    assert len(known) >= 10
    assert writable

    random = Random(SEED + 1)
    faults = FaultPlan(rate=0.10, seed=SEED + 2, delay_s=DELAY_S)
    addresses = [plugin.addresses[0], plugin.addresses[1], plugin.addresses[-1]]
    virtual = {address: Watched(virtual_drive(plugin.name, address)) for address in addresses}
    line = VirtualLine(virtual.values(), faults=faults)
    for each in virtual.values():
        each.line = line
    outcomes = Counter()
    with drivecomm.open_bus(line.port) as bus:
        drives = {address: bus.drive(plugin.name, address, model=model) for address in addresses}
        for number in range(EXCHANGES):
            where = f"exchange {number} of {plugin.name}, DRIVECOMM_SEED={SEED}"
            address = random.choice(addresses)
            change_something(random, virtual[random.choice(addresses)], known)
            if random.random() < 0.2:
                quantity = random.choice(writable)
                raw = random.choice(quantity.writable)
                outcomes[write(drives[address], virtual[address], quantity, raw, where)] += 1
            else:
                quantity = random.choice(known)
                outcomes[read(drives[address], virtual[address], quantity, where)] += 1
            if random.random() < 0.3:
                line.advance(random.uniform(0, 0.2))
    assert set(faults.happened) == set(Fault), "all kinds of faults have happened"
    good = outcomes["read"] + outcomes["written"]
    assert good >= 0.9 * EXCHANGES, f"{outcomes}, DRIVECOMM_SEED={SEED}"


def change_something(random, virtual, known):
    quantity = random.choice(known)
    virtual.poke(quantity.address, random.choice(list(quantity.readings)))


def read(drive, virtual, quantity, where):
    virtual.begin(quantity.address)
    try:
        reading = drive.read(quantity.address)
    except DriveCommError as error:
        return type(error).__name__
    except Exception as error:
        raise AssertionError(f"{where}: reading {quantity.address} raised {error!r}") from error
    possible = virtual.could_answer(quantity.address)
    assert reading.raw in possible, f"{where}: {quantity.address} is {reading.raw!r}, the drive held {possible}"
    if reading.raw in quantity.readings:
        assert reading.value == quantity.readings[reading.raw], where
    return "read"


def write(drive, virtual, quantity, raw, where):
    began = virtual.begin(quantity.address)
    virtual.wrote(quantity.address, began)
    try:
        result = drive.write(quantity.address, quantity.readings[raw], store=quantity.store)
    except DriveCommError as error:
        return f"write {type(error).__name__}"
    except Exception as error:
        raise AssertionError(f"{where}: writing {quantity.address} raised {error!r}") from error
    if result is not None and result.raw != raw:
        # A drive that reports something else than was written: the reading is what it says, and says so.
        assert result.note, f"{where}: {quantity.address} := {raw!r} came back as {result.raw!r} without a word"
        possible = virtual.could_answer(quantity.address)
        assert result.raw in possible, f"{where}: {quantity.address} is {result.raw!r}, the drive held {possible}"
        return "contradicted"
    held = virtual.held_for(quantity.address, began)
    confirmed = f"{where}: {quantity.address} := {raw!r} was confirmed with {result}, the drive held {held}"
    assert raw in held, confirmed
    return "written"
