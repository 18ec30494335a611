"""Reading and setting a drive's own watchdog: the values written, their order, and refusals."""

import asyncio
from dataclasses import replace
from decimal import Decimal

import pytest
from hypothesis import given, settings, strategies as st

import drivecomm
from drivecomm.bus import keep, policies, read_watchdog, read_watchdog_async, set_watchdog, set_watchdog_async
from drivecomm.errors import NotSupported, StateError, UnexpectedReplyError, UsageError, ValueRefusedError
from drivecomm.models import load_model, read_model
from drivecomm.protocol import installed
from drivecomm.virtual import VirtualLine, virtual_drive

KNOWN = [
    ("vabus", "act", "trip", 5, {"413": 5}),
    ("vabus", "agile", "trip", 5, {"413": 5}),
    ("danfoss-fc", "fc300", "ramp", Decimal("2.5"), {"8-03": 25, "8-04": 2}),
    ("danfoss-fc", "fc102", "trip", 5, {"8-03": 50, "8-04": 5}),
    ("danfoss-fc", "vlt5000", "trip", 5, {"513": 5, "514": 5}),
    ("fuji", "frenic", "trip", 5, {"y08": 5, "y02": 0}),
    ("fuji", "vg", "trip", Decimal("0.5"), {"H38": 5, "H32": 0}),
]
"""Protocol, model, a policy of its watchdog, its time in seconds, and the parameter values the drive then holds."""


class Bench:
    """A virtual drive on a line, its bus, and the messages sent."""

    def __init__(self, protocol, model):
        self.virtual = virtual_drive(protocol, 2, **({"model": model} if model else {}))
        self.line = VirtualLine([self.virtual])
        self.sent = []
        self.bus = drivecomm.open_bus(self.line.port, trace=self._note)
        self.drive = self.bus.drive(protocol, 2, model=model)

    def _note(self, event):
        if event.what == "sent":
            self.sent.append(event.message)

    def holds(self, parameter):
        raw = self.virtual.peek(parameter, self.line.time)
        return int(raw, 16) if isinstance(raw, str) else raw

    @property
    def writes(self):
        intent = installed[self.drive.peer.protocol].intent
        return [message for message in self.sent if intent(message).access == "write"]


@pytest.mark.parametrize(("protocol", "model", "policy", "time_s", "held"), KNOWN, ids=str)
def test_set_watchdog_writes_the_drive_and_returns_its_state(protocol, model, policy, time_s, held):
    bench = Bench(protocol, model)
    before = read_watchdog(bench.drive)
    assert (before.policy, before.time_s, str(before)) == ("hold", None, "off")
    after = set_watchdog(bench.drive, policy, time_s)
    assert (after.policy, after.time_s) == (policy, time_s)
    assert after == read_watchdog(bench.drive)
    assert str(after).startswith(f"{policy} after {time_s}")
    assert {parameter: bench.holds(parameter) for parameter in held} == held


def test_keep_switches_the_watchdog_off_before_changing_its_time():
    bench = Bench("danfoss-fc", "fc300")
    bench.drive.write("8-03", 1)
    with keep(bench.drive, "ramp", watchdog_s=5):
        pass
    assert [message.pnu for message in bench.writes[-2:]] == [804, 803]


def test_drive_object_learns_the_watchdog_time():
    bench = Bench("danfoss-fc", "fc300")
    known = []
    bench.drive.watched = known.append
    set_watchdog(bench.drive, "ramp", 5)
    read_watchdog(bench.drive)
    set_watchdog(bench.drive, "hold")
    read_watchdog(bench.drive)
    assert known == [5, 5, None, None]


def test_time_below_the_minimum_of_its_parameter_is_not_sent():
    bench = Bench("danfoss-fc", "fc300")
    info = bench.drive.model.find("8-03")
    model = replace(
        bench.drive.model, parameters={**bench.drive.model.parameters, "8-03": replace(info, minimum=Decimal(2))}
    )
    drive = bench.bus.drive("danfoss-fc", 2, model=model)
    with pytest.raises(ValueRefusedError, match=r"does not support a timeout of 1\.9 s"):
        set_watchdog(drive, "ramp", "1.9")
    assert bench.sent == []
    assert set_watchdog(drive, "ramp", 2).time_s == 2


def test_zero_or_negative_watchdog_time_is_refused():
    model = load_model("drivecomm_danfoss_fc", "danfoss-fc", "fc300")
    model = replace(model, parameters={**model.parameters, "8-03": replace(model.find("8-03"), minimum=None)})
    bench = Bench("danfoss-fc", "fc300")
    drive = bench.bus.drive("danfoss-fc", 2, model=model)
    for time_s in (0, -1):
        with pytest.raises(ValueRefusedError, match=f"does not support a timeout of {time_s} s"):
            set_watchdog(drive, "ramp", time_s)
    assert bench.sent == []


@pytest.mark.parametrize(("protocol", "model", "policy", "time_s", "held"), KNOWN, ids=str)
def test_hold_switches_the_watchdog_off(protocol, model, policy, time_s, held):
    bench = Bench(protocol, model)
    set_watchdog(bench.drive, policy, time_s)
    off = set_watchdog(bench.drive, "hold")
    assert (off.policy, off.time_s) == ("hold", None)
    assert any(bench.holds(parameter) == 0 for parameter in held)


@pytest.mark.parametrize(("protocol", "model", "policy", "time_s"), [case[:4] for case in KNOWN], ids=str)
def test_unchanged_watchdog_is_not_written_again(protocol, model, policy, time_s):
    bench = Bench(protocol, model)
    set_watchdog(bench.drive, policy, time_s)
    bench.sent.clear()
    set_watchdog(bench.drive, policy, time_s)
    assert bench.sent
    assert not bench.writes


def test_watchdog_is_switched_on_last_and_off_first():
    bench = Bench("danfoss-fc", "fc300")
    set_watchdog(bench.drive, "ramp", 7)
    set_watchdog(bench.drive, "hold")
    assert [message.pnu for message in bench.writes] == [803, 804, 804]
    bench = Bench("fuji", "vg")
    bench.virtual.poke("H32", 3)
    set_watchdog(bench.drive, "trip", 7)
    assert [message.function for message in bench.writes] == ["H32", "H38"]


@pytest.mark.parametrize(("model", "survives"), [("agile", False), ("act", True)])
def test_watchdog_is_written_to_ram_if_the_drive_has_it(model, survives):
    bench = Bench("vabus", model)
    set_watchdog(bench.drive, "trip", 9)
    bench.virtual.power_cycle(bench.line.time)
    assert (bench.holds("413") == 9) is survives


def test_action_that_is_not_a_policy_is_shown_in_the_words_of_the_drive():
    bench = Bench("danfoss-fc", "fc300")
    bench.virtual.poke("8-04", 3)
    found = read_watchdog(bench.drive)
    assert (found.policy, found.action, str(found)) == (None, "jogging", "jogging after 1.0 s")
    bench.virtual.poke("8-04", 6)
    assert read_watchdog(bench.drive).action == "what 8-04 = 6 means"


@pytest.mark.parametrize(
    ("drive", "policy", "time_s", "error", "sentence"),
    [
        (("vabus", None), "trip", 5, UsageError, "vabus:2 has no model"),
        (("vlt3500", "vlt3500"), "trip", 5, NotSupported, "has no watchdog"),
        (("fuji", "g11s"), "trip", 5, NotSupported, "has no watchdog"),
        (("vabus", "agile"), "ramp", 5, NotSupported, "parameter 413. cannot ramp; it can hold or trip"),
        (("danfoss-fc", "fc300"), "coast", 5, NotSupported, "8-03 and 8-04. cannot coast; it can hold or ramp or trip"),
        (("vabus", "agile"), "trip", "2.5", ValueRefusedError, "413 counts in steps of 1 s up to 10000"),
        (("vabus", "agile"), "trip", 10001, ValueRefusedError, "does not support a timeout of 10001 s"),
        (("vabus", "agile"), "trip", 0, ValueRefusedError, "does not support a timeout of 0 s"),
        (("vabus", "agile"), "trip", -1, ValueRefusedError, "does not support a timeout of -1 s"),
        (("vabus", "agile"), "trip", "soon", ValueRefusedError, "not a number"),
        (("danfoss-fc", "fc300"), "ramp", "0.25", ValueRefusedError, "steps of 0.1 s"),
    ],
)
def test_impossible_watchdog_is_refused_before_sending(drive, policy, time_s, error, sentence):
    bench = Bench(*drive)
    with pytest.raises(error, match=sentence):
        set_watchdog(bench.drive, policy, time_s)
    assert not bench.sent


def test_drive_that_does_not_hold_the_written_watchdog_raises_state_error():
    bench = Bench("danfoss-fc", "fc300")
    bench.virtual.store.write = lambda *_, **__: (1, 0)
    with pytest.raises(StateError, match="do not rely on the watchdog"):
        set_watchdog(bench.drive, "ramp", 3)


def test_watchdog_parameter_that_is_not_a_number_is_refused(tmp_path):
    model = own_model(tmp_path, '[watchdog]\ntime = "029"\noff = 0\nactions = { trip = 0 }\n', type="string")
    bench = Bench("vabus", model)
    with pytest.raises(UnexpectedReplyError, match="not a number"):
        read_watchdog(bench.drive)


def test_watchdog_of_a_model_must_be_one_of_its_parameters(tmp_path):
    model = own_model(tmp_path, '[watchdog]\ntime = "999"\noff = 0\nactions = { trip = 0 }\n')
    bench = Bench("vabus", model)
    with pytest.raises(UsageError, match="'999', not one of its parameters"):
        read_watchdog(bench.drive)


def own_model(folder, text, type="uint"):
    path = folder / "own.toml"
    path.write_text(
        f'format = 1\nprotocol = "vabus"\nname = "own"\nextends = "agile"\n{text}\n'
        f'[[parameter]]\naddress = "029"\nname = "own"\ntype = "{type}"\n',
        encoding="utf-8",
    )
    return read_model(path, "vabus", "drivecomm_vabus")


def test_async_set_watchdog_reads_back_and_refuses_alike():
    virtual = virtual_drive("danfoss-fc", 2, model="fc300")
    line = VirtualLine([virtual])

    async def program():
        async with drivecomm.open_bus_async(line.port) as bus:
            drive = bus.drive("danfoss-fc", 2, model="fc300")
            after = await set_watchdog_async(drive, "ramp", 4)
            assert after == await read_watchdog_async(drive)
            assert (after.policy, after.time_s) == ("ramp", 4)
            with pytest.raises(NotSupported, match="cannot coast"):
                await set_watchdog_async(drive, "coast", 4)

    asyncio.run(program())
    assert (virtual.peek("8-03", line.time), virtual.peek("8-04", line.time)) == (40, 2)


def test_policies_are_those_of_the_model():
    assert policies(None) == ()
    assert policies(load_model("drivecomm_vlt3500", "vlt3500", "vlt3500")) == ()
    assert policies(load_model("drivecomm_vabus", "vabus", "agile")) == ("hold", "trip")
    assert set(policies(load_model("drivecomm_danfoss_fc", "danfoss-fc", "fc300"))) == {"hold", "ramp", "trip"}


@settings(max_examples=30, deadline=None)
@given(time_s=st.decimals("0.01", "20000", places=2))
def test_watchdog_time_is_set_exactly_or_refused(time_s):
    bench = Bench("danfoss-fc", "fc300")
    try:
        after = set_watchdog(bench.drive, "ramp", time_s)
    except ValueRefusedError:
        assert time_s * 10 % 1
        assert not bench.sent
    except drivecomm.RefusedError:
        # The drive has a limit that its model lacks; the parameter that switches it on was not written.
        assert bench.holds("8-04") == 0
    else:
        assert after.time_s == time_s
