"""The virtual line as a medium: collisions, late and replaced replies, foreign traffic, echo, power."""

import pytest

import drivecomm
from drivecomm.errors import LinkDownError, NoReplyError, UsageError
from drivecomm.plant import Fault, FaultPlan
from drivecomm.protocol import Command, Framed, LineSettings, Motor, VirtualReply
from drivecomm.virtual import Medium, Transmission, VirtualLine, virtual_drive
from drivecomm_vabus.telegrams import Ack, Enquiry, Value, telegrams

SETTINGS = LineSettings(baudrate=9600, bytesize=7, parity="E")
CHARACTER_S = 10 / 9600


class Teller:
    """A drive that answers each enquiry with the parameter number as its value, after a delay."""

    def __init__(self, address=1, delay_s=0.01):
        self.address = address
        self.settings = SETTINGS
        self.gap_s = 0.05
        self.motor = Motor()
        self.codec = telegrams()
        self.delay_s = delay_s
        self.asked = []
        self.asked_at = []
        self.cycled = []

    def hear(self, find, now):
        if not isinstance(find, Framed) or getattr(find.message, "address", None) != self.address:
            return None
        self.asked_at.append(now)
        self.asked.append(find.message.parameter)
        return VirtualReply(data=value(find.message.parameter, self.address), delay_s=self.delay_s)

    def power_cycle(self, now):
        self.cycled.append(now)


def enquiry(parameter, address=1):
    return telegrams().encode(Enquiry(address=address, parameter=parameter))


def value(parameter, address=1):
    return telegrams().encode(Value(address=address, sys=0, dataset=0, parameter=parameter, data=f"{parameter:04X}"))


ENQUIRY = enquiry(481)
REPLY = value(481)
REPLY_AT = 8 * CHARACTER_S + 0.01


def on(*drives, **options):
    """Return a line with these drives, and its port at their settings."""
    line = VirtualLine(drives, **options)
    port = line.port()
    port.configure(SETTINGS)
    return line, port


def sent(data, began, source="drive"):
    ended = began + len(data) * CHARACTER_S
    return Transmission(source=source, sender=None, settings=SETTINGS, data=data, began=began, ended=ended)


# Collisions


def test_overlapping_characters_are_spoilt_on_both_sides():
    medium = Medium()
    first, second = sent(b"ABCDEF", 0.0), sent(b"uvwxyz", 3.5 * CHARACTER_S)
    medium.begin(first)
    medium.begin(second)
    assert first.data == b"ABC\0\0\0"
    assert second.data == b"\0\0\0xyz"
    assert first.garbled
    assert second.garbled


def test_transmissions_in_direct_succession_are_not_spoilt():
    medium = Medium()
    first, second = sent(b"ABC", 0.0), sent(b"xyz", 3 * CHARACTER_S)
    medium.begin(first)
    medium.begin(second)
    assert (first.data, second.data) == (b"ABC", b"xyz")
    assert not first.garbled
    assert not second.garbled


def test_short_transmission_spoils_the_middle_of_a_long_one():
    medium = Medium()
    first, second = sent(b"ABCDEF", 0.0), sent(b"x", 2 * CHARACTER_S)
    medium.begin(first)
    medium.begin(second)
    assert (first.data, second.data) == (b"AB\0DEF", b"\0")


def test_echo_is_spoilt_by_others_and_spoils_none():
    medium = Medium()
    request, echo, reply = sent(b"ABC", 0.0, "master"), sent(b"ABC", 0.0, "echo"), sent(b"x", 2 * CHARACTER_S)
    for each in (request, echo, reply):
        medium.begin(each)
    assert echo.data == request.data == b"AB\0"
    # It has collided with the request.
    assert reply.data == b"\0"
    later = sent(b"ABC", 1.0, "echo")
    reply = sent(b"x", 1.0)
    medium.begin(reply)
    medium.begin(later)
    assert (later.data, reply.data) == (b"\0BC", b"x")


def test_reply_and_next_request_that_collide_spoil_each_other():
    drive = Teller()
    _, port = on(drive)
    port.write(ENQUIRY)
    port.wait(REPLY_AT + 2 * CHARACTER_S)
    port.write(ENQUIRY)
    assert port.read(1.0, 100) == REPLY[:2] + REPLY[10:]
    assert drive.asked == [481], "the second request is noise to the drive"


def test_characters_received_before_a_collision_stay():
    line, port = on(Teller())
    port.write(ENQUIRY)
    assert port.read(1.0, 3) == REPLY[:3]
    line.inject(b"!")
    assert port.read(1.0, 100) == REPLY[4:]


def test_two_drives_that_reply_simultaneously_spoil_each_other():
    _, port = on(Teller(), Teller())
    port.write(ENQUIRY)
    assert port.read(1.0, 100) == b""


def test_transmissions_of_one_sender_never_collide():
    line, port = on()
    line.inject(b"ABC")
    line.inject(b"DEF")
    assert port.read(1.0, 100) == b"ABCDEF"


# Reading


def test_read_ends_with_the_character_that_it_waits_for():
    _, port = on(Teller())
    port.write(ENQUIRY)
    for number in range(1, len(REPLY) + 1):
        assert port.read(1.0, 1) == REPLY[number - 1 : number]
        assert port.now() == pytest.approx(REPLY_AT + number * CHARACTER_S)
    _, port = on(Teller())
    port.write(ENQUIRY)
    assert port.read(1.0, 7) == REPLY[:7]
    assert port.now() == pytest.approx(REPLY_AT + 7 * CHARACTER_S)


def test_read_that_ends_within_a_telegram_leaves_the_rest():
    _, port = on(Teller())
    port.write(ENQUIRY)
    assert port.read(REPLY_AT + 2.5 * CHARACTER_S, 100) == REPLY[:2]
    assert port.read(1.0, 100) == REPLY[2:]


def test_character_times_are_exact_after_a_day():
    _, port = on(Teller())
    port.wait(86400.123)
    began = port.now()
    port.write(ENQUIRY)
    assert port.read(began + 1.0, 5) == REPLY[:5]
    assert port.now() == pytest.approx(began + REPLY_AT + 5 * CHARACTER_S)


def test_take_takes_no_time():
    _, port = on(Teller())
    assert port.take() == b""
    port.write(ENQUIRY)
    port.wait(REPLY_AT + 4 * CHARACTER_S)
    now = port.now()
    assert port.take() == REPLY[:4]
    assert port.take() == b""
    assert port.now() == now


def test_change_of_settings_keeps_earlier_characters():
    _, port = on(Teller())
    port.write(ENQUIRY)
    port.wait(REPLY_AT + 4 * CHARACTER_S)
    port.configure(LineSettings(baudrate=19200))
    heard = port.read(1.0, 100)
    assert heard[:4] == REPLY[:4]
    assert heard[4:] != REPLY[4:]


def test_virtual_port_is_paced_in_virtual_time_without_a_descriptor():
    port = VirtualLine().port()
    assert (port.paced, port.real_time, port.descriptor) == (True, False, None)
    port.hold_back(14)
    assert port.read(0.1, 1) == b""


def test_take_from_a_broken_line_fails():
    line, port = on()
    line.broken = True
    with pytest.raises(LinkDownError):
        port.take()


# One reply per drive


def test_later_request_replaces_an_unanswered_one():
    drive = Teller(delay_s=0.05)
    _, port = on(drive)
    port.write(enquiry(480))
    port.wait(0.03)
    port.write(enquiry(481))
    assert port.read(1.0, 100) == value(481)
    assert drive.asked == [480, 481]


def test_request_for_another_drive_replaces_none():
    _, port = on(Teller(1, delay_s=0.1), Teller(2, delay_s=0.01))
    port.write(enquiry(480, 1))
    port.wait(0.02)
    port.write(enquiry(481, 2))
    assert port.read(1.0, 100) == value(481, 2) + value(480, 1)


def test_reply_delayed_on_its_way_arrives_and_delays_no_other():
    class Late(FaultPlan):
        delays = iter((0.5, 0.0))

        def reply(self, data):
            return [(next(self.delays), data)]

    _, port = on(Teller(), faults=Late(rate=0.0))
    port.write(enquiry(480))
    port.wait(0.1)
    port.write(enquiry(481))
    assert port.read(0.4, 100) == value(481)
    assert port.read(1.0, 100) == value(480)
    assert len(value(480)) * CHARACTER_S < 0.5


def test_request_delayed_on_its_way_delays_no_other():
    class Late(FaultPlan):
        delays = iter((0.5, 0.0))

        def request(self, data):
            return [(next(self.delays), data)]

    drive = Teller()
    _, port = on(drive, faults=Late(rate=0.0))
    port.write(enquiry(480))
    port.write(enquiry(481))
    assert port.read(1.0, 100) == value(481) + value(480)
    assert drive.asked == [481, 480]


# Foreign traffic and echo


def test_foreign_traffic_reaches_drives_and_master():
    drive = Teller(delay_s=0.2)
    plan = FaultPlan(rate=1.0, kinds=[Fault.FOREIGN], traffic=[enquiry(482)], traffic_within_s=0.1, replies=False)
    _, port = on(drive, faults=plan)
    port.write(b"\x04")
    assert port.read(0.15, 100) in (enquiry(482), b"\0" + enquiry(482)[1:])
    assert drive.asked == [482]
    assert 8 * CHARACTER_S < drive.asked_at[0] < 0.1 + 8 * CHARACTER_S
    assert plan.happened == {Fault.FOREIGN: 1}


def test_simultaneous_foreign_traffic_spoils_a_request():
    drive = Teller()
    plan = FaultPlan(rate=1.0, kinds=[Fault.FOREIGN], traffic=[enquiry(482)], traffic_within_s=0.0)
    _, port = on(drive, faults=plan)
    port.write(ENQUIRY)
    assert port.read(0.5, 100) == b""
    assert drive.asked == []


def test_foreign_fault_without_traffic_sends_nothing():
    plan = FaultPlan(rate=1.0, kinds=[Fault.FOREIGN])
    assert plan.foreign() == []
    assert plan.happened == {}


def test_partial_echo_lacks_some_characters():
    plan = FaultPlan(rate=1.0, kinds=[Fault.ECHO_PARTIAL])
    echoes = [plan.echo(b"0123456789") for _ in range(200)]
    assert {len(echo) for echo in echoes} == set(range(10))
    assert all(b"0123456789".startswith(echo[:1]) or echo[0] != ord("0") for echo in echoes)
    for echo in echoes:
        first = next((place for place in range(len(echo)) if echo[place] != ord("0") + place), len(echo))
        assert b"0123456789".startswith(echo[:first])
        assert b"0123456789".endswith(echo[first:])


def test_noisy_echo_has_up_to_three_changed_characters():
    plan = FaultPlan(rate=1.0, kinds=[Fault.ECHO_NOISY])
    echoes = [plan.echo(b"0123456789") for _ in range(200)]
    assert {len(echo) for echo in echoes} == {10}
    wrong = [sum(a != b for a, b in zip(echo, b"0123456789", strict=True)) for echo in echoes]
    assert set(wrong) <= {0, 1, 2, 3}
    assert wrong.count(0) < 5


def test_drive_receives_the_characters_missing_in_the_echo():
    drive = Teller()
    _, port = on(drive, echo=True, faults=FaultPlan(rate=1.0, kinds=[Fault.ECHO_PARTIAL]))
    port.write(ENQUIRY)
    heard = port.read(1.0, 100)
    assert drive.asked == [481]
    assert heard.endswith(REPLY)
    assert len(heard) < len(ENQUIRY + REPLY)


def test_faults_of_transmissions_leave_an_echo_unchanged():
    plan = FaultPlan(rate=1.0, kinds=[Fault.CORRUPT, Fault.DROP])
    assert plan.echo(ENQUIRY) == ENQUIRY
    assert plan.foreign() == []
    assert plan.power() is None
    assert plan.happened == {}


def test_default_faults_are_those_of_a_transmission():
    plan = FaultPlan(rate=1.0, traffic=[b"x"])
    for _ in range(200):
        plan.request(b"0123")
        assert plan.foreign() == []
        assert plan.echo(b"0123") == b"0123"
    assert {fault.value for fault in plan.happened} == {"drop", "corrupt", "truncate", "delay", "duplicate"}


# Power


def test_drive_without_power_neither_receives_nor_replies():
    drive = Teller()
    line, port = on(drive)
    line.power_off(drive)
    port.write(ENQUIRY)
    assert port.read(1.0, 100) == b""
    assert drive.asked == []
    line.power_on(drive)
    assert drive.cycled == [1.0]
    port.write(ENQUIRY)
    assert port.read(2.0, 100) == REPLY


def test_power_loss_during_a_reply_cuts_it():
    drive = Teller()
    line, port = on(drive)
    line.call_at(REPLY_AT + 3.5 * CHARACTER_S, lambda: line.power_off(drive))
    port.write(ENQUIRY)
    assert port.read(1.0, 100) == REPLY[:3]


def test_power_loss_before_a_reply_cancels_it():
    drive = Teller()
    line, port = on(drive)
    port.write(ENQUIRY)
    port.wait(REPLY_AT - 0.001)
    line.power_off(drive)
    line.power_on(drive)
    assert port.read(1.0, 100) == b""


def test_partial_telegram_is_forgotten_without_power():
    drive = Teller()
    line, port = on(drive)
    port.write(ENQUIRY[:4])
    port.wait(4.1 * CHARACTER_S)
    line.power_off(drive)
    line.power_on(drive)
    port.write(ENQUIRY[4:])
    assert port.read(1.0, 100) == b""


def test_motor_without_power_coasts():
    drive = Teller()
    line, _ = on(drive)
    drive.motor.run(20.0, 0.0)
    line.advance(10.0)
    line.power_off(drive)
    assert drive.motor.command is Command.OFF


def test_drive_may_return_with_other_line_settings():
    drive = virtual_drive("danfoss-fc", 3, baudrate=19200)
    line = VirtualLine([drive])
    with drivecomm.open_bus(line.port) as bus:
        fan = bus.drive("danfoss-fc", 3, baudrate=19200, attempts=1)
        fan.probe()
        line.power_off(drive)
        line.power_on(drive, LineSettings(baudrate=9600, parity="E"))
        with pytest.raises(NoReplyError):
            fan.probe()
        bus.drive("danfoss-fc", 3, baudrate=9600).probe()


def test_power_loss_resets_volatile_values():
    drive = virtual_drive("danfoss-fc", 3)
    line = VirtualLine([drive])
    before = drive.peek("3-41", 0.0)
    with drivecomm.open_bus(line.port) as bus:
        bus.drive("danfoss-fc", 3, model="fc300").write("3-41", 7)
        assert drive.peek("3-41", line.time) != before
        line.power_off(drive)
        line.power_on(drive)
    assert drive.peek("3-41", line.time) == before


def test_switching_the_power_of_a_drive_on_another_line_is_refused():
    line, _ = on(Teller())
    for switch in (line.power_off, line.power_on):
        with pytest.raises(UsageError, match="the drive at address 7 is not on this virtual line"):
            switch(Teller(7))


def test_power_faults_cut_replies_and_end():
    factory = LineSettings(baudrate=4800, bytesize=7, parity="E")
    drive = Teller()
    plan = FaultPlan(rate=1.0, kinds=[Fault.POWER], factory=factory, outage_s=0.5, mismatch_s=0.5)
    line, port = on(drive, faults=plan)
    seen = set()
    for _ in range(30):
        port.write(ENQUIRY)
        plan.rate = 1.0
        cut = port.read(line.time + 0.05, 100)
        plan.rate = 0.0
        assert cut != REPLY
        for _ in range(30):
            port.wait(line.time + 0.05)
            seen.add(drive.settings)
        assert drive.settings == SETTINGS
        port.write(ENQUIRY)
        assert port.read(line.time + 0.1, 100) == REPLY
    assert seen == {SETTINGS, factory}
    assert plan.happened == {Fault.POWER: 30}


# Monitors and timed calls


def test_call_at_runs_functions_at_their_times():
    line, port = on()
    done = []
    line.call_at(0.5, lambda: done.append(line.time))
    line.call_at(0.2, lambda: done.append(line.time))
    assert port.read(1.0, 1) == b""
    assert done == [0.2, 0.5]
    line.call_at(0.3, lambda: done.append(line.time))
    port.wait(1.0)
    assert done == [0.2, 0.5, 1.0]


def test_monitor_receives_all_transmissions_but_echoes():
    drive = Teller()
    line, port = on(drive, echo=True)
    seen = []
    line.monitors.append(seen.append)
    port.write(ENQUIRY)
    port.wait(0.5)
    line.inject(b"?")
    port.wait(1.0)
    assert [(each.source, each.sender, each.data, each.garbled) for each in seen] == [
        ("master", None, ENQUIRY, False),
        ("drive", drive, REPLY, False),
        ("foreign", None, b"?", False),
    ]
    assert seen[1].began == pytest.approx(REPLY_AT)
    assert seen[1].ended == pytest.approx(REPLY_AT + len(REPLY) * CHARACTER_S)


def test_acknowledgement_is_sent_like_any_reply():
    class Yes(Teller):
        def hear(self, find, now):
            return None if super().hear(find, now) is None else VirtualReply(data=ACK, delay_s=0.0)

    _, port = on(Yes())
    port.write(ENQUIRY)
    assert port.read(1.0, 2) == ACK
    assert port.now() == pytest.approx(10 * CHARACTER_S)


ACK = telegrams().encode(Ack(address=1))


def test_unread_bytes_are_lost_when_the_buffer_is_full():
    line, port = on()
    for _ in range(20):
        line.inject(b"x" * 4000)
        line.advance(4001 * CHARACTER_S)
    assert 60_000 < len(port.read(port.now(), 1_000_000)) < 70_000
