"""Commanding by a profile: what is urgent, what is said, and what a drive that does not obey comes to."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from played import Drive

from drivecomm.errors import OvertakenError, RefusedError, StateError
from drivecomm.profiles import Commander, Condition, Step, control_profile
from drivecomm.protocol import Stop

DRIVECOM = control_profile("drivecom")


def commander(drive, **further):
    return Commander(drive.profile, drive, state_timeout_s=1.0, **further)


def test_a_start_overtakes_nothing():
    drive = Drive(DRIVECOM)
    drive.carry_out(commander(drive).start())
    assert drive.sent == [(0x0006, False), (0x0007, False), (0x000F, False)]


def test_a_drive_that_is_on_its_way_is_sent_the_rest_of_it():
    drive = Drive(DRIVECOM)
    drive.machine.control(0x0006, 0)
    drive.machine.control(0x0007, 0)
    drive.carry_out(commander(drive).start())
    assert drive.sent == [(0x000F, False)]


def test_what_is_prepared_comes_before_the_first_word_and_not_where_nothing_is_started():
    drive, order = Drive(DRIVECOM), []

    def prepared():
        order.append(list(drive.sent))
        yield from ()

    drive.carry_out(commander(drive).start(prepare=prepared()))
    assert order == [[]]
    drive.machine.trip(3, drive.now)
    with pytest.raises(StateError):
        drive.carry_out(commander(drive).start(prepare=prepared()))
    assert order == [[]]


def test_a_fault_that_keeps_a_motor_from_starting_is_named():
    def code():
        return 12
        yield

    drive = Drive(DRIVECOM)
    drive.machine.trip(12, 0)
    with pytest.raises(StateError, match=r"has a fault \(code 12\) and cannot start"):
        drive.carry_out(commander(drive, fault_code=code).start())


def test_a_stop_that_the_drive_does_not_report_is_not_confirmed():
    stands = Step(word=0x0007, repeats=True, until=(Condition(mask=0x6F, values=(0x23,)),))
    known = replace(DRIVECOM, stops={Stop.RAMP: (stands,)})
    drive = Drive(known)
    drive.carry_out(commander(drive).start())
    drive.deaf = True
    with pytest.raises(StateError, match="got the stop and does not report it: after 0x0007 its status word 0x0237"):
        drive.carry_out(commander(drive).stop(Stop.RAMP))


TWO_STEPS = replace(DRIVECOM, stops={Stop.RAMP: (Step(word=0x1000, repeats=True), *DRIVECOM.stops[Stop.RAMP])})


class Refusing(Drive):
    """A drive that refuses some words."""

    refused = (0x1000,)

    def send(self, step, *, urgent):
        yield from super().send(step, urgent=urgent)
        if step.word in self.refused:
            raise RefusedError("40001", 1, "locked")


def test_stop_sends_its_last_word_after_a_step_without_a_reply():
    drive = Drive(TWO_STEPS)
    drive.lost = 1
    drive.carry_out(commander(drive).stop(Stop.RAMP))
    assert drive.sent == [(0x1000, True), (0x0007, True)]


def test_stop_sends_its_last_word_after_a_refused_step():
    drive = Refusing(TWO_STEPS)
    drive.carry_out(commander(drive).stop(Stop.RAMP))
    assert [word for word, _ in drive.sent] == [0x1000, 0x0007]


def test_stop_is_not_confirmed_if_its_last_word_is_refused():
    drive = Refusing(TWO_STEPS)
    drive.refused = (0x0007,)
    with pytest.raises(RefusedError, match="locked"):
        drive.carry_out(commander(drive).stop(Stop.RAMP))


def test_stop_that_another_overtakes_sends_no_further_step():
    drive = Drive(TWO_STEPS)

    def overtaken(step, *, urgent):
        drive.sent.append((step.word, urgent))
        raise OvertakenError("a stop went first")
        yield

    drive.send = overtaken
    with pytest.raises(OvertakenError):
        drive.carry_out(commander(drive).stop(Stop.RAMP))
    assert drive.sent == [(0x1000, True)]


def test_a_way_of_its_own_leads_backwards():
    known = replace(DRIVECOM, start_reverse=(*DRIVECOM.start[:2], replace(DRIVECOM.start[2], word=0x080F)))
    drive = Drive(known)
    drive.carry_out(commander(drive).start(reverse=True))
    assert [word for word, _ in drive.sent] == [0x0006, 0x0007, 0x080F]


def test_what_nobody_answers_is_not_awaited():
    drive = Drive(DRIVECOM, deaf=True)
    drive.carry_out(commander(drive, answers=False).reset())
    assert [word for word, _ in drive.sent] == [0x0000, 0x0080, 0x0000]


def test_a_pause_passes_before_its_step():
    known = replace(DRIVECOM, start=(DRIVECOM.start[0], replace(DRIVECOM.start[1], pause_s=0.1), DRIVECOM.start[2]))
    drive = Drive(known)
    drive.carry_out(commander(drive).start())
    assert drive.now == pytest.approx(0.1)


def test_a_word_that_was_not_read_says_nothing():
    assert not Condition(mask=0, values=(0,), place="elsewhere").holds({"": 0})
    assert control_profile("profidrive").says("remote", {"elsewhere": 0xFFFF}) is False
    assert control_profile("profidrive").says("reverse", {"": 0xFFFF}) is None


def test_all_valid_bits_are_needed():
    known = replace(DRIVECOM, valid=0x0C00)
    assert known.commands(0x0C0F)
    assert not known.commands(0x040F)


def asked_for(code, times):
    def ask():
        times.append(code)
        return code
        yield

    return ask


@pytest.mark.parametrize(("code", "text"), [(12, "too hot"), (13, ""), (None, "")])
def test_a_status_of_a_fault_has_its_code_and_text(code, text):
    drive, times = Drive(DRIVECOM), []
    drive.machine.trip(12, 0)
    status = drive.carry_out(
        commander(drive, fault_code=asked_for(code, times)).status(SimpleNamespace(faults={12: "too hot"}))
    )
    assert (status.fault, status.fault_code, status.fault_text) == (True, code, text)
    assert times == [code]


def test_a_status_without_a_fault_asks_for_no_code():
    drive, times = Drive(DRIVECOM), []
    status = drive.carry_out(commander(drive, fault_code=asked_for(12, times)).status(None))
    assert (status.fault, status.fault_code, times) == (False, None, [])


def test_the_code_of_a_fault_is_asked_for_only_where_it_is_said():
    drive, times = Drive(control_profile("profidrive")), []
    drive.machine.trip(12, 0)
    with pytest.raises(StateError, match="the drive has a fault and cannot start"):
        drive.carry_out(commander(drive, fault_code=asked_for(12, times)).start())
    assert times == []
