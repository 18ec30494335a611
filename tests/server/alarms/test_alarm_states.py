"""State changes of alarms, on a clock that the test sets."""

from dataclasses import replace

import pytest
from alarm_points import WALL_S, ClockedAlarms, current, limit, pump, rule

from drivecomm.errors import UsageError
from drivecomm.server.drift_state import DriveDrift, SetChange


def test_fault_is_raised_immediately_and_over_one_minute_after_its_end():
    clock = ClockedAlarms(rule())
    assert clock.at(0, pump()) == []
    assert clock.at(1, pump("F0400 overload")) == ["raised"]
    assert clock.at(2, pump("F0400 overload")) == []
    assert (clock.alarm.text, clock.alarm.present, clock.alarm.times) == ("fault F0400 overload", True, 1)
    assert (clock.alarm.since_s, clock.alarm.drive, clock.alarm.rule) == (WALL_S + 1001, "pump", "pump fault")
    assert clock.at(3, pump()) == []
    assert (clock.alarm.text, clock.alarm.present) == ("fault F0400 overload", False)
    assert (clock.alarm.gone, clock.alarm.gone_s) == ("no fault", WALL_S + 1003)
    assert clock.at(62.5) == []
    assert clock.at(63) == ["over"]
    assert clock.at(64) == []


def test_fault_without_a_text_raises_an_alarm():
    clock = ClockedAlarms(rule())
    assert clock.at(0, pump(tripped=True)) == ["raised"]
    assert clock.texts() == ["fault"]
    # The drive reports the fault number later; the fault is the same.
    clock.acknowledge()
    assert clock.at(100, pump("F0400")) == []
    assert clock.alarm.acknowledged_by == "ann"


def test_warning_and_silence_of_a_drive_raise_alarms():
    clock = ClockedAlarms(rule("warning"), rule("silent"))
    assert clock.at(0, pump(reachability="asking")) == []
    assert clock.at(0, pump(warning=None)) == []
    assert clock.at(1, pump(warning=True)) == ["raised"]
    assert clock.at(2, pump(reachability="silent", error="no reply within 0.1 s")) == ["raised"]
    assert clock.texts() == [
        "a warning is active; now unknown: the drive does not answer", "does not answer: no reply within 0.1 s"
    ]  # fmt: skip
    # A silent drive may still have its warning.
    assert clock.at(500) == []
    assert clock.at(501, pump()) == []
    assert clock.at(561) == ["over", "over"]


def drifted(*changes, **more):
    """Return a pump whose parameters differ from its baseline.

    changes: address, present value, and time of the first difference in seconds.
    """
    made = tuple(
        SetChange(address=address, name="", unit="s", approved=5, now=now, since_s=since_s)
        for address, now, since_s in changes
    )
    known = {"state": "changed" if changes else "as approved", "changes": made, **more}
    return replace(pump(reachability="silent"), drift=DriveDrift(**known))


def test_change_since_the_baseline_is_an_alarm_until_the_approved_value_returns():
    clock = ClockedAlarms(rule("changed_since_baseline"))
    assert clock.at(0, pump()) == []
    assert clock.at(1, drifted(("420", 7, 0.0))) == ["raised"]
    assert clock.texts() == ["1 parameter differs from the baseline since 1970-01-01 00:00 UTC: 420: 5 -> 7 s"]
    unknown = drifted(state="not compared", cause="pump.toml: half a file")
    assert clock.at(2, unknown) == []
    assert clock.texts()[0].endswith("; now unknown: not compared with the baseline: pump.toml: half a file")
    assert clock.at(100, drifted()) == []
    assert clock.alarm.gone == "set as approved"
    assert clock.at(160) == ["over"]


def test_later_change_since_the_baseline_is_reminded_after_acknowledgement():
    clock = ClockedAlarms(rule("changed_since_baseline"))
    clock.at(0, drifted(("420", 7, 100.0)))
    clock.acknowledge()
    assert clock.at(100, drifted(("420", 7, 100.0))) == []
    assert clock.alarm.acknowledged_by == "ann"
    assert clock.at(200, drifted(("420", 7, 100.0), ("421", 8, 200.0))) == ["reminded"]
    assert clock.alarm.acknowledged_by == ""


def test_replaced_drive_is_an_alarm_and_missing_baseline_is_not():
    clock = ClockedAlarms(rule("changed_since_baseline"))
    assert clock.at(0, drifted(state="no baseline")) == []
    assert clock.at(1, drifted(state="replaced", replaced="its serial number is another")) == ["raised"]
    assert clock.texts() == ["replaced by another drive: its serial number is another"]


def test_delay_counts_only_while_the_condition_is_known_to_hold():
    clock = ClockedAlarms(limit(for_s=10))
    assert clock.at(0, current("13")) == []
    assert clock.at(4, current(None, "bad", "no reply")) == []
    assert clock.at(100, current("13")) == []
    assert clock.at(105.9) == []
    assert clock.at(106) == ["raised"]


def test_delay_restarts_if_the_condition_ends_early():
    clock = ClockedAlarms(limit(for_s=10))
    clock.at(0, current("13"))
    assert clock.at(9, current("12")) == []
    assert clock.at(10, current("13")) == []
    assert clock.at(19.9) == []
    assert clock.at(20) == ["raised"]


def test_alarm_is_raised_if_the_delay_passes_before_the_condition_ends():
    clock = ClockedAlarms(limit(for_s=5))
    clock.at(0, current("13"))
    assert clock.at(5, current("12")) == ["raised"]
    assert not clock.alarm.present


@pytest.mark.parametrize(
    ("side", "beyond", "between", "back"),
    [("above", "12.6", "12.1", "12.0"), ("below", "12.4", "12.9", "13.0")],
)
def test_limit_alarm_clears_only_beyond_the_hysteresis(side, beyond, between, back):
    clock = ClockedAlarms(limit("12.5", "0.5", side))
    assert clock.at(0, current("12.5")) == []
    assert clock.at(1, current(between)) == []
    assert clock.at(2, current(beyond)) == ["raised"]
    assert clock.texts() == [f"output_current is {beyond} A, {side} 12.5 A"]
    assert clock.at(3, current(between)) == []
    assert clock.texts() == [f"output_current is {between} A, not yet back by 0.5 A from 12.5 A"]
    assert clock.at(100) == []
    assert clock.at(100, current(back)) == []
    # The alarm keeps the text of its cause, and adds the text of its end.
    assert clock.texts() == [f"output_current is {beyond} A, {side} 12.5 A"]
    assert clock.alarm.gone == f"output_current is {back} A, no longer {side} 12.5 A"
    assert clock.at(160) == ["over"]


@pytest.mark.parametrize(
    ("seen", "text"),
    [
        (current("99", "stale", "no reply within 0.1 s"), "output_current is stale: no reply within 0.1 s"),
        (current(None, "bad"), "output_current is bad"),
        (current("run"), "output_current is run, which is not a number"),
        (current(float("nan")), "output_current is nan, which is not a number"),
        (current("NaN"), "output_current is NaN, which is not a number"),
    ],
)
def test_unknown_value_neither_raises_nor_clears_an_alarm(seen, text):
    clock = ClockedAlarms(limit())
    assert clock.at(0, seen) == []
    assert clock.at(1) == []
    assert clock.at(2, current("13")) == ["raised"]
    assert clock.at(3, seen) == []
    assert clock.texts() == [f"output_current is 13 A, above 12.5 A; now unknown: {text}"]
    assert clock.at(1000, seen) == []
    assert clock.texts() == [f"output_current is 13 A, above 12.5 A; now unknown: {text}"]
    assert clock.at(1001, current("12")) == []
    assert clock.at(1030, seen) == []
    assert clock.at(2000, current("12")) == []
    assert clock.at(2030.5) == []
    assert clock.at(2031) == ["over"]


def test_reminders_are_sent_until_acknowledgement():
    clock = ClockedAlarms(rule(remind_s=600.0))
    assert clock.at(0, pump("F1")) == ["raised"]
    assert clock.at(599) == []
    assert clock.at(600) == ["reminded"]
    assert clock.at(1199) == []
    assert clock.at(1200) == ["reminded"]
    done = clock.acknowledge()
    assert (done.what, done.alarm.acknowledged_by, done.alarm.told) == ("acknowledged", "ann", 3)
    assert clock.acknowledge("bob") is None
    assert clock.alarm.acknowledged_by == "ann"
    assert clock.at(10_000) == []
    assert clock.at(10_001, pump()) == []
    assert clock.at(10_061) == ["over"]
    assert clock.alarms.standing() == []


def test_alarm_is_confirmed_once_after_it_was_acknowledged():
    clock = ClockedAlarms(rule())
    clock.at(0, pump("F1"))
    assert clock.treat("confirmed") is None
    assert clock.acknowledge().text == "pump fault: acknowledged by ann (fault F1)"
    done = clock.treat("confirmed", "bob", "belt replaced")
    assert done.text == "pump fault: confirmed by bob (fault F1): belt replaced"
    assert clock.treat("confirmed") is None
    assert (clock.alarm.confirmed_by, clock.alarm.comment, clock.alarm.comment_by) == ("bob", "belt replaced", "bob")
    # A different fault needs a new acknowledgement.
    clock.at(1, pump("F2"))
    assert (clock.alarm.acknowledged_by, clock.alarm.confirmed_by) == ("", "")


def test_comment_does_not_acknowledge_an_alarm():
    clock = ClockedAlarms(rule(remind_s=600.0))
    clock.at(0, pump("F1"))
    assert clock.treat("commented", comment="eva looks").text == "pump fault: comment of ann (fault F1): eva looks"
    assert clock.alarm.acknowledged_by == ""
    assert clock.at(600) == ["reminded"]
    clock.at(601, pump())
    assert clock.at(661) == ["over"]
    assert clock.treat("commented", comment="was the fuse").alarm.comment == "was the fuse"
    assert clock.acknowledge().alarm.comment == "was the fuse"
    assert clock.alarms.standing() == []


def test_alarm_shows_whether_its_condition_is_known():
    clock = ClockedAlarms(limit("12.5"))
    clock.at(0, current("13"))
    assert clock.alarm.known
    clock.at(1, current(None, "bad"))
    assert not clock.alarm.known


def test_no_reminder_is_sent_while_the_condition_is_absent():
    clock = ClockedAlarms(rule(remind_s=60.0, over_s=600.0))
    assert clock.at(0, pump("F1")) == ["raised"]
    assert clock.at(10, pump()) == []
    assert clock.at(300) == []
    assert clock.at(301, pump("F1")) == ["reminded"]


def test_alarm_that_is_over_remains_listed_until_acknowledged():
    clock = ClockedAlarms(rule())
    clock.at(0, pump("F1"))
    clock.at(1, pump())
    assert clock.at(61) == ["over"]
    assert (clock.alarm.over_s, clock.alarm.acknowledged_by) == (WALL_S + 1061, "")
    first = clock.alarm.id
    assert clock.at(100, pump("F1")) == ["raised"]
    assert (clock.alarm.times, clock.alarm.number) == (2, 2)
    assert clock.alarm.id != first
    clock.at(101, pump())
    assert clock.at(161) == ["over"]
    assert clock.acknowledge().what == "acknowledged"
    assert clock.alarms.standing() == []
    with pytest.raises(UsageError, match=f"no alarm {first!r} stands"):
        clock.treat("acknowledged", alarm=first)
    assert clock.at(200, pump("F1")) == ["raised"]
    assert clock.alarm.times == 1


def test_flapping_condition_is_one_alarm():
    clock = ClockedAlarms(rule())
    told = []
    for second in range(600):
        told += clock.at(second, pump("F1" if second % 2 else ""))
    assert told == ["raised"]
    assert clock.alarm.times == 300
    clock.at(600, pump())
    assert clock.at(660) == ["over"]


def test_returning_condition_is_reported_again_at_most_once_a_minute():
    clock = ClockedAlarms(rule())
    clock.at(0, pump("F1"))
    clock.acknowledge()
    clock.at(5, pump())
    # The reset did not help, and the person who acknowledged the fault has to learn of it.
    assert clock.at(10, pump("F1")) == []
    assert clock.alarm.acknowledged_by == ""
    assert clock.at(59) == []
    assert clock.at(60) == ["reminded"]
    told_s = []
    for second in range(61, 661):
        told_s += [second for _ in clock.at(second, pump("F1" if second % 2 else ""))]
        clock.acknowledge()
    assert told_s == [121, 181, 241, 301, 361, 421, 481, 541, 601]


def test_second_fault_of_a_drive_sends_a_reminder():
    clock = ClockedAlarms(rule())
    assert clock.at(0, pump("F1")) == ["raised"]
    clock.acknowledge()
    assert clock.at(100, pump("F2")) == ["reminded"]
    assert clock.texts() == ["fault F2"]
    assert clock.at(101, pump("F3")) == []
    assert clock.at(160) == ["reminded"]


def test_setting_the_clock_does_not_affect_delays():
    clock = ClockedAlarms(limit(for_s=10, remind_s=600.0))
    clock.at(0, current("13"))
    clock.off_s = -3600
    assert clock.at(9) == []
    assert clock.at(10) == ["raised"]
    clock.off_s = 0
    assert clock.at(11, current("13")) == []
    clock.off_s = -3600
    assert clock.at(609) == []
    assert clock.at(610) == ["reminded"]
    assert clock.at(611, current("12")) == []
    clock.off_s = 7200
    assert clock.at(670) == []
    assert clock.at(671) == ["over"]


class TestRestart:
    def restarted(self, clock, *rules, off_s=0.0, after_s=30.0):
        again = ClockedAlarms(*(rules or clock.rules), run="later")
        again.now_s = 1000.0
        again.off_s = clock.time_s + after_s + off_s - WALL_S - 1000.0
        again.alarms = type(again.alarms)(
            again.rules, run="later", stood=clock.alarms.standing(), number=clock.alarms.number,
            now_s=again.now_s, time_s=again.time_s,
        )  # fmt: skip
        return again

    def test_acknowledged_alarm_is_not_reported_again_after_restart(self):
        clock = ClockedAlarms(rule(remind_s=60.0))
        clock.at(0, pump("F1"))
        clock.acknowledge()
        again = self.restarted(clock)
        assert again.at(0, pump(reachability="asking")) == []
        assert again.at(1, pump("F1")) == []
        assert again.at(1000) == []
        assert again.alarm.id == "run-1"
        assert again.alarm.acknowledged_by == "ann"

    def test_alarm_that_ended_during_a_restart_is_reported_as_over(self):
        clock = ClockedAlarms(rule())
        clock.at(0, pump("F1"))
        again = self.restarted(clock)
        assert again.at(0, pump()) == []
        assert again.at(59) == []
        assert again.at(60) == ["over"]
        assert again.alarm.id == "run-1"

    def test_different_fault_after_restart_sends_a_reminder(self):
        clock = ClockedAlarms(rule())
        clock.at(0, pump("F1"))
        clock.acknowledge()
        again = self.restarted(clock, after_s=100)
        assert again.at(0, pump("F2")) == ["reminded"]

    def test_alarm_within_the_hysteresis_continues_after_restart(self):
        clock = ClockedAlarms(limit("12.5", "0.5", for_s=30))
        clock.at(0, current("13"))
        clock.at(30)
        again = self.restarted(clock)
        assert again.at(0, current("12.1")) == []
        assert again.at(1000) == []

    @pytest.mark.parametrize(("off_s", "due_s"), [(0, 470), (-3600, 600), (3600, 0)])
    def test_reminder_survives_a_restart_with_a_changed_clock(self, off_s, due_s):
        clock = ClockedAlarms(rule(remind_s=600.0))
        clock.at(0, pump("F1"))
        clock.at(100)
        again = self.restarted(clock, off_s=off_s)
        if due_s:
            assert again.at(0, pump("F1")) == []
            assert again.at(due_s - 1) == []
        assert again.at(due_s) == ["reminded"]
        assert again.at(due_s + 599) == []

    def test_alarm_is_over_if_its_rule_was_removed(self):
        clock = ClockedAlarms(rule(), rule("warning"))
        clock.at(0, pump("F1", warning=True))
        clock.treat("acknowledged", alarm="run-2")
        again = self.restarted(clock, rule("silent"))
        assert again.at(0) == ["over", "over"]
        assert again.at(1) == []
        assert again.texts() == ["fault F1"]
        assert [each.gone for each in again.alarms.standing()] == ["the plant file no longer has this alarm"]
        assert again.acknowledge().what == "acknowledged"
        assert again.alarms.standing() == []

    def test_alarm_ids_are_not_reused_after_restart(self):
        clock = ClockedAlarms(rule())
        clock.at(0, pump("F1"))
        clock.at(1, pump())
        clock.at(61)
        again = self.restarted(clock)
        assert again.at(0, pump("F1")) == ["raised"]
        assert (again.alarm.id, again.alarm.times) == ("later-2", 2)


def test_float_values_are_compared_by_their_decimal_text():
    clock = ClockedAlarms(limit("0.3"))
    assert clock.at(0, current(0.1 + 0.2)) == ["raised"]
    clock = ClockedAlarms(limit("12.6"))
    assert clock.at(0, current(12.6)) == []
    clock = ClockedAlarms(limit("0.1"))
    assert clock.at(0, current(0.1)) == []
