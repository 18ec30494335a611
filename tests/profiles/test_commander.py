"""Commands by a profile: which words are urgent, which errors are raised, and when a drive does not obey."""

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


def test_start_sends_its_words_without_urgency():
    drive = Drive(DRIVECOM)
    drive.carry_out(commander(drive).start())
    assert drive.sent == [(0x0006, False), (0x0007, False), (0x000F, False)]


def test_start_of_a_switched_on_drive_sends_only_the_remaining_words():
    drive = Drive(DRIVECOM)
    drive.machine.control(0x0006, 0)
    drive.machine.control(0x0007, 0)
    drive.carry_out(commander(drive).start())
    assert drive.sent == [(0x000F, False)]


def test_preparation_runs_before_the_first_word_and_not_in_a_fault():
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


def test_start_of_a_tripped_drive_is_refused_with_its_fault_code():
    def code():
        return 12
        yield

    drive = Drive(DRIVECOM)
    drive.machine.trip(12, 0)
    with pytest.raises(StateError, match=r"has a fault \(code 12\) and cannot start"):
        drive.carry_out(commander(drive, fault_code=code).start())


def test_stop_without_a_matching_status_word_raises_an_error():
    stands = Step(word=0x0007, repeats=True, until=(Condition(mask=0x6F, values=(0x23,)),))
    known = replace(DRIVECOM, stops={Stop.RAMP: (stands,)})
    drive = Drive(known)
    drive.carry_out(commander(drive).start())
    drive.deaf = True
    with pytest.raises(StateError, match="got the stop and does not report it: after 0x0007 its status word 0x0237"):
        drive.carry_out(commander(drive).stop(Stop.RAMP))


TWO_STEPS = replace(DRIVECOM, stops={Stop.RAMP: (Step(word=0x1000, repeats=True), *DRIVECOM.stops[Stop.RAMP])})


class Refusing(Drive):
    """A drive that refuses certain control words."""

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


def test_reverse_start_uses_its_own_steps():
    known = replace(DRIVECOM, start_reverse=(*DRIVECOM.start[:2], replace(DRIVECOM.start[2], word=0x080F)))
    drive = Drive(known)
    drive.carry_out(commander(drive).start(reverse=True))
    assert [word for word, _ in drive.sent] == [0x0006, 0x0007, 0x080F]


def test_reset_without_answers_waits_for_no_status():
    drive = Drive(DRIVECOM, deaf=True)
    drive.carry_out(commander(drive, answers=False).reset())
    assert [word for word, _ in drive.sent] == [0x0000, 0x0080, 0x0000]


def test_pause_of_a_step_precedes_the_step():
    known = replace(DRIVECOM, start=(DRIVECOM.start[0], replace(DRIVECOM.start[1], pause_s=0.1), DRIVECOM.start[2]))
    drive = Drive(known)
    drive.carry_out(commander(drive).start())
    assert drive.now == pytest.approx(0.1)


def test_condition_on_an_unread_word_does_not_hold():
    assert not Condition(mask=0, values=(0,), place="elsewhere").holds({"": 0})
    assert control_profile("profidrive").says("remote", {"elsewhere": 0xFFFF}) is False
    assert control_profile("profidrive").says("reverse", {"": 0xFFFF}) is None


def test_control_word_commands_only_with_all_valid_bits():
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
def test_status_of_a_fault_has_its_code_and_text(code, text):
    drive, times = Drive(DRIVECOM), []
    drive.machine.trip(12, 0)
    status = drive.carry_out(
        commander(drive, fault_code=asked_for(code, times)).status(SimpleNamespace(faults={12: "too hot"}))
    )
    assert (status.fault, status.fault_code, status.fault_text) == (True, code, text)
    assert times == [code]


def test_status_without_a_fault_does_not_read_the_fault_code():
    drive, times = Drive(DRIVECOM), []
    status = drive.carry_out(commander(drive, fault_code=asked_for(12, times)).status(None))
    assert (status.fault, status.fault_code, times) == (False, None, [])


def test_refused_start_does_not_read_the_code_if_the_message_omits_it():
    drive, times = Drive(control_profile("profidrive")), []
    drive.machine.trip(12, 0)
    with pytest.raises(StateError, match="the drive has a fault and cannot start"):
        drive.carry_out(commander(drive, fault_code=asked_for(12, times)).start())
    assert times == []
