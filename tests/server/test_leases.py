"""Leases: one commander per drive, with any sequence of acquiring, renewing, releasing and forgetting."""

import math

import pytest
from hypothesis import given, strategies as st

from drivecomm.errors import LeaseError, UsageError
from drivecomm.server.callers import Caller, Role
from drivecomm.server.leases import Leases

ANNA = Caller(name="anna", role=Role.OPERATE, door="http 127.0.0.1:8080")
BEN = Caller(name="ben", role=Role.COMMISSION, door="http 127.0.0.1:8080")
WALL_S = 1_790_000_000.0


def take(leases, caller, seconds=10.0, *, now=0.0, drive="pump", key=""):
    return leases.take(caller, drive, seconds, now=now, time_s=WALL_S + now, key=key)


def test_lease_is_acquired_renewed_and_released():
    leases = Leases()
    lease = take(leases, ANNA)
    assert (lease.drive, lease.holder, lease.until_s) == ("pump", ANNA, WALL_S + 10)
    assert leases.holder_of("pump", now=9.9) == lease
    renewed = leases.renew(ANNA, "pump", lease.key, 10, now=9, time_s=WALL_S + 9)
    assert (renewed.key, renewed.until_s) == (lease.key, WALL_S + 19)
    assert leases.end(ANNA, "pump", lease.key, now=15) == renewed
    assert (leases.holder_of("pump", now=15), list(leases.all(now=15))) == (None, [])
    assert not leases.expire(100), "the lease was released and did not expire"
    assert take(leases, BEN, now=15).holder == BEN


def test_refusal_names_the_holder_of_the_lease():
    leases = Leases()
    take(leases, ANNA)
    with pytest.raises(LeaseError, match=r"^pump is commanded by anna \(http 127.0.0.1:8080\) for another 8 s$"):
        take(leases, BEN, now=2)
    with pytest.raises(LeaseError, match="for another 8 s, by another program or page of the same user"):
        take(leases, ANNA, now=2)


def test_key_is_valid_only_for_its_holder_and_door():
    leases = Leases()
    key = take(leases, ANNA).key
    other_door = Caller(name="anna", role=Role.OPERATE, door="mqtt")
    for thief in (BEN, other_door):
        for misuse in (
            lambda who=thief: leases.renew(who, "pump", key, 10, now=1, time_s=WALL_S),
            lambda who=thief: leases.end(who, "pump", key, now=1),
            lambda who=thief: leases.admit(who, "pump", key, now=1),
            lambda who=thief: take(leases, who, now=1, key=key),
        ):
            with pytest.raises(LeaseError):
                misuse()
    assert leases.holder_of("pump", now=1).holder == ANNA


def test_holder_acquires_the_lease_again_with_its_key():
    leases = Leases()
    key = take(leases, ANNA).key
    again = take(leases, ANNA, now=5, key=key)
    assert (again.key, again.until_s) == (key, WALL_S + 15)
    assert take(leases, ANNA, now=20, key=key).key != key, "the old lease has expired, so the key is new"


def test_commands_are_admitted_without_a_lease_or_with_its_key():
    leases = Leases()
    assert leases.admit(ANNA, "pump", "", now=0) is None
    with pytest.raises(LeaseError, match="the lease of pump has expired; acquire it again"):
        leases.admit(ANNA, "pump", "a key from before", now=0)
    lease = take(leases, ANNA)
    assert leases.admit(ANNA, "pump", lease.key, now=1) == lease
    for caller, key in ((ANNA, ""), (ANNA, "\ud800"), (BEN, ""), (BEN, lease.key)):
        with pytest.raises(LeaseError):
            leases.admit(caller, "pump", key, now=1)
    assert leases.admit(BEN, "pump", "", now=10) is None, "the lease has expired, even before `expire` is called"


def test_each_expired_lease_is_reported_once_even_if_acquired_again():
    leases = Leases()
    first = take(leases, ANNA)
    second = take(leases, BEN, now=10)
    assert leases.expire(10) == [first]
    assert not leases.expire(19.9)
    assert leases.expire(20) == [second]
    assert not leases.expire(20)


def test_lease_of_one_command_may_expire_before_its_release():
    leases = Leases()
    alone = take(leases, ANNA)
    leases.release(alone)
    assert not leases.expire(100)
    slow = take(leases, ANNA)
    assert leases.expire(10) == [slow]
    leases.release(slow)
    other = take(leases, BEN, now=10)
    leases.release(slow)
    assert leases.holder_of("pump", now=10) == other


@pytest.mark.parametrize("seconds", [0, -1, 30.1, math.nan, math.inf, "10", None])
def test_invalid_lease_time_is_refused(seconds):
    leases = Leases()
    with pytest.raises(UsageError, match="give up to 30 s, and renew it"):
        take(leases, ANNA, seconds)
    assert not leases.all(now=0)


CALLERS = [ANNA, BEN, Caller(name="anna", role=Role.OPERATE, door="mqtt")]


@pytest.mark.soak
@given(
    st.lists(
        st.tuples(
            st.sampled_from(["take", "take again", "renew", "end", "admit", "expire"]),
            st.integers(0, 2),
            st.sampled_from(["pump", "fan"]),
            st.floats(0.1, 30),
            st.floats(0, 20),
            st.integers(0, 3),
        ),
        max_size=40,
    )
)
def test_random_lease_calls_have_one_holder_and_report_every_end(calls):
    leases, now = Leases(), 0.0
    keys, until, ended, given_back, all_keys = {}, {}, [], [], []
    for what, who, drive, seconds, later, which in calls:
        now += later
        caller = CALLERS[who]
        key = "" if what == "take" else ["", *all_keys[-3:]][which % (1 + len(all_keys[-3:]))]
        holder = keys.get(drive) if until.get(drive, 0.0) > now else None
        mine = holder == (caller, key)
        try:
            if what in ("take", "take again"):
                lease = take(leases, caller, seconds, now=now, drive=drive, key=key)
                assert holder is None or (mine and lease.key == key)
                keys[drive], until[drive] = (caller, lease.key), now + seconds
                all_keys += [lease.key] if lease.key not in all_keys else []
            elif what == "renew":
                leases.renew(caller, drive, key, seconds, now=now, time_s=WALL_S)
                assert mine
                until[drive] = now + seconds
            elif what == "end":
                leases.end(caller, drive, key, now=now)
                assert mine
                until[drive] = 0.0
                given_back.append(key)
            elif what == "admit":
                lease = leases.admit(caller, drive, key, now=now)
                assert mine if lease else holder is None and not key
            else:
                ended += [each.key for each in leases.expire(now)]
        except LeaseError:
            assert not mine
            assert holder is not None or not what.startswith("take")
        held = {each.drive: (each.holder, each.key) for each in leases.all(now=now)}
        assert held == {each: keys[each] for each in keys if until[each] > now}
    ended += [each.key for each in leases.expire(now + 31)]
    assert sorted(ended + given_back) == sorted(all_keys), "each lease is released or reported as expired once"
