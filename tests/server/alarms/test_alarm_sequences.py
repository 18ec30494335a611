"""Random sequences of values and times, compared with a simple model of alarms."""

from decimal import Decimal
from itertools import pairwise

import pytest
from alarm_points import ClockedAlarms, current, limit
from hypothesis import given, strategies as st

STEPS = st.lists(
    st.tuples(
        st.sampled_from([0.0, 0.25, 1.0, 4.0, 5.0, 30.0, 59.75, 60.0, 300.0]),
        st.sampled_from(["11", "12", "12.25", "12.5", "13", None, "look", "acknowledge", "clock"]),
    ),
    max_size=60,
)
STEP_S = 0.25


class Account:
    """Simple model of one limit alarm, computed in steps of a quarter of a second."""

    def __init__(self, for_s, over_s):
        self.for_s, self.over_s = for_s, over_s
        self.holds = None
        self.known = False
        self.lasts_s = 0.0
        self.active = False
        self.happened = []

    def see(self, value):
        self.known = value is not None
        if value is None:
            return
        holds = Decimal(value) > (12 if self.holds else Decimal("12.5"))
        if holds != self.holds:
            self.holds, self.lasts_s = holds, 0.0

    def settle(self, second):
        if self.holds and not self.active and self.lasts_s >= self.for_s:
            self.active = True
            self.happened.append(("raised", second))
        elif self.holds is False and self.active and self.lasts_s >= self.over_s:
            self.active = False
            self.happened.append(("over", second))

    def pass_by(self):
        if self.known:
            self.lasts_s += STEP_S


@pytest.mark.soak
@given(
    steps=STEPS,
    for_s=st.sampled_from([0.0, 0.25, 5.0]),
    over_s=st.sampled_from([1.0, 5.0, 60.0]),
    remind_s=st.sampled_from([None, 60.0]),
)
def test_delays_and_hysteresis_are_exact_and_no_alarm_is_repeated(steps, for_s, over_s, remind_s):
    clock = ClockedAlarms(limit("12.5", "0.5", for_s=for_s, over_s=over_s, remind_s=remind_s))
    account = Account(for_s, over_s)
    found, acknowledged = [], True

    def take(what, second):
        nonlocal acknowledged
        for each in what:
            if each == "reminded":
                # A condition that returns after its acknowledgement is reported as a new, unacknowledged one.
                assert not acknowledged or any(not each.acknowledged_by for each in clock.alarms.standing())
                assert second - max(when for told, when in found if told != "over") >= 60
            acknowledged = acknowledged and each != "raised"
            found.append((each, second))

    second = 0.0
    for after_s, what in steps:
        for _ in range(int(after_s / STEP_S)):
            second += STEP_S
            account.pass_by()
            account.settle(second)
            take(clock.at(second), second)
        if what == "acknowledge":
            for alarm in clock.alarms.standing():
                clock.treat("acknowledged", alarm=alarm.id)
        elif what == "clock":
            clock.off_s = -3600 - clock.off_s
        elif what != "look":
            account.see(what)
            account.settle(second)
            take(clock.at(second, current(what, "good" if what else "stale")), second)
        acknowledged = not any(not a.acknowledged_by for a in clock.alarms.standing())

    assert [each for each in found if each[0] != "reminded"] == account.happened
    kinds = [each for each, _ in found if each != "reminded"]
    assert kinds == ["raised", "over"] * (len(kinds) // 2) + ["raised"] * (len(kinds) % 2)
    raised = [second for what, second in found if what == "raised"]
    assert all(after - before >= over_s for before, after in pairwise(raised))
