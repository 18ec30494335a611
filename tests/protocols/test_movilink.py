"""SEW MOVILINK: requests and commands, starts and stops on a disturbed line, references, stored writes."""

from contextlib import contextmanager
from dataclasses import replace

import pytest

import drivecomm
from drivecomm.capture import Piece
from drivecomm.errors import (
    AddressError,
    NoReplyError,
    NotSupported,
    ParameterAddressError,
    RefusedError,
    StateError,
    TelegramError,
    UsageError,
    ValueRefusedError,
)
from drivecomm.models import load_model
from drivecomm.protocol import Command, Damaged, DriveState, Framed, Stop, installed
from drivecomm.testing import packaged_vectors
from drivecomm.traffic.sniffer import Sniffer
from drivecomm.virtual import DriveProxy, VirtualLine, virtual_drive

MOVILINK = installed["movilink"]
CODEC = MOVILINK.codec(MOVILINK.options())
RUN, RAMP, RAPID, INHIBIT = 0x0006, 0x0002, 0x0000, 0x0001


class Heard(DriveProxy):
    """A virtual drive that records the requests it receives, and whose replies a test may change."""

    def __init__(self, drive):
        super().__init__(drive)
        self.heard, self.between = [], lambda _, reply: reply

    def hear(self, find, now):
        reply = super().hear(find, now)
        if not isinstance(find, Framed):
            return reply
        self.heard.append(find)
        return self.between(find, reply) if reply else None


class Bench:
    """A drive at address 0, its line and its master."""

    def __init__(self, bus, line, options):
        self.bus, self.line, self.virtual = bus, line, line.drives[0]
        self.drive = bus.drive("movilink", 0, model="movidrive-b", **options)

    def settle(self):
        self.line.advance(120)
        self.virtual.motor.advance(self.line.time)


@contextmanager
def on_bench(**options):
    line = VirtualLine([Heard(virtual_drive("movilink", 0, model="movidrive-b", **options))])
    with drivecomm.open_bus(line.port) as bus:
        yield Bench(bus, line, options)


def started(on, percent=50):
    on.drive.set_reference(percent=percent)
    on.drive.start()
    on.settle()
    on.virtual.heard.clear()


def control_words(on):
    return [each.message.pd[0] for each in on.virtual.heard if each.message.pd]


def answering(on, change):
    """Change the replies of the drive: `change` gets the request and the reply, and returns a message or None."""

    def between(find, reply):
        told = change(find.message, CODEC.decode(reply.data, "reply"))
        return None if told is None else replace(reply, data=CODEC.encode(told))

    on.virtual.between = between


def another_master_sends(on, data):
    """Return the reply of the drive to a telegram of another master."""
    on.virtual.inner.follow(on.line.time)
    return on.virtual.inner.answer(CODEC.decode(bytes.fromhex(data), "request"), on.line.time)


def with_status(message, word):
    return replace(message, pd=(word, *message.pd[1:])) if message.pd else replace(message, value=word)


# Requests that command nothing


@pytest.mark.parametrize("runs", [False, True])
def test_reads_and_status_use_parameter_telegrams_only(runs):
    with on_bench() as on:
        if runs:
            started(on)
        for ask in (on.drive.status, on.drive.identify, on.drive.probe, lambda: on.drive.read("8470")):
            ask()
        assert {each.message.type for each in on.virtual.heard} == {0x86}
        assert on.virtual.motor.running is runs


def test_scan_finds_drives_by_parameter_telegrams_only():
    drives = [virtual_drive("movilink", address) for address in (0, 7, 99)]
    line, sent = VirtualLine(drives), []
    with drivecomm.open_bus(line.port, trace=sent.append) as bus:
        assert [each.name for each in bus.scan(["movilink"])] == ["movilink:0", "movilink:7", "movilink:99"]
    requests = [CODEC.decode(event.data, "request") for event in sent if event.what == "sent"]
    assert {each.type for each in requests} == {0x86}


def test_request_with_process_data_counts_as_a_command():
    for vector in packaged_vectors(MOVILINK).vectors:
        if vector.valid and vector.direction == "request":
            message = CODEC.decode(vector.data, "request")
            assert MOVILINK.intent(message).commands is bool(message.pd), vector.id


# Commands


def test_start_sends_the_printed_telegram_of_3000_rpm():
    """02 01 05 00 06 3A 98 01 F4 57: MOVIDRIVE MDX60B/61B communication manual p. 28."""
    line, sent = VirtualLine([virtual_drive("movilink", 1, maximum_rpm=3000)]), []
    with drivecomm.open_bus(line.port, trace=sent.append) as bus:
        drive = bus.drive("movilink", 1, model="movidrive-b", maximum_rpm=3000, ramp_ms=500)
        drive.set_reference(percent=100)
        drive.start()
    assert bytes.fromhex("02 01 05 00 06 3A 98 01 F4 57") in [event.data for event in sent if event.what == "sent"]


@pytest.mark.parametrize(
    ("how", "word", "command"),
    [
        (Stop.RAMP, RAMP, Command.RAMP_STOP),
        (Stop.QUICK, RAPID, Command.QUICK_STOP),
        (Stop.COAST, INHIBIT, Command.OFF),
    ],
)
def test_stop_sends_its_word_before_anything_else(how, word, command):
    with on_bench() as on:
        started(on)
        on.drive.stop(how)
        assert control_words(on)[0] == word
        assert on.virtual.heard[0].message.pd
        assert on.virtual.motor.command is command


def test_stop_without_a_reply_is_repeated():
    with on_bench() as on:
        started(on)
        lost = [1, 2]
        answering(on, lambda _, reply: lost.pop() and None if lost else reply)
        on.drive.stop()
        assert control_words(on) == [RAMP] * 3


def test_start_without_a_reply_is_sent_once():
    with on_bench() as on:
        on.drive.set_reference(percent=50)
        answering(on, lambda request, reply: None if request.pd and request.pd[0] == RUN else reply)
        on.virtual.heard.clear()
        with pytest.raises(NoReplyError, match="not known"):
            on.drive.start()
        assert control_words(on).count(RUN) == 1


def test_start_that_is_not_obeyed_is_taken_back():
    with on_bench() as on:
        on.drive.set_reference(percent=50)
        answering(on, lambda _, reply: with_status(reply, 0x0206))
        with pytest.raises(StateError, match="taken back"):
            on.drive.start()
        assert control_words(on)[-1] == RAMP


@pytest.mark.parametrize(
    ("word", "why"), [(0x0202, "control signal source"), (0x0B22, "has tripped"), (0x0B26, "has tripped")]
)
def test_start_is_refused_before_the_enabling_word_is_sent(word, why):
    with on_bench() as on:
        on.drive.set_reference(percent=50)
        answering(on, lambda _, reply: with_status(reply, word))
        on.virtual.heard.clear()
        with pytest.raises(StateError, match=why):
            on.drive.start()
        assert set(control_words(on)) == {RAMP}


def test_start_without_a_reference_sends_no_enabling_word():
    with on_bench() as on:
        with pytest.raises(StateError, match="no reference was set from here"):
            on.drive.start()
        assert set(control_words(on)) <= {RAMP}


def test_reverse_start_is_refused_and_a_negative_reference_reverses():
    with on_bench() as on:
        with pytest.raises(NotSupported):
            on.drive.start(reverse=True)
        assert not on.virtual.heard
        started(on, percent=-50)
        assert on.virtual.motor.output_hz == -25


def test_word_with_inhibit_and_enable_coasts_and_is_never_encoded():
    with pytest.raises(TelegramError, match="inhibits"):
        CODEC.encode(MOVILINK.message({"address": 1, "type": 3, "pd": [7, 0]}, "request"))
    with on_bench() as on:
        started(on)
        another_master_sends(on, "02 00 03 00 07 00 00 06")
        assert on.virtual.motor.command is Command.OFF


# References


@pytest.mark.parametrize(
    ("options", "percent", "word"),
    [
        ({"maximum_rpm": 0}, -80, 0xCCCD),  # -13107; PROFINET field distributors p. 145 prints CCC5 by a rounded scale
        ({"maximum_rpm": 0}, 100, 0x4000),
        ({"maximum_rpm": 0}, -100, 0xC000),
        ({}, 100, 7500),
        ({}, -100, 0x10000 - 7500),
        ({"maximum_rpm": 6553}, 100, 32765),
    ],
)
def test_reference_is_sent_in_the_scale_of_the_drive(options, percent, word):
    with on_bench(**options) as on:
        on.drive.set_reference(percent=percent)
        assert on.virtual.heard[-1].message.pd == (RAMP, word)


@pytest.mark.parametrize("percent", [100.1, -100.1, 1000])
def test_reference_above_the_maximum_is_refused_unsent(percent):
    with on_bench() as on:
        with pytest.raises(ValueRefusedError):
            on.drive.set_reference(percent=percent)
        assert not on.virtual.heard


def test_reference_for_a_motor_started_by_another_master_is_refused():
    with on_bench() as on:
        another_master_sends(on, "02 00 03 00 06 10 00 17")
        on.settle()
        with pytest.raises(StateError, match="another program"):
            on.drive.set_reference(percent=10)
        assert control_words(on) == []
        assert on.virtual.motor.running


@pytest.mark.parametrize(
    "options", [{"maximum_rpm": -1}, {"maximum_rpm": 0.01}, {"maximum_rpm": 7000}, {"ramp_ms": 70000}]
)
def test_option_that_does_not_fit_a_word_is_refused(options):
    with pytest.raises(UsageError, match="maximum_rpm"):
        MOVILINK.options(**options)


# The watchdog, and a status changed by other masters


def test_status_repeats_the_start_only_if_the_watchdog_is_known():
    with on_bench() as on:
        started(on)
        on.drive.status()
        assert control_words(on) == []
        on.drive.watched(600)
        on.drive.set_reference(percent=40)
        on.virtual.heard.clear()
        assert on.drive.status().running
        assert [(each.message.type, each.message.pd) for each in on.virtual.heard if each.message.pd] == [
            (0x03, (RUN, 3000))
        ]


def test_status_does_not_repeat_a_start_older_than_the_watchdog():
    with on_bench() as on:
        on.drive.watched(1)
        started(on)
        on.line.advance(5)
        assert on.drive.status().running
        assert control_words(on) == []


def test_status_does_not_restart_a_motor_that_another_master_has_stopped():
    with on_bench() as on:
        on.drive.watched(600)
        started(on)
        on.drive.status()
        on.virtual.heard.clear()
        another_master_sends(on, "02 00 03 00 02 00 00 03")
        on.settle()
        assert on.drive.status().state is DriveState.READY
        assert control_words(on) == []
        assert not on.virtual.motor.running


def test_status_takes_back_the_start_of_a_tripped_drive():
    with on_bench() as on:
        started(on)
        on.virtual.trip(11, on.line.time)
        status = on.drive.status()
        assert (status.fault, status.fault_code) == (True, 11)
        assert control_words(on) == [RAMP]
        on.drive.reset()
        on.settle()
        assert not on.virtual.motor.running
        assert control_words(on)[1:] == [RAMP, 0x0040, RAMP]


def test_reset_of_a_drive_without_a_fault_sends_no_command():
    with on_bench() as on:
        on.drive.reset()
        assert control_words(on) == []


def test_drive_without_a_readable_status_can_be_started_and_stopped():
    """Index 8310 is unconfirmed; replies to commands hold status word 1 as well."""

    def no_index(request, reply):
        return reply if request.pd else replace(reply, management=0xB1, value=0x08000010)

    with on_bench() as on:
        answering(on, no_index)
        with pytest.raises(RefusedError, match=r"8310.*illegal index"):
            on.drive.status()
        on.drive.stop()
        on.drive.set_reference(percent=50)
        on.drive.start()
        assert on.virtual.motor.running
        on.drive.stop()
        assert on.virtual.motor.command is Command.RAMP_STOP


def test_warning_of_a_running_motor_is_not_a_fault():
    with on_bench() as on:
        answering(on, lambda _, reply: with_status(reply, 0x0127))
        status = on.drive.status()
        assert (status.running, status.fault, status.warning, status.fault_code) == (True, False, True, None)


# Parameters


def test_write_goes_to_ram_unless_stored():
    with on_bench() as on:
        on.drive.write("8470", "1.5")
        on.drive.write("ramp_t11_up", 3, store=True)
        assert [each.message.management for each in on.virtual.heard] == [0x33, 0x32]
        on.drive.write("8470", "1.5")
        on.virtual.power_cycle(on.line.time)
        assert on.drive.read("8470").value == 3


def test_write_without_a_model_goes_to_ram():
    line, sent = VirtualLine([virtual_drive("movilink", 1)]), []
    with drivecomm.open_bus(line.port, trace=sent.append) as bus:
        bus.drive("movilink", 1).write("8470", 1500)
        with pytest.raises(NotSupported):
            bus.drive("movilink", 1).write("8470", 1500, store=True)
    assert [CODEC.decode(each.data, "request").management for each in sent if each.what == "sent"] == [0x33]


def test_write_is_nameless_as_a_late_reply_could_confirm_it():
    model = load_model("drivecomm_movilink", "movilink", "movidrive-b")
    ask = next(MOVILINK.operations(1, MOVILINK.options(), model).write("8470", 1))
    assert ask.nameless


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0x08000010, "illegal index"),
        (0x08000015, "value too large"),
        (0x0800001C, "controller inhibit"),
        (0x05000001, "illegal service"),
        (0x0800004D, "not listed"),
    ],
)
def test_refusal_has_the_text_of_the_tables(value, text):
    with on_bench() as on:
        answering(on, lambda _, reply: replace(reply, management=reply.management | 0x80, value=value))
        with pytest.raises(RefusedError, match=text):
            on.drive.read("8300")


@pytest.mark.parametrize("address", ["", "P130", "65536", "8470.256", "-1", "8470.", "8470.1.1", "0x20"])
def test_address_that_is_not_an_index_is_refused(address):
    with on_bench() as on, pytest.raises(ParameterAddressError, match="not an index"):
        on.drive.read(address)


def test_parameter_without_a_model_is_a_32_bit_number():
    line = VirtualLine([virtual_drive("movilink", 1)])
    line.drives[0].poke("8470", 0xFFFFFFFE)
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("movilink", 1)
        assert drive.read("8470").value == 0xFFFFFFFE
        assert drive.read("8470", type="s32").value == -2
        with pytest.raises(UsageError, match="u32, s32, f32"):
            drive.read("8470", type="s16")


def test_handshake_bit_is_returned_unchanged():
    with on_bench() as on:
        assert another_master_sends(on, "02 00 06 71 00 20 6C 00 00 00 00 39").management == 0x71


# Addresses and neighbours


@pytest.mark.parametrize("address", [100, 101, 253, 254, 255])
def test_group_and_broadcast_addresses_are_refused_as_drive_addresses(address):
    line = VirtualLine([virtual_drive("movilink", 1)])
    with drivecomm.open_bus(line.port) as bus, pytest.raises(AddressError):
        bus.drive("movilink", address)


@pytest.mark.parametrize(("how", "word"), [(Stop.RAMP, "00 02"), (Stop.COAST, "00 01"), (Stop.QUICK, "00 00")])
def test_broadcast_stop_is_sent_once_to_address_255(how, word):
    drives = [virtual_drive("movilink", 1), virtual_drive("movilink", 2)]
    line, sent = VirtualLine(drives), []
    with drivecomm.open_bus(line.port, trace=sent.append) as bus:
        for drive in drives:
            master = bus.drive("movilink", drive.address, model="movidrive-b")
            master.set_reference(percent=50)
            master.start()
        sent.clear()
        bus.broadcast("movilink").stop(how)
        line.advance(60)
        assert not any(drive.motor.running for drive in drives if drive.motor.advance(line.time) is None)
    told = [event.data for event in sent if event.what == "sent"]
    assert [data[:5] for data in told] == [bytes.fromhex(f"02 FF 03 {word}")]


def test_uss_telegram_is_not_decoded_as_movilink():
    """02 0E 05 ..., 16 bytes long in USS, would be type 05 to address 14, 10 bytes long."""
    data = bytes.fromhex("02 0E 05 10 06 00 00 00 00 00 00 04 7F 00 00")
    check = 0
    for byte in data:
        check ^= byte
    whole = data + bytes([check])
    assert CODEC.measure(whole[:3], "request") == 10
    with pytest.raises(TelegramError):
        CODEC.decode(whole[:10], "request")
    with pytest.raises(TelegramError):
        CODEC.decode(whole, "request")


def test_damaged_request_is_not_answered():
    """MOVIDRIVE MDX60B/61B communication manual p. 20."""
    drive = virtual_drive("movilink", 1)
    for data in ("02 01 03 00 06 3A 98 00", "02 01 0F 00 06 0A", "02 01 05 00 06"):
        with pytest.raises(TelegramError) as refused:
            CODEC.decode(bytes.fromhex(data), "request")
        assert drive.hear(Damaged(data=bytes.fromhex(data), error=refused.value), 1.0) is None
    assert not drive.motor.running


def test_foreign_telegram_may_be_a_valid_movilink_command():
    """A USS telegram to drive 2 with 047E, and a Danfoss process block to drive 3; see the README."""
    for data in ("02 0E 02 00 00 00 00 00 00 00 00 04 7E 10 00", "02 06 83 04 7E 10 00"):
        check = 0
        for byte in bytes.fromhex(data):
            check ^= byte
        message = CODEC.decode(bytes.fromhex(data) + bytes([check]), "request")
        assert (message.address, message.pd) == (bytes.fromhex(data)[1], (0x047E, 0x1000))


def test_mismatch_of_a_foreign_reply_raises_no_error():
    """A scan for several protocols checks each telegram with all of them, so foreign messages are compared as well."""
    line = VirtualLine([virtual_drive("danfoss-fc", 3), virtual_drive("movilink", 9)])
    with drivecomm.open_bus(line.port) as bus:
        found = [each.name for each in bus.scan(["movilink", "danfoss-fc"], addresses=range(1, 10))]
    assert found == ["movilink:9", "danfoss-fc:3"]
    foreign = packaged_vectors(installed["danfoss-fc"]).vectors
    replies = [each for each in foreign if each.valid and each.direction == "reply" and not each.options]
    request = MOVILINK.message({"address": 3, "type": 3, "pd": [2, 0]}, "request")
    other = installed["danfoss-fc"]
    assert all(MOVILINK.mismatch(request, other.message(each.fields, "reply")) for each in replies)


@pytest.mark.parametrize("among", [["movilink"], ["movilink", "vabus", "fuji", "vlt3500", "modbus"]])
def test_sniffer_reads_requests_and_replies(among):
    line, pieces = VirtualLine([virtual_drive("movilink", 1)]), []

    def note(event):
        if event.what in ("sent", "received"):
            pieces.append(Piece(time_s=event.time, data=event.data))

    with drivecomm.open_bus(line.port, trace=note) as bus:
        drive = bus.drive("movilink", 1, model="movidrive-b")
        for act in (lambda: drive.read("8300"), lambda: drive.set_reference(percent=10), drive.start, drive.stop):
            act()
    sniffer = Sniffer([installed[name] for name in among], settings=MOVILINK.facts.settings)
    found = [each for piece in pieces for each in sniffer.feed(piece)] + sniffer.finish()
    told = [(each.protocol, each.direction) for each in found]
    assert told == [("movilink", direction) for _ in range(len(told) // 2) for direction in ("request", "reply")]
    assert len(told) == len(pieces)
