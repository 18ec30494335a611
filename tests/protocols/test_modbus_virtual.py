"""Refusals of a virtual Modbus drive, the state they leave unchanged, and its reaction to a silent master."""

import pytest

import drivecomm
from drivecomm.errors import NoReplyError, RefusedError, ReplyError, StateError
from drivecomm.models import load_model
from drivecomm.protocol import Framed, Framer, Motor, Noise, VirtualReply, installed, resolve_options
from drivecomm.protocol.schema import crc16
from drivecomm.virtual import VirtualLine, virtual_drive
from drivecomm_modbus.control import control_of


def reply_to(drive, request, now=1.0):
    """Pass a telegram without its CRC to a drive; return the reply, also without it, or None for silence."""
    data = bytes.fromhex(request)
    data += crc16(data)
    reply = drive.hear(Framed(data, drive.codec.decode(data, "request")), now)
    return reply and reply.data[:-2].hex(" ").upper()


def reply_to_any_bytes(drive, request, now=1.0):
    """Pass bytes that may be no known telegram to a drive, without their CRC; return the reply without its CRC."""
    data = bytes.fromhex(request)
    framer = Framer(drive.codec, "request")
    finds = [*framer.feed(data + crc16(data)), *framer.flush()]
    (reply,) = filter(None, [drive.hear(find, now) for find in finds if not isinstance(find, Noise)])
    return reply.data[:-2].hex(" ").upper()


@pytest.fixture
def gs2():
    return virtual_drive("modbus", 1, model="gs2")


def test_refused_block_write_changes_no_register(gs2):
    # 25 Hz, and 2 where only 0 and 1 are allowed
    assert reply_to(gs2, "01 10 09 1A 00 02 04 00 FA 00 02") == "01 90 03"
    assert [gs2.peek(each, 1.0) for each in ("0x091A", "0x091B")] == [0, 0]
    assert not gs2.motor.running
    assert reply_to(gs2, "01 10 09 1A 00 02 04 00 FA 00 01") == "01 10 09 1A 00 02"
    assert gs2.motor.running


@pytest.mark.parametrize(
    ("request_", "answer"),
    [
        ("01 06 09 1A 0F A1", "01 86 03"),  # 400.1 Hz; the maximum is 400
        ("01 06 21 03 00 00", "01 86 02"),  # read only
        ("01 03 70 00 00 01", "01 83 02"),
        ("01 03 21 00 00 11", "01 83 03"),  # 17 registers; the maximum is 16
        ("01 06 09 1A 0F A0", "01 06 09 1A 0F A0"),
    ],
)
def test_refusal_has_the_exception_code_of_its_cause(gs2, request_, answer):
    assert reply_to(gs2, request_) == answer


@pytest.mark.parametrize(
    ("model", "request_", "answer"),
    [
        ("yaskawa", "01 10 00 02 00 01 02 C3 50", "01 90 21"),  # 500 Hz
        ("yaskawa", "01 10 00 4B 00 01 02 00 00", "01 90 22"),  # read only
        ("yaskawa", "01 06 00 02 17 70", "01 86 01"),  # the series has only functions 03, 08 and 10
        ("fuji-frenic", "01 03 08 00 00 7D", "01 83 02"),  # invalid count
        ("fuji-frenic", "01 03 08 00 00 00", "01 83 02"),
        ("hitachi-wj200", "01 06 12 00 FF FF", "01 86 21"),
        ("vacon10", "01 04 08 34 00 01", "01 04 02 00 01"),  # the series answers 04 as 03
        ("gs2", "01 07", "01 87 01"),
        ("gs2", "01 0C", "01 8C 01"),
        ("gs2", "01 16 09 1A 00 F2 00 25", "01 96 01"),
        ("gs2", "01 18 04 DE", "01 98 01"),
        ("gs2", "01 41 00 00", "01 C1 01"),  # unknown function of unknown length
        ("gs2", "01 08 00 01 00 00", "01 88 01"),
        ("gs2", "01 64 09 1A", "01 E4 01"),
    ],
)
def test_each_series_refuses_with_its_own_codes(model, request_, answer):
    assert reply_to_any_bytes(virtual_drive("modbus", 1, model=model), request_) == answer


@pytest.mark.parametrize(
    ("asked", "ids"), [("01 00", [0, 1, 2]), ("01 01", [1, 2]), ("02 09", [0, 1, 2]), ("04 01", [1]), ("04 09", None)]
)
def test_device_identification_returns_the_requested_objects(asked, ids):
    drive = virtual_drive("modbus", 1, model="schneider-atv")
    answer = reply_to_any_bytes(drive, f"01 2B 0E {asked}")
    if ids is None:
        assert answer == "01 AB 02"
        return
    data = bytes.fromhex(answer)
    reply = drive.codec.decode(data + crc16(data), "reply")
    assert (reply.read_code, list(reply.object_ids)) == (int(asked[:2]), ids)


@pytest.mark.parametrize(
    ("words", "stop"),
    [((0x0006, 0x0007, 0x000F, 0x002F, 0x006F), 0x006E), ((0x0476, 0x0477, 0x047F), 0x047E), ((6, 7, 0x7F), 0)],
)
def test_abb_drive_ignores_the_unused_bits_of_the_control_word(words, stop):
    drive = virtual_drive("modbus", 1, model="abb-acs355")
    reply_to_any_bytes(drive, "01 06 00 01 20 00")
    for word in (*words[:-1], words[0], *words):
        assert drive.motor.target_hz == 0
        reply_to_any_bytes(drive, f"01 06 00 00 {word:04X}")
    assert drive.motor.target_hz > 0
    reply_to_any_bytes(drive, f"01 06 00 00 {stop:04X}", now=2.0)
    drive.follow(60.0)
    assert not drive.motor.running


def test_start_that_is_not_obeyed_is_taken_back(gs2, monkeypatch):
    monkeypatch.setattr(Motor, "run", lambda *_: None)
    line = VirtualLine([gs2])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("modbus", 1, model="gs2", state_timeout_s=0.5)
        drive.set_reference(hz=25)
        with pytest.raises(StateError, match=r"within 0\.5 s after the start, which was taken back"):
            drive.start()
        assert drive.read("0x091B").value == 0


@pytest.mark.parametrize(("action", "hz", "runs"), [(0, 25, True), (1, 20, True), (2, 0, False), (3, 25, True)])
def test_older_delta_carries_out_the_action_of_09_02_when_the_time_expires(action, hz, runs):
    virtual = virtual_drive("modbus", 1, model="delta-vfd-b")
    virtual.motor.ramp_up_s = 0
    virtual.motor.ramp_down_s = virtual.motor.maximum_hz / 10
    virtual.poke("0x0902", action)
    virtual.poke("0x0903", 40)
    line = VirtualLine([virtual])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("modbus", 1, model="delta-vfd-b")
        drive.set_reference(hz=25)
        drive.start()
        for _ in range(10):
            line.advance(1)
            assert drive.status().running
        line.advance(4.5)
        virtual.follow(line.time)
        assert virtual.motor.running is runs
        assert virtual.motor.output_hz == pytest.approx(hz, abs=0.5), (
            "ramping down by 10 Hz in a second for half of one"
        )


def test_watchdog_that_is_off_never_acts():
    virtual = virtual_drive("modbus", 1, model="delta-vfd-b")
    virtual.poke("0x0902", 2)
    line = VirtualLine([virtual])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("modbus", 1, model="delta-vfd-b")
        drive.set_reference(hz=25)
        drive.start()
        line.advance(1000)
        assert drive.status().running
        with pytest.raises(RefusedError, match="invalid value"):
            bus.drive("modbus", 1).write("0x0902", 4)


@pytest.mark.parametrize(("name", "place"), [("delta", 0x2119), ("gs2", 0x2101), ("delta-vfd-b", 0x2101)])
def test_drive_in_standby_counts_as_started(name, place):
    model = load_model("drivecomm_modbus", "modbus", name)
    start = control_of(model, resolve_options(installed["modbus"], model, {})[1]).profile.start[-1]
    obeyed = [state for state in range(4) if any(each.holds({str(place): state}) for each in start.until)]
    assert obeyed == [2, 3]


@pytest.mark.parametrize(
    ("command", "first"), [(lambda drive: drive.stop(), 6), (lambda drive: drive.set_reference(hz=20), 3)]
)
def test_undeclared_echo_does_not_confirm_the_first_write(command, first):
    """The drive is dead, and its adapter echoes each request, which looks like the reply to a write."""
    line = VirtualLine([virtual_drive("modbus", 2, model="delta")], echo=True, paced=False)
    sent = []
    with drivecomm.open_bus(line.port, trace=sent.append) as bus:
        with pytest.raises(NoReplyError, match="echoes what it sends"):
            command(bus.drive("modbus", 1, model="delta"))
        # A stop is sent without a read; before a reference the maximum is read.
        assert next(event for event in sent if event.what == "sent").data[1] == first


@pytest.mark.parametrize("paced", [True, False])
def test_undeclared_echo_does_not_confirm_the_stop_of_a_lost_drive(paced):
    drive = virtual_drive("modbus", 1, model="delta")
    line = VirtualLine([drive], echo=True, paced=paced)
    with drivecomm.open_bus(line.port) as bus:
        delta = bus.drive("modbus", 1, model="delta")
        delta.set_reference(hz=20)
        delta.start()
        line.power_off(drive)
        with pytest.raises(ReplyError):
            delta.stop()


def test_first_stop_is_resent_after_the_echo_is_detected():
    """The adapter echoes the stop while the drive misses it."""
    drive = virtual_drive("modbus", 1, model="delta")
    line = VirtualLine([drive], echo=True, paced=False)
    lost = []
    hear, drive.hear = drive.hear, lambda find, now: hear(find, now) if lost else lost.append(find)
    sent = []
    drive.motor.run(20.0, 0.0)
    with drivecomm.open_bus(line.port, trace=sent.append) as bus:
        bus.drive("modbus", 1, model="delta").stop()
    assert [event.data[1] for event in sent if event.what == "sent"] == [6, 3, 6]
    assert drive.motor.target_hz == 0


def test_first_stop_is_followed_by_one_read_and_resent(gs2):
    """The first confirmation may have been an echo, so a read proves the drive and the stop is sent again."""
    sent = []
    line = VirtualLine([gs2])
    with drivecomm.open_bus(line.port, trace=sent.append) as bus:
        drive = bus.drive("modbus", 1, model="gs2", confirmed="gs2")
        drive.stop()
        drive.set_reference(hz=20)
        drive.stop()
    assert [event.data[1] for event in sent if event.what == "sent"] == [6, 3, 6, 6, 6]


@pytest.mark.parametrize("busy", [1, 3, 1000])
def test_stop_is_resent_to_a_busy_drive(busy):
    drive = virtual_drive("modbus", 1, model="delta")
    line = VirtualLine([drive])
    refused = []

    def hear(find, now):
        reply = as_it_is(find, now)
        if reply is None or find.data[1] != 6 or len(refused) == busy:
            return reply
        refused.append(find)
        data = bytes((1, 0x86, 6))
        return VirtualReply(data=data + crc16(data), delay_s=reply.delay_s)

    as_it_is, drive.hear = drive.hear, hear
    with drivecomm.open_bus(line.port) as bus:
        delta = bus.drive("modbus", 1, model="delta")
        if busy < 1000:
            delta.stop()
        else:
            with pytest.raises(RefusedError, match="busy"):
                delta.stop()
            assert 1 < line.time < 2
            assert len(refused) > 5


def test_start_is_not_resent_to_a_busy_drive():
    drive = virtual_drive("modbus", 1, model="delta")
    line = VirtualLine([drive])
    sent = []
    data = bytes((1, 0x86, 6))
    reply = VirtualReply(data=data + crc16(data), delay_s=0.01)
    as_it_is = drive.hear
    drive.hear = lambda find, now: reply if find.data[1] == 6 else as_it_is(find, now)
    with drivecomm.open_bus(line.port, trace=sent.append) as bus, pytest.raises(RefusedError, match="busy"):
        bus.drive("modbus", 1, model="delta").start()
    assert [event.data[1] for event in sent if event.what == "sent"].count(6) == 1


CONTROL_WORDS = [
    ("danfoss-fc", 49999, 0x04BC, 0x043C, 0x047C),
    ("siemens-g120", 99, 0x04FE, 0x047E, 0x047F),
    ("toshiba-vfs11", 0xFA00, 0xE000, 0xC000, 0xC400),
    ("optidrive-e3", 0, 4, 0, 1),
    ("bonfiglioli", 410, 0x80, 0, 6),
    ("abb-acs355", 0, 0x80, 6, 7),
]


@pytest.mark.parametrize(("model", "place", "acknowledge", "release", "start"), CONTROL_WORDS)
def test_fault_is_cleared_by_a_rising_edge_of_the_reset_bit_only(model, place, acknowledge, release, start):
    drive = virtual_drive("modbus", 1, model=model)
    now = 0.0

    def trip():
        nonlocal now
        drive.trip(7, now)
        # Bonfiglioli drives obey no reset within 15 s of a trip.
        now += 15.0

    def write(word):
        reply_to(drive, f"01 06 {place:04X} {word:04X}", now=now)
        return bool(drive.motor.fault)

    for _ in range(2):
        trip()
        assert write(release)
        assert write(start)
        assert not write(acknowledge)
        trip()
        # The bit is still set.
        assert write(acknowledge)
        assert write(release)
        assert not write(acknowledge)
        assert not write(release)


@pytest.mark.parametrize(("model", "place", "acknowledge"), [each[:3] for each in CONTROL_WORDS])
def test_reset_makes_an_edge_even_if_the_bit_was_left_set(model, place, acknowledge):
    drive = virtual_drive("modbus", 1, model=model)
    line = VirtualLine([drive])
    reply_to(drive, f"01 06 {place:04X} {acknowledge:04X}", now=0.0)
    drive.trip(7, 0.0)
    line.advance(15)
    with drivecomm.open_bus(line.port) as bus:
        bus.drive("modbus", 1, model=model).reset()
    assert not drive.motor.fault
    assert not drive.motor.running


@pytest.mark.parametrize("model", ["danfoss-fc", "invt", "hitachi-wj200", "optidrive-plus"])
def test_reset_without_effect_raises_state_error(model, monkeypatch):
    drive = virtual_drive("modbus", 1, model=model)
    line = VirtualLine([drive])
    monkeypatch.setattr(Motor, "reset", lambda _motor, _now: None)
    drive.trip(7, 0.0)
    with drivecomm.open_bus(line.port) as bus, pytest.raises(StateError, match="still tripped after the reset"):
        bus.drive("modbus", 1, model=model).reset()


def test_reset_waits_for_a_drive_that_restarts():
    """WJ200 drives are silent for about a second after a reset."""
    drive = virtual_drive("modbus", 1, model="hitachi-wj200")
    line = VirtualLine([drive])
    drive.trip(7, 0.0)
    as_it_is = drive.hear
    back_at = []

    def hear(find, now):
        if back_at and now < back_at[0]:
            return None
        if drive.motor.fault and find.data[1] == 5 and find.data[3] == 3:
            back_at.append(now + 1.0)
        return as_it_is(find, now)

    drive.hear = hear
    with drivecomm.open_bus(line.port) as bus:
        bus.drive("modbus", 1, model="hitachi-wj200").reset()
    assert not drive.motor.fault
    # The late reply to the first request after the restart is waited for.
    assert line.time < 5


def test_fuji_shows_the_direction_in_status_and_sign_of_the_frequency():
    drive = virtual_drive("modbus", 1, model="fuji-frenic")
    reply_to(drive, "01 06 07 05 07 D0")
    for command, now, frequency in ((1, 100.0, "07 D0"), (2, 200.0, "F8 30")):
        reply_to(drive, f"01 06 07 06 00 0{command}", now)
        status = int(reply_to(drive, "01 03 08 0E 00 01", now + 50)[9:].replace(" ", ""), 16)
        assert status & 3 == command
        assert reply_to(drive, "01 03 08 09 00 01", now + 50) == f"01 03 02 {frequency}"


def test_toshiba_runs_only_if_the_command_bits_are_set():
    drive = virtual_drive("modbus", 1, model="toshiba-vfs11")
    reply_to(drive, "01 06 FA 01 07 D0")
    reply_to(drive, "01 06 FA 00 04 00")
    assert not drive.motor.running
    reply_to(drive, "01 06 FA 00 C4 00")
    assert drive.motor.running
    # The LinuxCNC driver of this series uses functions 03 and 06 only.
    assert reply_to(drive, "01 10 FA 00 00 02 04 C0 00 07 D0") == "01 90 01"


@pytest.mark.parametrize("model", ["delta", "delta-vfd-b", "delta-vfd-e"])
def test_delta_with_its_longest_response_delay_causes_no_timeout(model):
    drive = virtual_drive("modbus", 1, model=model, reply_delay_s=0.21)
    line = VirtualLine([drive])
    with drivecomm.open_bus(line.port) as bus:
        delta = bus.drive("modbus", 1, model=model)
        delta.set_reference(hz=20)
        delta.start()
    assert bus.counters["modbus:1"]["timeouts"] == 0


def test_volatile_write_of_invt_is_lost_in_a_power_cycle():
    drive = virtual_drive("modbus", 1, model="invt")
    line = VirtualLine([drive])
    with drivecomm.open_bus(line.port) as bus:
        one = bus.drive("modbus", 1, model="invt", confirmed="invt")
        name = next(
            each.address
            for each in one.model.parameters.values()
            if each.access == "rw" and each.kind == "setting" and each.storage != "volatile"
        )
        before = drive.peek(name, line.time)
        one.write(name, one.read(name).value + one.model.parameters[name].factor)
        assert drive.peek(name, line.time) == before + 1
        drive.power_cycle(line.time)
        assert drive.peek(name, line.time) == before
