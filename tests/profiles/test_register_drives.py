"""Commands of register drives over a line: each rule is tested once, with a drive of an invented protocol."""

from decimal import Decimal

import pytest
from acme import (
    ACME,
    BUSY,
    MODEL,
    RESET,
    SUM_ERROR,
    AcmeCodec,
    AcmeDialect,
    AcmeOptions,
    Refusal,
    Reply,
    on_a_line,
    telegram,
)

from drivecomm.errors import (
    DamagedReplyError,
    NoReplyError,
    NotSupported,
    RefusedError,
    StateError,
    UsageError,
    ValueRefusedError,
)
from drivecomm.profiles import RegisterCommandMemory, RegisterConversation
from drivecomm.protocol import DriveState, MotorCommand, VirtualReply, installed, run_with_answers

PAGE_1, PAGE_2 = telegram("page", 1), telegram("page", 2)


def refusing(drive, code, times, register=None):
    """Make a virtual drive refuse the next `times` requests instead of carrying them out.

    register: the register whose requests are refused; None: any.
    """
    hears, left = drive.hear, [times]

    def hear(find, now):
        wanted = getattr(find, "message", None)
        if left[0] and wanted is not None and register in (None, wanted.register) and wanted.kind != "page":
            left[0] -= 1
            reply = Refusal(kind="refused", address=wanted.address, register=wanted.register, error=code)
            return VirtualReply(data=AcmeCodec().encode(reply), delay_s=0.005)
        return hears(find, now)

    drive.hear = hear


def test_read_first_chooses_the_page_of_its_parameter():
    with on_a_line(1) as (_, _, sent, drive):
        assert drive.read("ramp_up").value == 2
        assert drive.read("15").raw == 1
        assert drive.read("decimals").raw == 2
        assert sent() == [PAGE_1, telegram("read", 2), PAGE_1, telegram("read", 5), PAGE_2, telegram("read", 3)]


def test_page_is_chosen_again_after_a_lost_reply():
    """The drive may have restarted in between and be on another page."""
    with on_a_line(1) as (line, _, sent, drive):
        virtual = line.drives[0]
        hears, lost = virtual.hear, []

        def hear(find, now):
            if find.message.kind == "read" and not lost:
                lost.append(virtual.power_cycle(now))
                return None
            return hears(find, now)

        virtual.hear = hear
        assert drive.read("ramp_down").value == 4
        assert sent() == [PAGE_1, telegram("read", 3)] * 2


def test_page_request_prepares_and_is_not_a_plain_question():
    with on_a_line(1):
        intent = installed["acme"].intent
        page, read, write = (
            intent(AcmeCodec().decode(telegram(each, 1), "request")) for each in ("page", "read", "write")
        )
        assert intent(AcmeCodec().decode(telegram("read", 201), "request")).commands
    assert (page.prepares, page.moves_nothing, page.only_asks, page.access) == (True, True, False, "")
    assert (read.only_asks, write.moves_nothing, write.access) == (True, False, "write")


def test_signed_and_decimal_values_are_read_and_written():
    with on_a_line(1) as (line, _, _, drive):
        assert drive.read("trim").value == Decimal("-2.5")
        drive.write("trim", "-0.75", store=True)
        assert line.drives[0].peek("trim", line.time) == 0x10000 - 75
        assert str(drive.read("shown_with_decimals").value) == "12.34"
        assert drive.read("18", type="u16").raw == 0x10000 - 75


@pytest.mark.parametrize("kind", ["s32", "f32"])
def test_type_of_several_words_is_refused_for_a_one_word_place(kind):
    with on_a_line(1) as (_, _, sent, drive):
        for call in (lambda: drive.read("18", type=kind), lambda: drive.write("18", 1, type=kind, store=True)):
            with pytest.raises(UsageError, match="has 16 bits"):
                call()
        assert sent() == []


def test_refusal_that_reports_a_line_error_is_retried():
    with on_a_line(1) as (line, _, sent, drive):
        refusing(line.drives[0], SUM_ERROR, 2)
        assert drive.read("125").value == 0
        assert sent() == [telegram("read", 125)] * 3
        refusing(line.drives[0], SUM_ERROR, 9)
        with pytest.raises(DamagedReplyError, match="request arrived damaged"):
            drive.read("125")
        assert len(sent()) == 6


def test_stop_is_resent_after_a_line_error_and_start_is_not():
    with on_a_line(1) as (line, _, sent, drive):
        refusing(line.drives[0], SUM_ERROR, 1, 120)
        drive.stop()
        assert sent() == [telegram("write", 120, 0)] * 2
        refusing(line.drives[0], SUM_ERROR, 1, 120)
        with pytest.raises(DamagedReplyError, match="had been commanded to run"):
            drive.start()
        assert sent().count(telegram("write", 120, 1)) == 1


def test_busy_drive_is_retried_for_one_second():
    with on_a_line(1) as (line, _, _, drive):
        refusing(line.drives[0], BUSY, 10)
        assert drive.read("125").value == 0
        refusing(line.drives[0], BUSY, 100)
        began = line.time
        with pytest.raises(RefusedError, match="busy"):
            drive.read("125")
        assert 1 <= line.time - began < 1.5


def test_stop_and_its_page_request_are_urgent():
    dialect = AcmeDialect(1, AcmeOptions(), MODEL)
    drive = RegisterConversation(dialect, RegisterCommandMemory())
    stopping = drive.write(dialect.place_of("11"), (0,), "11", urgent=True, attempts=None)
    page = next(stopping)
    stop = stopping.send(dialect.write_reply(page.message))
    assert (page.message.kind, page.urgent, stop.message.kind, stop.urgent) == ("page", True, "write", True)


def test_start_checks_its_conditions_and_a_reverse_start_checks_more():
    with on_a_line(1) as (line, _, sent, drive):
        virtual = line.drives[0]
        virtual.poke("16", 1)
        drive.start()
        drive.stop()
        line.advance(5)
        before = len(sent())
        with pytest.raises(StateError, match="reverse_lock"):
            drive.start(reverse=True)
        virtual.poke("15", 0)
        with pytest.raises(StateError, match="command_source"):
            drive.start()
        assert telegram("write", 120, 3) not in sent()
        assert telegram("write", 120, 1) not in sent()[before:]


def test_reverse_start_turns_the_motor_backwards():
    with on_a_line(1) as (line, _, _, drive):
        drive.start(reverse=True)
        line.advance(5)
        assert line.drives[0].motor.output_hz == 0 or drive.status().reverse
        assert line.drives[0].motor.output_hz == -25


def test_start_that_is_not_obeyed_is_taken_back():
    with on_a_line(1) as (line, _, sent, drive):
        virtual = line.drives[0]
        virtual._machine._orders.act = lambda _now: None
        with pytest.raises(StateError, match="taken back"):
            drive.start()
        assert sent().count(telegram("write", 120, 1)) == 1
        assert telegram("write", 120, 0) in sent()


def test_reset_without_reply_is_sent_once_and_waits_for_the_restart():
    with on_a_line(1) as (line, _, sent, drive):
        line.drives[0].trip(9, line.time)
        assert drive.status().fault_code == 9
        began = line.time
        drive.reset()
        assert sent().count(telegram("write", RESET, 0x9696)) == 1
        assert line.time - began >= 2
        assert drive.status().state is DriveState.READY


def test_reference_above_the_maximum_is_refused_unsent():
    with on_a_line(1) as (_, _, sent, drive):
        for asked in ({"hz": 61}, {"hz": -61}, {"percent": 101}):
            with pytest.raises(ValueRefusedError):
                drive.set_reference(**asked)
        assert not [each for each in sent() if each[2:4] == b"W" + bytes([126])]
        drive.set_reference(hz=60)
        drive.set_reference(percent=50)
        assert drive.read("reference").value == 30


def test_reference_is_refused_unsent_if_the_drive_uses_another_source():
    with on_a_line(1) as (line, _, sent, drive):
        line.drives[0].poke("17", 0)
        for asked in ({"hz": 10}, {"percent": 10}):
            with pytest.raises(StateError, match="reference_source"):
                drive.set_reference(**asked)
        with pytest.raises(StateError, match="reference_source"):
            drive.write("reference", 10)
        assert not [each for each in sent() if each[2:4] == b"W" + bytes([126])]


def test_reference_is_never_rounded():
    with on_a_line(1) as (_, _, _, drive), pytest.raises(ValueRefusedError):
        drive.set_reference(hz="10.05")


@pytest.mark.parametrize(("writes", "store"), [("stored", True), ("volatile", False)])
def test_write_to_a_storage_that_the_drive_lacks_is_refused_unsent(writes, store):
    with on_a_line(1, writes=writes) as (_, _, sent, drive):
        with pytest.raises(NotSupported, match="store"):
            drive.write("ramp_up", 3, store=not store)
        assert sent() == []
        drive.write("ramp_up", 3, store=store)
        with pytest.raises(NotSupported, match="is not kept without mains"):
            drive.write("reference", 3, store=True)


def test_write_to_a_command_parameter_is_sent_once():
    with on_a_line(1) as (line, _, sent, drive):
        hears, virtual = line.drives[0].hear, line.drives[0]
        virtual.hear = lambda find, now: None if find.message.kind == "write" else hears(find, now)
        with pytest.raises(NoReplyError, match="whether the drive acted on it is not known"):
            drive.write("reference", 3)
        assert len([each for each in sent() if each[2:3] == b"W"]) == 1


def test_verb_of_the_dialect_sends_its_write():
    with on_a_line(1) as (_, _, sent, drive):
        drive.jog(2)
        assert sent() == [telegram("write", 130, 2)]


def test_broadcast_stops_all_drives_and_refuses_other_verbs():
    with on_a_line(1, 2) as (line, bus, sent, *drives):
        for each in drives:
            each.start()
        everybody = bus.broadcast("acme", model=drives[0].model)
        before = len(sent())
        everybody.stop()
        line.advance(0.1)
        assert sent()[before:] == [telegram("write", 120, 0, address=0)]
        assert [each.motor.command for each in line.drives] == [MotorCommand.RAMP_STOP] * 2
        verbs = ACME.operations(0, AcmeOptions(), drives[0].model)
        for call in (verbs.start, verbs.reset, verbs.identify, verbs.probe, lambda: verbs.read("125")):
            with pytest.raises(NotSupported, match="for one drive"):
                run_with_answers(call(), lambda _: None)


def test_drive_without_a_model_is_read_but_not_commanded():
    with on_a_line(1) as (_, bus, sent, _):
        drive = bus.drive("acme", 1)
        assert drive.read("122").raw == 0
        for call in (drive.start, drive.stop, drive.reset, drive.status, lambda: drive.set_reference(hz=1)):
            with pytest.raises(NotSupported, match="name the drive's model"):
                call()
        assert len(sent()) == 1


def test_reply_must_match_the_repeated_fields_of_its_request():
    dialect = AcmeDialect(1, AcmeOptions(), None)
    asked = dialect.writing(dialect.place_of("126"), (5,)).message
    right = dialect.write_reply(asked)
    assert dialect.mismatch(asked, right) == ""
    for field, value in (("address", 2), ("register", 125), ("data", 6), ("kind", "read")):
        other = Reply(**{"kind": "write", "address": 1, "register": 126, "data": 5, field: value})
        assert dialect.mismatch(asked, other) == field
    assert dialect.mismatch(asked, dialect.refusal_reply(asked, 3)) == ""


def test_probe_is_sent_once():
    with on_a_line(1) as (line, _, sent, drive):
        drive.probe()
        line.power_off(line.drives[0])
        with pytest.raises(NoReplyError):
            drive.probe()
        assert sent() == [telegram("read", 122)] * 2


def test_fault_with_code_zero_has_no_fault_code():
    with on_a_line(1) as (line, _, _, drive):
        line.drives[0].trip(9, line.time)
        assert drive.status().fault_code == 9
        line.drives[0].poke("last_fault", 0)
        assert (drive.status().fault, drive.status().fault_code) == (True, None)
