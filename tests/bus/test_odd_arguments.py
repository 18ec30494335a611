"""Odd arguments of any kind raise an error of drivecomm immediately, and send no command."""

import time
from contextlib import closing
from decimal import Decimal

import pytest
from extents import every_choice
from hypothesis import given, settings, strategies as st

import drivecomm
from drivecomm.errors import DriveCommError, UsageError
from drivecomm.line import PollItem
from drivecomm.virtual import VirtualLine, virtual_drive

MODELS = {"vabus": "act", "danfoss-fc": "fc300", "vlt3500": "vlt3500", "fuji": "frenic", "modbus": "danfoss-fc"}
PARAMETERS = {"vabus": "480", "danfoss-fc": "3-41", "vlt3500": "208", "fuji": "F07", "modbus": "3410"}
LONG = "m" * 3000

ALWAYS = [
    float("nan"), float("inf"), -float("inf"), 1e-320, 1e308, -1, -0.5, 10**30, 10**5000,
    "1e999999", "1e-999999", "nan", "inf", "abc", "", LONG, LONG + ".toml", "9" * 5000, "a\0b", "\udcff",
    Decimal("NaN"), Decimal("Infinity"), Decimal("1e999999"), Decimal("-1e-999999"),
    None, b"1", [], {}, (), [[]], {"a": 1}, object(), 1 + 2j,
]  # fmt: skip

BY_CHANCE = st.one_of(st.floats(), st.integers(), st.text(max_size=20), st.binary(max_size=4), st.decimals())

OPTIONS = [
    "baudrate", "bytesize", "parity", "stopbits", "reply_timeout_s", "gap_s", "turnaround_s", "broadcast_pause_s",
    "gap_characters", "turnaround_characters", "late_s", "attempts", "request_interval_s", "deadline_s",
    "model", "set_up", "profile", "sys", "type", "maximum_hz", "reference_maximum_hz", "state_timeout_s", "idle_word",
    "maximum_frequency_hz", "reference_minimum_hz", "s06_mask", "pnu_bits", "silent_on", "m12_factor",
]  # fmt: skip

VERBS = {
    "read": lambda drive, odd: drive.read(odd),
    "read with a type": lambda drive, odd: drive.read("480", type=odd),
    "read with an index": lambda drive, odd: drive.read("480", index=odd),
    "read with a data set": lambda drive, odd: drive.read("480", dataset=odd),
    "read with a format": lambda drive, odd: drive.read("F07", format=odd),
    "write": lambda drive, odd: drive.write(PARAMETERS[drive.name.partition(":")[0]], odd),
    "write what": lambda drive, odd: drive.write(odd, 1),
    "write and store": lambda drive, odd: drive.write("480", 1, store=odd),
    "write and read": lambda drive, odd: drive.write_and_read(PARAMETERS[drive.name.partition(":")[0]], odd),
    "check a write": lambda drive, odd: drive.check_write("acceleration_time", odd),
    "percent": lambda drive, odd: drive.set_reference(percent=odd),
    "hz": lambda drive, odd: drive.set_reference(hz=odd),
    "rpm": lambda drive, odd: drive.set_reference(rpm=odd),
    "stop": lambda drive, odd: drive.stop(odd),
    "start": lambda drive, odd: drive.start(reverse=odd),
    "jog": lambda drive, odd: drive.jog(odd),
    "set-up": lambda drive, odd: drive.select_setup(odd),
    "preset": lambda drive, odd: drive.select_preset(odd),
    "relay": lambda drive, odd: drive.set_relay(odd, True),
    "relay on": lambda drive, odd: drive.set_relay(1, odd),
    "wait for": lambda drive, odd: drive.wait_for(odd, 0),
    "wait so long": lambda drive, odd: drive.wait_for("at_reference", odd) if not _time(odd) else None,
    "call": lambda drive, odd: drive.call(odd),
    "control word": lambda drive, odd: drive.call("control_word", word=odd),
    "terminals": lambda drive, odd: drive.call("terminals", X1=odd),
    "poll period": lambda drive, odd: polled(drive, period_s=odd),
    "poll age": lambda drive, odd: polled(drive, stale_after_s=odd),
    "poll what": lambda drive, odd: polled(drive, parameter=odd),
    "poll priority": lambda drive, odd: polled(drive, priority=odd),
    "poll cycles": lambda drive, odd: polled(drive, {"cycles": odd}),
    "poll so long": lambda drive, odd: polled(drive, {"duration_s": odd}),
}


def polled(drive, ends=None, **said):
    """Return the first result of a plan with one item."""
    plan = [PollItem(**{"drive": drive, "parameter": "480", **said})]
    with closing(drive.bus.poll(plan, **(ends or {"cycles": 1}))) as results:
        next(results, None)


def _time(odd):
    return isinstance(odd, int | float) and 0 <= odd < 1e9


@pytest.fixture(scope="module")
def line():
    return VirtualLine([virtual_drive(protocol, 1, model=model) for protocol, model in MODELS.items()])


@pytest.fixture(scope="module")
def heard(line):
    """Return a list of the telegrams sent by the masters of the line."""
    sent, transmit = [], line.transmit
    line.transmit = lambda data: (sent.append(data), transmit(data))
    return sent


@pytest.fixture
def bus(line):
    """Return a bus with no contact to its drives yet: impossible calls are refused before any request."""
    with drivecomm.open_bus(line.port) as opened:
        yield opened


def attempt(call, heard):
    """Make a call with each odd value; it may raise only errors of drivecomm, within a second."""

    def tried(odd):
        heard.clear()
        began = time.monotonic()
        error = None
        try:
            call(odd)
        except DriveCommError as raised:
            error = raised
        assert not (isinstance(error, UsageError) and heard), error
        assert time.monotonic() - began < 1

    for odd in ALWAYS:
        tried(odd)
    settings(max_examples=15, deadline=None, derandomize=True)(given(odd=BY_CHANCE)(tried))()


# A third of the combinations; each verb and each protocol is among them.
@pytest.mark.parametrize(("verb", "protocol"), every_choice(3, VERBS, MODELS))
def test_verbs_refuse_odd_arguments(verb, protocol, bus, heard, line):
    drive = bus.drive(protocol, 1, model=MODELS[protocol])
    motor = line.drives[list(MODELS).index(protocol)].motor

    def tried(odd):
        assert not motor.running
        VERBS[verb](drive, odd)

    attempt(tried, heard)
    assert not motor.running


@pytest.mark.parametrize(("option", "protocol"), every_choice(3, OPTIONS, MODELS))
def test_drive_options_refuse_odd_values(option, protocol, bus, heard):
    attempt(lambda odd: bus.drive(protocol, 1, **{option: odd}), heard)


@pytest.mark.soak
@pytest.mark.parametrize(
    "call",
    [
        lambda bus, odd: bus.drive(odd, 1),
        lambda bus, odd: bus.drive("vabus", odd),
        lambda bus, odd: bus.broadcast(odd),
        lambda bus, odd: next(bus.scan(odd), None),
        lambda bus, odd: next(bus.scan(["vabus"], odd), None),
        lambda bus, odd: bus.drive("vabus", 1, read_only=odd),
    ],
)
def test_drives_broadcasts_and_scans_refuse_odd_arguments(call, bus, heard):
    attempt(lambda odd: call(bus, odd), heard)


OPENING = [
    "baudrate", "parity", "reply_timeout_s", "attempts", "echo", "guard_s", "rs485", "low_latency", "record", "trace",
    "stored_writes_per_hour", "gap_s", "turnaround_s",
]  # fmt: skip


@pytest.mark.parametrize("name", OPENING)
def test_line_options_refuse_odd_values(name, line, heard):
    def opened(odd):
        with drivecomm.open_bus(line.port, **{name: odd}) as bus:
            bus.drive("vabus", 1).probe()

    attempt(opened, heard)


PORTS = [
    "loop://?x=1", "loop://?logging=x", "socket://", "socket://a:b", "rfc2217://x:-1", "spy://", "://", "", "a\0b",
    LONG, "socket://[::1", "rfc2217://127.0.0.1:1?x=1", "hwgrep://(", "alt://x?class=y", 5, None, b"COM1", float("nan"),
]  # fmt: skip


@pytest.mark.parametrize("port", PORTS)
def test_odd_ports_are_refused(port):
    with pytest.raises(DriveCommError):
        drivecomm.open_bus(port)
