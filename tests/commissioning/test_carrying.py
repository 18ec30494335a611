"""Restores across makers carry the effect of settings, not their numbers, and list values that cannot be carried."""

from dataclasses import replace
from decimal import Decimal
from itertools import permutations

import pytest
from hypothesis import HealthCheck, given, settings, strategies as st
from set_drives import Case, cases

import drivecomm
from drivecomm.bus import read_watchdog
from drivecomm.commissioning.parameter_sets import (
    ParameterEntry,
    ParameterSet,
    RestoreOptions,
    back_up,
    carry_out_plan,
    compare,
    plan_restore,
)
from drivecomm.errors import UsageError
from drivecomm.protocol import ParameterInfo
from drivecomm.virtual import VirtualLine, virtual_drive

ANOTHER = RestoreOptions(another_drive=True)
TIMEOUT = RestoreOptions(another_drive=True, only=frozenset({"link_timeout"}))


class Site:
    """Line with one virtual drive, and its master."""

    def __init__(self, case, values=None):
        self.virtual = case.new()
        for address, raw in (values or {}).items():
            self.virtual.poke(address, raw)
        self.bus = drivecomm.open_bus(VirtualLine([self.virtual]).port)
        self.drive = case.drive(self.bus)


FAN, SAW, PUMP = Case("danfoss-fc", "fc300"), Case("fuji", "frenic"), Case("vabus", "agile")
WATCHED = [case for case in cases() if case.model.watchdog and "link_timeout" in case.model.quantities]
PAIRS = [
    (source, target)
    for source, target in permutations(WATCHED, 2)
    if source.plugin is not target.plugin and target.tells_its_state
]


def restored(source, target, options=TIMEOUT):
    return carry_out_plan(target.drive, plan_restore(target.drive, back_up(source.drive), options))


def reasons(done):
    return {item.address: item.reason for item in done.plan.to("skip")}


def test_watchdog_time_with_its_function_off_switches_nothing_on():
    fan = Site(FAN, {"8-03": 10, "8-04": 0})
    saw = Site(SAW, {"y08": 0, "y02": 0})
    done = restored(fan, saw)
    assert (done.written, read_watchdog(saw.drive).policy) == ((), "hold")
    assert done.complete


def test_watchdog_that_is_off_is_switched_off_on_the_other_drive():
    done = restored(Site(FAN, {"8-03": 10, "8-04": 0}), saw := Site(SAW, {"y08": 5, "y02": 0}))
    assert (done.written, str(read_watchdog(saw.drive))) == (("y08",), "off")
    done = restored(Site(SAW, {"y08": 0, "y02": 0}), fan := Site(FAN, {"8-03": 10, "8-04": 5}))
    assert (done.written, str(read_watchdog(fan.drive))) == (("8-04",), "off")


def test_watchdog_that_is_on_keeps_its_action_and_time():
    done = restored(Site(SAW, {"y08": 3, "y02": 0}), fan := Site(FAN, {"8-03": 10, "8-04": 0}))
    assert (done.written, str(read_watchdog(fan.drive))) == (("8-03", "8-04"), "trip after 3.0 s")
    done = restored(fan, pump := Site(PUMP, {"413": 0}))
    assert (done.written, str(read_watchdog(pump.drive))) == (("413",), "trip after 3 s")


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"8-03": 40, "8-04": 2}, "cannot ramp; it can hold or trip"),
        ({"8-03": 40, "8-04": 1}, "does 'freeze output', which no other maker's is known to do"),
        ({"8-03": 45, "8-04": 5}, "does not support a timeout of 4.5 s: parameter y08 counts in steps of 1 s"),
    ],
)
def test_watchdog_that_the_other_drive_cannot_match_is_listed_and_not_written(values, reason):
    done = restored(Site(FAN, values), Site(SAW, {"y08": 0, "y02": 0}))
    assert reason in reasons(done)["link_timeout"]
    assert done.written == ()
    assert not done.complete, "it was asked for by its name"


def test_set_without_the_watchdog_function_leaves_the_watchdog_alone():
    saved = back_up(Site(FAN, {"8-03": 10, "8-04": 0}).drive)
    saved = replace(saved, entries={address: each for address, each in saved.entries.items() if address != "8-04"})
    saw = Site(SAW, {"y08": 0, "y02": 0})
    done = carry_out_plan(saw.drive, plan_restore(saw.drive, saved, ANOTHER))
    assert "does not hold 8-04" in reasons(done)["link_timeout"]
    assert read_watchdog(saw.drive).policy == "hold"


def test_watchdog_time_that_is_not_a_number_is_listed_as_missed():
    saved = back_up(Site(FAN, {"8-03": 10, "8-04": 5}).drive)
    spoilt = replace(saved.entries["8-03"], value="soon")
    saw = Site(SAW, {"y08": 0, "y02": 0})
    plan = plan_restore(saw.drive, replace(saved, entries={**saved.entries, "8-03": spoilt}), TIMEOUT)
    assert "'soon', which is not a number" in plan.missed[0].reason


def test_set_of_a_model_without_a_watchdog_switches_no_watchdog_on():
    entry = ParameterEntry(address="206", value=5, unit="s", name="ramp_up_time", common="link_timeout")
    saved = ParameterSet(protocol="danfoss-fc", drive="danfoss-fc:3", model="vlt6000", entries={"206": entry})
    saw = Site(SAW, {"y08": 0, "y02": 0})
    plan = plan_restore(saw.drive, saved, TIMEOUT)
    assert "the model vlt6000 of danfoss-fc:3 has no watchdog" in plan.missed[0].reason


def test_set_of_an_unknown_model_is_refused_and_compared_with_a_remark():
    saved = replace(back_up(Site(FAN).drive), model="dryer")
    saw = Site(SAW)
    with pytest.raises(UsageError, match="need its model dryer, and danfoss-fc has no model of that name"):
        plan_restore(saw.drive, saved, ANOTHER)
    found = compare(saved, back_up(saw.drive))
    assert any("whether every value of danfoss-fc:1 counts is not known" in remark for remark in found.remarks)


def test_value_that_the_other_drive_cannot_hold_is_listed_and_the_rest_carried():
    fan, pump = Site(FAN, {"4-14": 10_000, "4-12": 50}), Site(PUMP)
    done = restored(fan, pump, ANOTHER)
    assert "1000.0 for parameter 419 is outside" in reasons(done)["maximum_frequency"]
    assert "minimum_frequency" in done.written
    assert done.complete, "of another maker, not everything can be carried"


def test_compare_treats_a_watchdog_without_function_as_off():
    off = back_up(Site(FAN, {"8-03": 10, "8-04": 0}).drive)
    on = back_up(Site(SAW, {"y08": 1, "y02": 0}).drive)
    (difference,) = [each for each in compare(off, on).differences if each.address == "link_timeout"]
    assert (difference.left.value, difference.right.value) == (0, 1)
    never = back_up(Site(SAW, {"y08": 0, "y02": 0}).drive)
    assert "link_timeout" not in [each.address for each in compare(off, never).differences]


@pytest.mark.soak
@given(pair=st.sampled_from(PAIRS), data=st.data())
@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
def test_restore_across_makers_never_switches_a_watchdog_on(pair, data):
    """For any settings of both watchdogs, the drive ends up with those of the set or keeps its own."""
    source, target = (Site(case, data.draw(watchdog_values(case))) for case in pair)
    wanted, before = read_watchdog(source.drive), read_watchdog(target.drive)
    done = restored(source, target)
    after = read_watchdog(target.drive)
    assert (after.policy, after.time_s) in {(wanted.policy, wanted.time_s), (before.policy, before.time_s)}
    if wanted.policy == "hold":
        assert after.policy == "hold" or not done.complete
        assert after.policy == "hold" or after == before
    if done.complete:
        assert (after.policy, after.time_s) == (wanted.policy, wanted.time_s)


def watchdog_values(case):
    """Return a strategy for raw values of the watchdog parameters of a drive."""
    watchdog = case.model.watchdog
    values = {watchdog.time: st.sampled_from([*([] if watchdog.off is None else [watchdog.off]), 10, 20, 35])}
    if watchdog.action:
        values[watchdog.action] = st.sampled_from(sorted(case.model.parameters[watchdog.action].values))
    return st.fixed_dictionaries(values)


# Parameters that count only with some values of another parameter, in models of a user


def with_parameters(model, **parameters):
    """Return the model with parameters added or with keys of its parameters changed."""
    changed = {
        address: replace(model.parameters.get(address) or ParameterInfo(address=address, name="own", title=""), **keys)
        for address, keys in parameters.items()
    }
    return replace(model, parameters={**model.parameters, **changed})


def test_value_without_effect_is_not_carried():
    limited = with_parameters(FAN.model, **{"4-14": {"only_with": {"3-00": (1,)}}})
    entries = {
        "4-14": ParameterEntry(address="4-14", value=Decimal(60), unit="Hz", name="high", common="maximum_frequency"),
        "3-00": ParameterEntry(address="3-00", value=0, name="reference_range"),
    }
    saved = ParameterSet(protocol="danfoss-fc", drive="danfoss-fc:3", model="fc300", entries=entries)
    saw = Site(SAW)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("drivecomm.commissioning.parameter_sets.planning.model_of", lambda _: limited)
        plan = plan_restore(saw.drive, saved, ANOTHER)
        assert plan.to("write") == []
        reason = {item.address: item.reason for item in plan.to("skip")}["maximum_frequency"]
        assert reason == "it is without effect, because 3-00 reference_range is 0"
        counting = replace(saved, entries={**entries, "3-00": replace(entries["3-00"], value=1)})
        assert [item.address for item in plan_restore(saw.drive, counting, ANOTHER).to("write")] == [
            "maximum_frequency"
        ]
        unknown = replace(saved, entries={"4-14": entries["4-14"]})
        (left,) = plan_restore(saw.drive, unknown, ANOTHER).to("skip")
        assert left.reason == "it counts only with some values of 3-00, which the set does not hold"


def test_value_without_effect_on_the_target_drive_is_not_written():
    saved = back_up(Site(SAW).drive)
    virtual = virtual_drive("danfoss-fc", 3, model="fc300")
    limited = with_parameters(FAN.model, **{"4-14": {"only_with": {"3-00": (1,)}}})
    with drivecomm.open_bus(VirtualLine([virtual]).port) as bus:
        fan = bus.drive("danfoss-fc", 3, model=limited)
        virtual.poke("3-00", 0)
        plan = plan_restore(fan, saved, ANOTHER)
        told = {item.address: item.reason for item in plan.to("skip")}["maximum_frequency"]
        assert told.startswith("it would be without effect on this drive, because 3-00 reference_range is 0")
        virtual.poke("3-00", 1)
        assert "maximum_frequency" in [item.address for item in plan_restore(fan, saved, ANOTHER).to("write")]


def test_value_is_not_written_if_its_condition_cannot_be_read():
    limited = with_parameters(
        FAN.model, **{"4-14": {"only_with": {"0-02": (1,)}}, "0-02": {"type": "uint8", "name": "unit_of_speed"}}
    )
    with drivecomm.open_bus(VirtualLine([virtual_drive("danfoss-fc", 3, model="fc300")]).port) as bus:
        plan = plan_restore(bus.drive("danfoss-fc", 3, model=limited), back_up(Site(SAW).drive), ANOTHER)
    told = {item.address: item.reason for item in plan.to("skip")}["maximum_frequency"]
    assert told.startswith("whether it counts is not known: the drive refused parameter 0-02")
