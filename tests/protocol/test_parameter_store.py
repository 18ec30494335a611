"""Parameters held by virtual drives, and the codes of refused accesses."""

from decimal import Decimal

import pytest

from drivecomm.protocol import ParameterInfo, ParameterStore, Refusal

CODES = {"unknown": 1, "not readable": 2, "not writable": 3, "running": 4, "limits": 5}


def info(address, access="rw", **further):
    return ParameterInfo(address=address, name=f"p{address}", title="", access=access, **further)


@pytest.fixture
def store():
    infos = {1: info("1"), 2: info("2", "r"), 3: info("3", "w"), 4: info("4", "rw*")}
    return ParameterStore(infos, {(1, 0): "a", (1, 1): "b", (2, 0): "c"}, CODES)


def code_of(call, *given, **further):
    with pytest.raises(Refusal) as refused:
        call(*given, **further)
    return refused.value.code


def test_unknown_parameter_is_refused_with_the_same_code_by_every_access(store):
    assert {code_of(store.info, 9), code_of(store.readable, 9), code_of(store.writable, 9, running=False)} == {1}


def test_each_forbidden_access_is_refused_with_its_code(store):
    assert store.readable(2).address == "2"
    assert store.writable(3, running=True).address == "3"
    assert store.writable(4, running=False).address == "4"
    assert code_of(store.readable, 3) == 2
    assert code_of(store.writable, 2, running=False) == 3
    assert code_of(store.writable, 4, running=True) == 4


def test_value_above_the_maximum_is_refused_with_its_code(store):
    limited = info("5", minimum=Decimal(1), maximum=Decimal(2))
    store.must_allow(limited, Decimal(2))
    assert code_of(store.must_allow, limited, Decimal("2.1")) == 5


def test_power_cycle_clears_values_held_in_ram_only(store):
    store.put((1, 0), "new", stored=False)
    store.put((1, 1), "kept")
    assert store.held == {(1, 0): "new", (1, 1): "kept", (2, 0): "c"}
    store.power_cycle()
    assert store.held == {(1, 0): "a", (1, 1): "kept", (2, 0): "c"}
    store.put((1, 1), "of this day", stored=False)
    store.power_cycle()
    assert store.held[1, 1] == "kept"
