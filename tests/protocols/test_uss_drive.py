"""USS drives beyond plain values: change reports, unusual tasks, arrays, descriptions and parameter sets."""

import dataclasses

import pytest

import drivecomm
from drivecomm.errors import NoReplyError, RefusedError, TelegramError, UnexpectedReplyError
from drivecomm.protocol import Framed, Framer, installed
from drivecomm.virtual import VirtualLine, virtual_drive

PLUGIN = installed["uss"]
ADDRESS = 3


def telegram(*content):
    """Return a telegram with these bytes: STX, LGE, the bytes and BCC."""
    data = bytes([2, len(content) + 1, *content])
    check = 0
    for byte in data:
        check ^= byte
    return data + bytes([check])


def words(*numbers):
    return [byte for number in numbers for byte in number.to_bytes(2, "big")]


def drive_of(model="micromaster4", **options):
    return virtual_drive("uss", ADDRESS, model=model, **options)


def answer_to(virtual, *area):
    """Return the words of the parameter area in the reply of a drive to this one; None for silence."""
    data = telegram(ADDRESS, *words(*area, 0, 0))
    find, *_ = Framer(virtual.codec, "request").feed(data)
    reply = virtual.hear(find, 0.0)
    if reply is None:
        return None
    assert telegram(*reply.data[2:-1]) == reply.data
    content = reply.data[3:-1]
    return tuple(int.from_bytes(content[at : at + 2], "big") for at in range(0, len(content) - 4, 2))


class Reporting:
    """A drive that sends parameter change reports instead of replies until they are acknowledged (C-16, C-17)."""

    def __init__(self, virtual, reports):
        self.virtual, self.reports = virtual, reports
        self.spm, self.pending = False, False
        self.acknowledged = []

    def __getattr__(self, name):
        return getattr(self.virtual, name)

    def hear(self, find, now):
        reply = self.virtual.hear(find, now)
        if reply is None or find.message.mirror:
            return reply
        if self.pending and bool(find.message.spm) is self.spm:
            self.pending = False
            self.acknowledged.append(self.reports.pop(0))
        if self.reports and not self.pending:
            self.pending, self.spm = True, not self.spm
        if not self.pending:
            return reply
        message = self.codec.decode(reply.data, "reply")
        plain = {"status_word": message.status_word, "actual": message.actual, "address": message.address}
        plain |= {"ak": 9, "spm": self.spm, "pnu": 304, "index": 0, "page": 0, "value": self.reports[0]}
        return dataclasses.replace(reply, data=self.codec.encode(PLUGIN.message(plain, "reply")))


class TestReports:
    @pytest.fixture
    def reporting(self):
        virtual = Reporting(drive_of(), [400, 401, 402])
        line = VirtualLine([virtual])
        with drivecomm.open_bus(line.port) as bus:
            yield virtual, bus.drive("uss", ADDRESS, model="micromaster4"), line

    def test_reports_are_acknowledged_before_a_value_is_read(self, reporting):
        virtual, drive, line = reporting
        virtual.poke("700", 5)
        assert drive.read("700").raw == 5
        assert virtual.acknowledged == [400, 401, 402]
        assert line.time < 0.5
        assert drive.read("700").raw == 5

    def test_write_is_confirmed_after_pending_reports(self, reporting):
        virtual, drive, _ = reporting
        assert drive.write("1082", 40).value == 40
        assert virtual.acknowledged == [400, 401, 402]

    def test_commands_and_status_do_not_wait_for_reports(self, reporting):
        virtual, drive, line = reporting
        drive.set_reference(percent=50)
        drive.start()
        line.advance(20)
        assert drive.status().running
        drive.stop()
        assert line.time < 21
        assert virtual.acknowledged

    def test_endless_reports_raise_unexpected_reply_error(self):
        virtual = Reporting(drive_of(), list(range(1000)))
        with (
            drivecomm.open_bus(VirtualLine([virtual]).port) as bus,
            pytest.raises(UnexpectedReplyError, match="report"),
        ):
            bus.drive("uss", ADDRESS).read("700")


class Working:
    """A drive that needs time for each new task (C-15).

    Meanwhile it sends the reply to the previous task, or to no task.
    """

    def __init__(self, virtual, replies, *, before):
        self.virtual, self.replies, self.before = virtual, replies, before
        self.task, self.said, self.left, self.heard = None, None, 0, 0

    def __getattr__(self, name):
        return getattr(self.virtual, name)

    def hear(self, find, now):
        self.heard += 1
        message = find.message
        task = (message.ak, message.pnu, message.index, message.value)
        if task != self.task:
            self.task, self.left = task, self.replies
        if self.left and self.said is not None:
            self.left -= 1
            return self.said if self.before else self.virtual.hear(no_task(self.virtual.codec), now)
        self.said = self.virtual.hear(find, now)
        return self.said


def no_task(codec):
    (find,) = Framer(codec, "request").feed(telegram(ADDRESS, *bytes(12)))
    return find


class TestTasksThatTakeTime:
    @pytest.mark.parametrize("before", [True, False])
    @pytest.mark.parametrize("replies", [1, 2, 7])
    def test_slow_task_is_repeated_until_it_is_done(self, before, replies):
        virtual = Working(drive_of(pkw_words=4), replies, before=before)
        line = VirtualLine([virtual])
        with drivecomm.open_bus(line.port) as bus:
            drive = bus.drive("uss", ADDRESS, model="micromaster4", pkw_words=4, attempts=1)
            assert drive.read("1082").value == 50
            assert drive.write("1082", 60).value == 60
            assert drive.write("1082", 70).value == 70
            assert drive.read("1082").value == 70
            assert drive.status().state is drivecomm.DriveState.NOT_READY

    def test_slow_task_is_repeated_without_waiting_for_the_reply_timeout(self):
        virtual = Working(drive_of(pkw_words=4), 1, before=False)
        line = VirtualLine([virtual])
        with drivecomm.open_bus(line.port) as bus:
            drive = bus.drive("uss", ADDRESS, model="micromaster4", pkw_words=4)
            drive.read("1082")
            began = bus.now()
            drive.read("1120")
            # Two exchanges at 9600 baud and a short pause; the reply timeout of 100 ms is for missing replies only.
            assert bus.now() - began < 0.1

    def test_task_that_is_never_done_raises_unexpected_reply_error(self):
        virtual = Working(drive_of(pkw_words=4), 1000, before=False)
        with drivecomm.open_bus(VirtualLine([virtual]).port) as bus:
            drive = bus.drive("uss", ADDRESS, model="micromaster4", pkw_words=4)
            drive.read("1082")
            with pytest.raises(UnexpectedReplyError, match="differs in pending"):
                drive.read("1120")
            assert virtual.heard < 60


class TestLengths:
    @pytest.mark.parametrize("options", [{}, {"pkw_words": 4}, {"pkw_words": 0}, {"pkw_words": 3, "pzd_words": 0}])
    @pytest.mark.parametrize("adr", [0x83, 0x43])
    @pytest.mark.parametrize("size", [0, 2, 10, 252])
    def test_special_or_mirrored_reply_may_have_any_length(self, options, adr, size):
        codec = PLUGIN.codec(PLUGIN.options(**options))
        data = telegram(adr, *bytes(size))
        (find,) = Framer(codec, "reply").feed(data)
        assert isinstance(find, Framed)
        assert codec.encode(find.message) == data

    @pytest.mark.parametrize("pkw_words", [4, 127])
    def test_mirror_request_must_have_the_configured_length(self, pkw_words):
        """A-8: a drive accepts no other length."""
        codec = PLUGIN.codec(PLUGIN.options(pkw_words=pkw_words))
        data, short = telegram(0x43, *bytes(12)), telegram(0x43, *bytes(2))
        with pytest.raises(TelegramError):
            codec.decode(short, "request")
        assert codec.encode(codec.decode(data, "request")) == data
        drive = drive_of(pkw_words=pkw_words)
        assert drive.hear(Framer(drive.codec, "request").feed(data)[0], 0.0).data == data
        assert not [find for find in Framer(drive.codec, "request").feed(short) if isinstance(find, Framed)]


class TestStrangeTasks:
    def test_parameter_number_beyond_the_page_is_refused(self):
        """PNU ends at 1999; the page is in IND."""
        assert answer_to(drive_of(), 0x17D0, 0, 0) == (0x77D0, 0, 0)
        assert answer_to(drive_of(pkw_words=4), 0x1FFF - 0x0800, 0, 0, 0) == (0x77FF, 0, 0, 0)

    @pytest.mark.parametrize("ind", [0x0100, 0x0200, 0x0300])
    def test_unused_bits_of_the_index_word_are_refused(self, ind):
        assert answer_to(drive_of(), 0x12BC, ind, 0) == (0x72BC, ind, 3)
        assert answer_to(drive_of("masterdrives"), 0x12AC, ind, 0) == (0x72AC, ind, 3)

    @pytest.mark.parametrize("ind", [0x0100, 0x8000])
    def test_page_bits_are_refused_by_a_nord_drive(self, ind):
        assert answer_to(drive_of("nord"), 0x1190, ind, 0, 0) == (0x7190, ind, 0, 3)

    def test_page_without_parameters_is_refused(self):
        assert answer_to(drive_of(), 0x1000, 0x7400, 0) == (0x7000, 0x7400, 0)

    def test_double_word_in_an_area_of_three_words_is_refused(self):
        assert answer_to(drive_of(pkw_words=3), 0x343A, 0, 0) == (0x743A, 0, 102)
        assert answer_to(drive_of(pkw_words=3), 0x143A, 0, 0) == (0x743A, 0, 102)

    @pytest.mark.parametrize("ak", [5, 10, 15])
    def test_unknown_task_is_refused_with_the_code_of_the_series(self, ak):
        assert answer_to(drive_of(), ak << 12 | 700, 0, 0) == (0x7000 | 700, 0, 106)
        assert answer_to(drive_of("nord"), ak << 12 | 400, 0, 0, 0) == (0x7000 | 400, 0, 0, 201)

    @pytest.mark.parametrize(("ak", "code"), [(5, 7), (10, 106), (15, 15)])
    def test_unknown_task_of_masterdrives_is_refused_with_its_own_code(self, ak, code):
        assert answer_to(drive_of("masterdrives"), ak << 12 | 683, 1, 0) == (0x7000 | 683, 1, code)

    def test_description_task_is_refused_by_a_nord_drive(self):
        assert answer_to(drive_of("nord"), 0x4190, 2, 0, 0) == (0x7190, 2, 0, 201)

    @pytest.mark.parametrize("ak", [11, 12, 13, 14])
    def test_store_task_beyond_the_tables_of_a_g120_is_refused(self, ak):
        area = ak << 12 | 22, 0x8000, 0, 2
        assert answer_to(drive_of("g120"), *area)[-1] == 106

    def test_task_0_is_answered_by_0_with_any_index(self):
        assert answer_to(drive_of(), 0x07D0, 0x0300, 0) == (0, 0, 0)

    def test_unusual_task_to_another_address_is_not_answered(self):
        virtual = drive_of()
        find, *_ = Framer(virtual.codec, "request").feed(telegram(4, *words(0x17D0, 0, 0, 0, 0)))
        assert virtual.hear(find, 0.0) is None

    def test_control_word_beside_a_refused_task_is_obeyed(self):
        virtual = drive_of()
        for word in (0x047E, 0x047F):
            data = telegram(ADDRESS, *words(0x17D0, 0, 0, word, 0x2000))
            find, *_ = Framer(virtual.codec, "request").feed(data)
            virtual.hear(find, 0.0)
        assert virtual.motor.running


class TestArrays:
    def test_all_elements_are_read_by_one_task(self):
        virtual = drive_of()
        virtual.poke("2014[0]", 7)
        virtual.poke("2014[1]", 8)
        assert answer_to(virtual, 0x600E, 0x80FF, 0) == (0x400E, 0x80FF, 7, 8)

    def test_all_elements_are_written_by_one_task(self):
        virtual = drive_of()
        assert answer_to(virtual, 0x700E, 0x80FF, 7, 8) == (0x400E, 0x80FF, 7, 8)
        assert (virtual.peek("2014[0]", 0.0), virtual.peek("2014[1]", 0.0)) == (7, 8)
        assert answer_to(virtual, 0x700E, 0x80FF, 9) == (0x700E, 0x80FF, 24)
        assert virtual.peek("2014[0]", 0.0) == 7

    def test_no_element_is_written_if_one_is_refused(self):
        virtual = drive_of()
        assert answer_to(virtual, 0x700A, 0x80FF, 7, 99) == (0x700A, 0x80FF, 2)
        assert virtual.peek("2010[0]", 0.0) == 6

    def test_reading_all_elements_in_a_fixed_area_is_refused(self):
        assert answer_to(drive_of(pkw_words=4), 0x600E, 0x80FF, 0, 0) == (0x700E, 0x80FF, 0, 102)

    def test_array_task_for_a_plain_parameter_is_refused(self):
        assert answer_to(drive_of(), 0x62BC, 0, 0) == (0x72BC, 0, 4)
        assert answer_to(drive_of(), 0x62BC, 0xFF, 0) == (0x72BC, 0xFF, 4)

    def test_g120_accepts_array_task_6_for_a_plain_parameter(self):
        """G110M Function Manual p. 198: tasks 1 and 6, 2 and 7, 3 and 8 are the same."""
        assert answer_to(drive_of("g120"), 0x6016, 0x8000, 0) == (0x4016, 0x8000, 2)

    def test_masterdrives_refuse_task_1_with_an_index(self):
        assert answer_to(drive_of("masterdrives"), 0x12AC, 1, 0) == (0x72AC, 1, 105)

    def test_task_9_reads_the_number_of_elements(self):
        assert answer_to(drive_of(), 0x900E, 0x8000, 0) == (0x600E, 0x8000, 2)


class TestDescriptions:
    def test_description_gives_the_number_of_elements(self):
        assert answer_to(drive_of(), 0x400E, 0x8002, 0) == (0x300E, 0x8002, 2)
        assert answer_to(drive_of(pkw_words=4), 0x400E, 0x8002, 0, 0) == (0x300E, 0x8002, 0, 2)

    def test_description_gives_the_limits(self):
        assert answer_to(drive_of(), 0x400A, 0x8007, 0) == (0x300A, 0x8007, 3)
        assert answer_to(drive_of(), 0x400A, 0x8008, 0) == (0x300A, 0x8008, 9)

    def test_unknown_description_element_is_refused(self):
        assert answer_to(drive_of(), 0x400A, 0x8006, 0) == (0x700A, 0x8006, 3)


class TestNord:
    def test_each_parameter_set_has_its_own_value(self):
        with drivecomm.open_bus(VirtualLine([drive_of("nord")]).port) as bus:
            drive = bus.drive("uss", ADDRESS, model="nord")
            for number in range(1, 5):
                drive.write("400", 10 * number, parameter_set=number)
            assert [drive.read("400", parameter_set=number).value for number in range(1, 5)] == [10, 20, 30, 40]

    def test_nord_drive_refuses_with_its_own_error_numbers(self):
        with drivecomm.open_bus(VirtualLine([drive_of("nord", pkw_words=3)]).port) as bus:
            drive = bus.drive("uss", ADDRESS, model="nord", pkw_words=3)
            with pytest.raises(RefusedError, match="illegal parameter number"):
                drive.read("999")


class TestOldReplies:
    """Drives that send the reply to the previous task until a new one is done (C-15)."""

    class Slow:
        """A drive that answers each new task with its previous reply first."""

        def __init__(self, virtual):
            self.virtual = virtual
            self.task, self.before = None, None

        def __getattr__(self, name):
            return getattr(self.virtual, name)

        def hear(self, find, now):
            message = find.message
            if message.address != ADDRESS:
                return None
            fresh, self.task = self.task != message, message
            if fresh and self.before is not None:
                return self.before
            self.before = self.virtual.hear(find, now)
            return self.before

    def test_old_refusal_is_not_taken_for_that_of_the_next_task(self):
        virtual = self.Slow(drive_of())
        with drivecomm.open_bus(VirtualLine([virtual]).port) as bus:
            drive = bus.drive("uss", ADDRESS, model="micromaster4")
            with pytest.raises(RefusedError):
                drive.write("21", 5, type="Float")
            assert drive.read("21").value == 0

    def test_old_value_does_not_confirm_a_write(self):
        virtual = self.Slow(drive_of())
        with drivecomm.open_bus(VirtualLine([virtual]).port) as bus:
            drive = bus.drive("uss", ADDRESS, model="micromaster4")
            assert drive.read("700").raw == 5
            virtual.poke("700", 2)
            assert drive.write("700", 5).raw == 5
            assert virtual.peek("700", 0.0) == 5


def test_echo_after_a_report_is_not_taken_for_a_reply():
    """Request and reply are equal: no process data, no value, and the toggle bit of an acknowledged report."""
    options = {"pkw_words": 3, "pzd_words": 0}
    virtual = drive_of(**options)
    virtual.poke("700", 0x1234)
    silent = []

    class Once:
        def __getattr__(self, name):
            return getattr(virtual, name)

        def hear(self, find, now):
            reply = virtual.hear(find, now)
            if reply is None or find.message.mirror or silent:
                return None
            if find.message.spm:
                silent.append(True)
                return None
            plain = {"address": ADDRESS, "ak": 9, "spm": True, "pnu": 304, "index": 0, "page": 0, "value": 1}
            return dataclasses.replace(reply, data=virtual.codec.encode(PLUGIN.message(plain, "reply")))

    with drivecomm.open_bus(VirtualLine([Once()], echo=True).port, echo="off") as bus:
        drive = bus.drive("uss", ADDRESS, attempts=1, **options)
        with pytest.raises(NoReplyError):
            drive.read("700")
        with pytest.raises(NoReplyError):
            drive.read("700")
