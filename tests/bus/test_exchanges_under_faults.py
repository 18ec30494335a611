"""Many exchanges on a line where every tenth transmission is disturbed, by every kind of fault.

Transmissions are late, cut, changed, doubled or lost; others send on the line; drives lose power and return, some with
other line settings; on a second line the adapter echoes, and its echo is incomplete or changed.

A read may fail, and then only with an error of drivecomm. It must never return a value that the drive did not hold for
that parameter at a time when it could have been requested. And it may fail only if none of its attempts could succeed.
DRIVECOMM_EXCHANGES sets the number of exchanges for each protocol, DRIVECOMM_SEED the random course of events.
"""

import os
from collections import Counter, deque
from contextlib import suppress
from dataclasses import replace
from random import Random

import pytest
from extents import LONG, protocol_extents
from steady_quantities import quantities
from watched_drive import Watched
from watched_lines import on_event_loops

import drivecomm
from drivecomm.errors import DriveCommError, DriveError, NotSupported, ReplyError
from drivecomm.link import PortProxy, TraceEvent
from drivecomm.models import load_model
from drivecomm.plant import TRANSMISSION_FAULTS, Fault, FaultPlan
from drivecomm.protocol import Framed, Framer, installed
from drivecomm.testing import packaged_vectors
from drivecomm.virtual import Transmission, VirtualLine, virtual_drive

EXCHANGES = int(os.environ.get("DRIVECOMM_EXCHANGES", "3000"))
SEED = int(os.environ.get("DRIVECOMM_SEED", "20"))

RATE = 0.10
DELAY_S = 1.0

# A request and its reply can both be late, and the link makes up to three attempts.
HORIZON_S = 2 * DELAY_S + 2.0

# Longest duration of one call, in the line's time.
DEADLINE_S = 30.0

# Two lines per protocol: with and without echo.
LINES = 2

SILENT = [*TRANSMISSION_FAULTS, Fault.FOREIGN]
PLAIN_KINDS = [*SILENT * 4, *[Fault.POWER] * 2]
ECHO_KINDS = [*PLAIN_KINDS, *[Fault.ECHO_PARTIAL, Fault.ECHO_NOISY] * 4]

PLUGINS = list(installed.working())
EXTENTS = protocol_extents(PLUGINS, 800, EXCHANGES, all_of_them=LONG or "DRIVECOMM_EXCHANGES" in os.environ)


class Course:
    """One line with three drives of a protocol, the requests on it, and their outcomes."""

    def __init__(self, plugin, seed, *, echo, traced=True):
        self.plugin = plugin
        self.seed = seed
        self.model = load_model(plugin.package, plugin.name, plugin.default_model)
        self.known = quantities(plugin, self.model, seed)
        self.writable = [quantity for quantity in self.known if quantity.writable]
        self.random = Random(seed + 1)
        self.addresses = [plugin.addresses[0], plugin.addresses[1], plugin.addresses[-1]]
        settings = plugin.facts.settings
        self.faults = FaultPlan(
            rate=RATE,
            seed=seed + 2,
            delay_s=DELAY_S,
            kinds=ECHO_KINDS if echo else PLAIN_KINDS,
            traffic=traffic(plugin, self.addresses),
            factory=replace(settings, baudrate=settings.baudrate // 2),
            outage_s=0.5,
            mismatch_s=0.5,
        )
        self.virtual = {
            address: Watched(virtual_drive(plugin.name, address), plugin.broadcast_address, HORIZON_S)
            for address in self.addresses
        }
        self.line = VirtualLine(self.virtual.values(), faults=self.faults, echo=echo)
        self.line.monitors.append(self._on_the_wire)
        # A traced exchange takes the longer path in the link; otherwise the bytes at the port are recorded.
        port, trace = (self.line.port, self._traced) if traced else (lambda: Overheard(self.line.port(), self), None)
        self.bus = drivecomm.open_bus(port, echo=echo, trace=trace, stored_writes_per_hour=10**9)
        self.drives = {address: self.bus.drive(plugin.name, address, model=self.model) for address in self.addresses}
        self.outcomes = Counter()
        self.avoidable = Counter()
        self.longest_s = 0.0
        self.stale = 0
        self.number = -1
        self.history = deque(maxlen=60)
        self.spoilt = 0
        self.forged = []
        self._received = (0.0, b"")
        self._answered = (0.0, b"")
        self._writing = False
        self._sent = []
        self._whole = []

    def exchange(self):
        """Read or write a random quantity of a random drive; an AssertionError describes a wrong outcome."""
        self.number += 1
        random = self.random
        address = random.choice(self.addresses)
        changed = random.choice(self.known)
        self.virtual[random.choice(self.addresses)].poke(
            changed.address, random.choice(list(changed.readings)), self.line.time
        )
        began = self.line.time
        self._sent.clear()
        self._whole.clear()
        self.history.append(f"-- exchange {self.number} with {address}")
        self._writing = bool(self.writable) and random.random() < 0.2
        if self._writing:
            quantity = random.choice(self.writable)
            outcome = self.write(address, quantity, random.choice(quantity.writable))
        else:
            outcome = self.read(address, random.choice(self.known))
        self.outcomes[outcome] += 1
        taken = self.line.time - began
        self.longest_s = max(self.longest_s, taken)
        assert taken <= DEADLINE_S, self.report(f"the exchange took {taken:.1f} s")
        if random.random() < 0.3:
            self.line.advance(random.uniform(0, 0.2))

    def read(self, address, quantity):
        drive, virtual, name = self.drives[address], self.virtual[address], quantity.address
        began = self.line.time
        virtual.begin(name, began)
        try:
            reading = drive.read(name)
        except DriveCommError as error:
            return self.failed(address, error)
        except Exception as error:
            raise AssertionError(self.report(f"reading {name} raised {error!r}")) from error
        possible = virtual.could_answer(name)
        self.must_be(reading.raw in possible, address, f"{name} is {reading.raw!r}, the drive held {possible}")
        self.stale += reading.raw not in virtual.held_for(name, began)
        if reading.raw in quantity.readings:
            assert reading.value == quantity.readings[reading.raw], self.report(f"{name} is {reading.value!r}")
        return "read"

    def write(self, address, quantity, raw):
        drive, virtual, name = self.drives[address], self.virtual[address], quantity.address
        began = self.line.time
        virtual.begin(name, began)
        virtual.wrote(name, began)
        try:
            result = drive.write(name, quantity.readings[raw], store=quantity.store)
        except DriveCommError as error:
            return f"write {self.failed(address, error)}"
        except Exception as error:
            raise AssertionError(self.report(f"writing {name} raised {error!r}")) from error
        if result is not None and result.raw != raw:
            # The drive reports a value other than the written one: the reading holds the reported value and has a note.
            assert result.note, self.report(f"{name} := {raw!r} came back as {result.raw!r} without a word")
            possible = virtual.could_answer(name)
            self.must_be(result.raw in possible, address, f"{name} is {result.raw!r}, the drive held {possible}")
            return "contradicted"
        held = virtual.held_for(name, began)
        self.must_be(raw in held, address, f"{name} := {raw!r} was confirmed with {result}, the drive held {held}")
        return "written"

    def must_be(self, right, address, what):
        """Raise for a wrong result, unless the telegram behind it was forged by a collision on the wire.

        Of telegrams in which characters collided on the wire, an eight-bit check accepts one in 256. A master that
        cannot see framing errors cannot detect them; they are counted, and their number has a limit.
        """
        if right:
            return
        wire_s = self.drives[address].facts.settings.wire_s
        heard_at, telegram = self._received
        sent_at, request = self._answered
        own = heard_at - wire_s(len(telegram)) < sent_at + wire_s(len(request)) - 1e-6
        assert not own, self.report(f"{what}; it began while the request was on the wire, so it was the master's own")
        assert telegram not in self.virtual[address].said, self.report(what)
        self.forged.append(self.report(what))

    def failed(self, address, error):
        """Record a failure, and whether it was avoidable."""
        kind = type(error).__name__
        assert isinstance(error, ReplyError | DriveError), self.report(f"the line works, the call was right: {error!r}")
        if not self._sent or kind == "NotAnsweringError":
            # A drive that does not answer gets no request, or only a probe.
            return kind
        if isinstance(error, DriveError) and self.heard_as_sent(address):
            return "refused"
        if isinstance(error, DriveError) or self.had_a_chance(address):
            self.avoidable[kind] += 1
            self.history.append(f"   avoidable {kind}: {error}")
        return kind

    def heard_as_sent(self, address):
        """Return whether the drive answered only requests as they were sent, so that its refusal is right."""
        sent = {data for _, data in self._sent}
        return all(answer.request in sent for answer in self.virtual[address].answers)

    def had_a_chance(self, address):
        """Return whether the drive received one attempt of the last request, and its answer came whole and in time.

        An attempt that was allowed and not made counts as well.
        """
        wire_s = self.drives[address].facts.settings.wire_s
        patience_s = self.drives[address].facts.timing.reply_timeout_s
        asked = self._sent[-1][1]
        attempts = [sent_at for sent_at, data in self._sent if data == asked]
        if len(attempts) < self.allowed(address):
            return True
        for sent_at in attempts:
            heard_at = sent_at + wire_s(len(asked))
            until = heard_at + patience_s
            for answer in self.virtual[address].answers:
                if (
                    answer.request == asked
                    and heard_at - 1e-6 <= answer.time < until
                    and any(
                        sent.data == answer.reply and answer.time <= sent.began <= until
                        for sent in self._whole
                        if sent.sender is self.virtual[address]
                    )
                ):
                    return True
        return False

    def allowed(self, address):
        """Return the number of attempts allowed for the request; a write may be one that must not be repeated."""
        return 1 if self._writing else self.drives[address].facts.timing.attempts

    @property
    def good(self):
        """Number of exchanges with an answer, refusals included."""
        return sum(self.outcomes[what] for what in ("read", "written", "refused", "write refused"))

    @property
    def exchanges(self):
        return self.number + 1

    def report(self, what):
        happened = "\n".join(line_of(what) for what in self.history)
        echo = "with" if self.line.echo else "without"
        where = f"exchange {self.number} of {self.plugin.name} {echo} echo, DRIVECOMM_SEED={self.seed}"
        return f"{where}: {what}\n{happened}\n{self.outcomes}, avoidable {self.avoidable}"

    def _traced(self, event):
        if event.what == "sent":
            self._sent.append((event.time, event.data))
        elif event.what == "received":
            self._received = (event.time, event.data)
            self._answered = self._sent[-1]
        self.history.append(event)

    def wrote(self, time, data):
        self._sent.append((time, data))
        self._received = (time, b"")
        self._answered = self._sent[-1]
        self.history.append(f"{time:12.4f} sent {data.hex(' ')}")

    def heard(self, time, data):
        self._received = (time, self._received[1] + data)
        self.history.append(f"{time:12.4f} heard {data.hex(' ')}")

    def _on_the_wire(self, sent):
        if sent.source == "drive" and not sent.garbled:
            self._whole.append(sent)
        self.spoilt += sent.source == "drive" and sent.garbled
        self.history.append(sent)


class Overheard(PortProxy):
    """A port that reports its bytes to a `Course`."""

    def __init__(self, port, course):
        super().__init__(port)
        self._course = course

    def write(self, data):
        super().write(data)
        self._course.wrote(self.now(), data)

    def read(self, until, at_least):
        data = super().read(until, at_least)
        if data:
            self._course.heard(self.now(), data)
        return data


def line_of(happened):
    """Return a trace event, a transmission or a note as a line of text."""
    if isinstance(happened, TraceEvent):
        return f"{happened.time:12.4f} {happened.drive} {happened.what} {happened.data.hex(' ')} {happened.detail}"
    if isinstance(happened, Transmission):
        name = getattr(happened.sender, "address", happened.source)
        spoilt = " garbled" if happened.garbled else ""
        return f"      {happened.began:12.4f} {happened.ended:12.4f} wire: {name} {happened.data.hex(' ')}{spoilt}"
    return happened


def traffic(plugin, addresses):
    """Return sound telegrams of other protocols, and of this one between another master and another drive."""
    foreign = [
        vector.data
        for other in PLUGINS
        if other is not plugin
        for vector in packaged_vectors(other).vectors
        if vector.valid
    ]
    neighbour = plugin.addresses[5]
    line = VirtualLine([virtual_drive(plugin.name, neighbour)])
    line.monitors.append(lambda sent: foreign.append(sent.data))
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive(plugin.name, neighbour, model=plugin.default_model)
        with suppress(NotSupported):  # a model may have no status
            drive.status()
        for name in plugin.parameter_examples:
            # A refusal is traffic as well.
            with suppress(DriveError):
                drive.read(name)
    codec = plugin.codec(plugin.options())
    ours = {*addresses, plugin.broadcast_address}
    # A single character confirms any request: its sender cannot be recognised.
    return [data for data in foreign if len(data) > 1 and not speaks_for(codec, ours, data)]


def speaks_for(codec, addresses, data):
    """Return whether the data holds a telegram of this protocol with one of these addresses, at 8 or 7 bits a byte."""
    for heard in (data, bytes(byte & 0x7F for byte in data)):
        for direction in ("request", "reply"):
            framer = Framer(codec, direction)
            for find in [*framer.feed(heard), *framer.flush()]:
                if isinstance(find, Framed) and getattr(find.message, "address", None) in addresses:
                    return True
    return False


def can_be_written(model):
    """Return whether a parameter other than a command can be written; a monitored-only drive takes no commands."""
    return any("w" in info.access and info.kind != "command" for info in model.parameters.values())


def run(plugin, echo, extent, *, traced=True):
    course = Course(plugin, SEED, echo=echo, traced=traced)
    assert len(course.known) >= min(10, len(course.model.parameters) // 5)
    assert course.writable or not can_be_written(course.model)
    for _ in range(extent // LINES):
        course.exchange()
    missed = set(course.faults.kinds) - set(course.faults.happened)
    assert len(missed) <= (extent < EXCHANGES), "all kinds of faults happen, in a sample all but one"
    assert len(course.forged) <= 1 + course.spoilt / 256, course.forged
    assert course.good > 0.8 * course.exchanges, course.report("too few are good")
    assert course.avoidable.total() <= 0.02 * course.exchanges, course.report("too many failures that need not be")


@pytest.mark.soak
@pytest.mark.parametrize("echo", [False, True])
@pytest.mark.parametrize(("plugin", "extent"), EXTENTS)
def test_disturbed_exchanges_return_no_wrong_value_and_rarely_fail(plugin, echo, extent):
    run(plugin, echo, extent)


@pytest.mark.soak
@pytest.mark.parametrize("echo", [False, True])
@pytest.mark.parametrize(("plugin", "extent"), EXTENTS)
def test_disturbed_exchanges_are_right_on_event_loops_and_the_engine(plugin, echo, extent, monkeypatch):
    monkeypatch.setattr("drivecomm.line.thread_line.run_steps", on_event_loops())
    run(plugin, echo, extent)


@pytest.mark.soak
@pytest.mark.parametrize(("plugin", "extent"), EXTENTS)
def test_disturbed_exchanges_are_right_without_a_trace(plugin, extent):
    run(plugin, False, extent, traced=False)
