"""Older Huanyang drives: stops, starts and readings on a line with an echo, without an echo, and without a drive."""

import pytest

import drivecomm
from drivecomm.bus import policies, set_watchdog
from drivecomm.errors import (
    NoReplyError,
    NotSupported,
    ParameterAddressError,
    RefusedError,
    ReplyError,
    StateError,
    ValueRefusedError,
)
from drivecomm.protocol import DriveState, MotorCommand
from drivecomm.virtual import VirtualLine, virtual_drive

ECHOES = pytest.mark.parametrize(
    ("mode", "echo"), [("auto", False), ("auto", True), ("off", False), ("off", True), ("expect", True)]
)
STOP, RUN, REVERSED = bytes.fromhex("01030108F18E"), bytes.fromhex("010301013188"), bytes.fromhex("010301113044")


@pytest.fixture
def hy():
    return virtual_drive("huanyang", 1)


def turning(hy, line):
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("huanyang", 1, model="hy")
        drive.set_reference(hz=40)
        drive.start()
    line.advance(20)
    hy.motor.advance(line.time)
    assert hy.motor.output_hz == 40


def sent_by(bus_events):
    return [event.data for event in bus_events if event.what == "sent"]


@ECHOES
def test_stop_as_the_first_request_on_a_port_is_sent_first_and_confirmed(hy, mode, echo):
    """The drive answers a stop with the same bytes while the motor still turns."""
    line, heard = VirtualLine([hy], echo=echo), []
    turning(hy, line)
    with drivecomm.open_bus(line.port, echo=mode, trace=heard.append) as bus:
        drive = bus.drive("huanyang", 1, model="hy")
        drive.stop()
        assert hy.motor.command is MotorCommand.RAMP_STOP
        assert sent_by(heard)[0] == STOP
        line.advance(20)
        # The stop must not have misled echo detection: this reply equals its request as well.
        assert drive.read("PD011").raw == 0
        assert drive.status().state is DriveState.READY


@ECHOES
def test_first_reading_of_0_is_not_taken_for_an_echo(hy, mode, echo):
    line = VirtualLine([hy], echo=echo)
    with drivecomm.open_bus(line.port, echo=mode) as bus:
        drive = bus.drive("huanyang", 1, model="hy")
        assert drive.read("PD011").raw == 0
        assert drive.read("PD005").value == 50
        drive.write("PD014", 3, store=True)
    assert hy.peek("PD014", line.time) == 30


@pytest.mark.parametrize("mode", ["auto", "off", "expect"])
@pytest.mark.parametrize(
    "call",
    [
        lambda drive: drive.read("PD011"),
        lambda drive: drive.write("PD014", 3, store=True),
        lambda drive: drive.set_reference(hz=20),
        lambda drive: drive.start(),
        lambda drive: drive.stop(),
    ],
)
def test_echo_without_a_drive_is_not_taken_for_a_reply(mode, call):
    line = VirtualLine([virtual_drive("huanyang", 2)], echo=True)
    with drivecomm.open_bus(line.port, echo=mode) as bus, pytest.raises(ReplyError):
        call(bus.drive("huanyang", 1, model="hy"))


@pytest.mark.parametrize("mode", ["auto", "off", "expect"])
@pytest.mark.parametrize("call", [lambda drive: drive.start(), lambda drive: drive.stop()])
def test_echo_does_not_confirm_a_command_that_the_drive_missed(hy, mode, call):
    """The echo of a start looks like a status of running, and that of a stop like a motor that runs down."""
    line = VirtualLine([hy], echo=True)
    with drivecomm.open_bus(line.port, echo=mode) as bus:
        drive = bus.drive("huanyang", 1, model="hy")
        drive.set_reference(hz=20)
        hears = hy.hear
        hy.hear = lambda find, now: None if find.data[1] == 3 else hears(find, now)
        with pytest.raises(ReplyError):
            call(drive)
    assert hy.motor.command is not MotorCommand.RUN


@pytest.mark.parametrize("echo", [False, True])
def test_unannounced_echo_is_not_taken_for_a_reading_of_0(hy, echo):
    """The request carries a 0 in the place of the value."""
    line = VirtualLine([hy], echo=echo)
    with drivecomm.open_bus(line.port, echo="off") as bus:
        assert bus.drive("huanyang", 1, model="hy").read("PD005").value == 50


def test_stop_without_a_reply_is_sent_three_times(hy):
    line, heard = VirtualLine([hy]), []
    with drivecomm.open_bus(line.port, trace=heard.append) as bus:
        drive = bus.drive("huanyang", 1, model="hy")
        drive.status()
        hy.hear, hears = (lambda _find, _now: None), hy.hear
        with pytest.raises(NoReplyError):
            drive.stop()
        assert sent_by(heard).count(STOP) == 3
        hy.hear = hears


def test_lost_first_stop_is_resent_without_waiting_for_a_late_reply(hy):
    line, heard_at = VirtualLine([hy]), []
    turning(hy, line)
    hears = hy.hear

    def hear(find, now):
        if find.data[1] == 3:
            heard_at.append(now)
        return None if len(heard_at) < 2 else hears(find, now)

    hy.hear = hear
    with drivecomm.open_bus(line.port) as bus:
        bus.drive("huanyang", 1, model="hy").stop()
    assert hy.motor.command is MotorCommand.RAMP_STOP
    # The limit covers the reply timeout and the silence between telegrams.
    assert heard_at[1] - heard_at[0] < 0.7


def test_stop_does_not_wait_for_a_late_reply_to_a_start(hy):
    """The reply to a start names nothing of its request, so any other request would wait for it."""
    line = VirtualLine([hy])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("huanyang", 1, model="hy")
        drive.set_reference(hz=20)
        hears = hy.hear
        hy.hear = lambda find, now: None if hears(find, now).data[1] == 3 else hears(find, now)
        with pytest.raises(NoReplyError, match="commanded to run"):
            drive.start()
        heard_at = []
        hy.hear = lambda find, now: heard_at.append(now) or hears(find, now)
        began = line.time
        drive.stop()
        assert hy.motor.command is not MotorCommand.RUN
        assert heard_at[0] - began < 0.2


@pytest.mark.parametrize(("reverse", "telegram"), [(False, RUN), (True, REVERSED)])
def test_start_that_is_not_obeyed_is_sent_once_and_taken_back(hy, reverse, telegram):
    line, heard = VirtualLine([hy]), []
    with drivecomm.open_bus(line.port, trace=heard.append) as bus:
        drive = bus.drive("huanyang", 1, model="hy")
        drive.set_reference(hz=20)
        # The drive reports no fault; only the standing motor shows it.
        hy.trip(1, line.time)
        assert not drive.status().fault
        with pytest.raises(StateError, match="taken back"):
            drive.start(reverse=reverse)
    sent = sent_by(heard)
    assert sent.count(telegram) == 1
    assert STOP in sent[sent.index(telegram) :]


def test_reverse_start_needs_parameter_pd023(hy):
    line = VirtualLine([hy])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("huanyang", 1, model="hy")
        drive.set_reference(percent=50)
        hy.poke("PD023", 0)
        with pytest.raises(StateError, match="reverse_rotation"):
            drive.start(reverse=True)
        hy.poke("PD023", 1)
        drive.start(reverse=True)
        line.advance(20)
        status = drive.status()
        assert (hy.motor.output_hz, status.actual_hz, status.running, status.reverse) == (-25, 25, True, None)
        # The drive has no status word; the value that gives its state takes that place.
        assert status.word == 2500


def test_start_and_reference_are_refused_if_another_source_commands(hy):
    line = VirtualLine([hy])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("huanyang", 1, model="hy")
        hy.poke("PD001", 1)
        with pytest.raises(StateError, match="only with 2"):
            drive.start()
        with pytest.raises(RefusedError, match="CNTR"):
            drive.stop()
        hy.poke("PD002", 0)
        with pytest.raises(StateError, match="only with 2"):
            drive.set_reference(hz=10)


def test_reference_above_the_maximum_of_pd005_is_refused(hy):
    hy.poke("PD005", 40000)
    with drivecomm.open_bus(VirtualLine([hy]).port) as bus:
        drive = bus.drive("huanyang", 1, model="hy")
        drive.set_reference(percent=100)
        assert drive.read("reference_frequency").value == 400
        for call in (lambda: drive.set_reference(hz=400.01), lambda: drive.write("CFG0", 401)):
            with pytest.raises(ValueRefusedError):
                call()
        assert drive.read("CFG0").value == 400


def test_drive_has_no_link_loss_policy_but_hold(hy):
    with drivecomm.open_bus(VirtualLine([hy]).port) as bus:
        drive = bus.drive("huanyang", 1, model="hy")
        assert not drive.capabilities.faults
        assert [each for each in policies(drive.model) if each != "hold"] == []
        assert "presumably the motor keeps running" in drive.capabilities.link_loss
        for policy in ("ramp", "coast", "trip"):
            with pytest.raises(NotSupported):
                set_watchdog(drive, policy, 2)
        with pytest.raises(NotSupported, match="keypad"):
            drive.reset()


@pytest.mark.parametrize("address", ["CNTR", "turns", "PD256"])
def test_control_data_cannot_be_read_or_written_as_a_parameter(hy, address):
    """Such a write would start the motor without the checks of a start."""
    line, heard = VirtualLine([hy]), []
    with drivecomm.open_bus(line.port, trace=heard.append) as bus:
        drive = bus.drive("huanyang", 1, model="hy")
        for call in (lambda: drive.read(address), lambda: drive.write(address, 1, store=True)):
            with pytest.raises(ParameterAddressError):
                call()
    assert sent_by(heard) == []


def test_drive_without_a_model_is_started_and_stopped(hy):
    line = VirtualLine([hy])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("huanyang", 1)
        drive.set_reference(hz=20)
        hy.poke("PD001", 0)
        with pytest.raises(StateError, match="only with 2"):
            drive.start()
        hy.poke("PD001", 2)
        drive.start()
        assert hy.motor.command is MotorCommand.RUN
        drive.stop()
        assert hy.motor.command is MotorCommand.RAMP_STOP


def test_broadcast_stops_all_drives():
    drives = [virtual_drive("huanyang", address) for address in (1, 250)]
    line = VirtualLine(drives)
    with drivecomm.open_bus(line.port) as bus:
        for virtual in drives:
            drive = bus.drive("huanyang", virtual.address, model="hy")
            drive.set_reference(hz=20)
            drive.start()
        everybody = bus.broadcast("huanyang")
        everybody.stop()
        line.advance(0.1)
        assert [each.motor.command for each in drives] == [MotorCommand.RAMP_STOP] * 2
