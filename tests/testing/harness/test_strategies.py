"""Public hypothesis strategies: properties of the drawn examples."""

import pytest
from benches import COMMANDED
from hypothesis import given, settings, strategies as st

import drivecomm
from drivecomm.errors import DriveError, UsageError, ValueRefusedError
from drivecomm.models import load_model
from drivecomm.plant import FaultPlan, LineFault
from drivecomm.protocol import installed
from drivecomm.testing import limits, strategies
from drivecomm.virtual import VirtualLine, virtual_drive

NAMES = [plugin.name for plugin in installed.working()]
FEW = settings(max_examples=20, derandomize=True, deadline=None, database=None)
every_protocol = pytest.mark.parametrize("name", NAMES)
NUMBERS = {
    ("ct-ansi", "request"): "group",
    ("ct-ansi", "reply"): "menu",
    ("ei-bisynch", "request"): "unit",
    ("ei-bisynch", "reply"): "mnemonic",
    ("hitachi", "request"): "node",
    ("hitachi", "reply"): "node",
    ("lecom", "reply"): "subcode",
    ("ls-bus", "request"): "station",
    ("ls-bus", "reply"): "station",
    ("mitsubishi", "request"): "station",
    ("mitsubishi", "reply"): "station",
    ("toshiba", "request"): "communication_number",
    ("toshiba", "reply"): "communication_number",
}
"""Number field of each protocol and direction, or the field that names a parameter; `address` for other protocols."""
MODELS = {plugin.name: load_model(plugin.package, plugin.name, plugin.default_model) for plugin in installed.working()}


@pytest.mark.soak
@every_protocol
@FEW
@given(data=st.data())
def test_drive_understands_every_drawn_call_of_a_conversation(name, data):
    calls = data.draw(strategies.conversations(name, max_size=6))
    address = installed[name].addresses[0]
    line = VirtualLine([virtual_drive(name, address, model=MODELS[name])])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive(name, address, model=MODELS[name])
        for call in calls:
            try:
                call.carry_out(drive)
            except DriveError:
                # The drive understood the call, but its state does not allow it.
                continue
            except ValueRefusedError:
                # An earlier write may have lowered the maximum frequency.
                assert call.verb == "set_reference"


@every_protocol
@FEW
@given(data=st.data())
def test_new_drive_accepts_every_drawn_read_and_write(name, data):
    is_access = lambda call: call.verb in ("read", "write")  # noqa: E731
    call = data.draw(strategies.verb_calls(name).filter(is_access))
    address = installed[name].addresses[0]
    line = VirtualLine([virtual_drive(name, address, model=MODELS[name])])
    with drivecomm.open_bus(line.port) as bus:
        call.carry_out(bus.drive(name, address, model=MODELS[name]))


@pytest.mark.soak
@every_protocol
def test_conversations_contain_all_kinds_of_calls(name):
    verbs = set()

    @settings(FEW, max_examples=60)
    @given(calls=strategies.conversations(name, min_size=8))
    def draw(calls):
        assert 8 <= len(calls) <= 12
        verbs.update(call.verb for call in calls)

    draw()
    commands = {"start", "stop", "set_reference"} if name in COMMANDED else set()
    infos = MODELS[name].parameters.values()
    # Commands of monitoring-only drives are never written, and EI Bisynch lists no other writable parameter.
    writes = {"write"} if any("w" in each.access and each.kind != "command" for each in infos) else set()
    assert {"read"} | writes | commands <= verbs


@pytest.mark.soak
@every_protocol
@pytest.mark.parametrize("direction", ["request", "reply"])
def test_drawn_field_values_have_the_right_type(name, direction):
    field = NUMBERS.get((name, direction), "address")

    @FEW
    @given(number=strategies.field_values(name, direction, field))
    def draw(number):
        assert number is None or type(number) is (str if field == "mnemonic" else int)

    draw()


def test_unknown_field_raises_usage_error():
    with pytest.raises(UsageError, match="no vabus request has a field 'adress'; they have address, "):
        strategies.field_values("vabus", "request", "adress")


def test_unknown_protocol_raises_an_error():
    for strategy in (strategies.telegrams, strategies.messages, strategies.telegram_fields):
        with pytest.raises(drivecomm.UnknownProtocolError):
            strategy("profibus", "request")
    with pytest.raises(drivecomm.UnknownProtocolError):
        strategies.conversations("profibus")


@FEW
@given(data=st.data())
def test_protocol_is_accepted_by_name_or_as_plugin(data):
    for protocol in ("vabus", installed["vabus"]):
        sent = data.draw(strategies.telegrams(protocol, "request"))
        assert drivecomm.decode("vabus", sent, direction="request").data == sent


@FEW
@given(plan=strategies.fault_plans(highest_rate=0.4, kinds=[LineFault.DROP, LineFault.CORRUPT]))
def test_drawn_fault_plans_keep_their_limits_and_are_repeatable(plan):
    assert isinstance(plan, FaultPlan)
    assert 0 <= plan.rate <= 0.4
    assert set(plan.kinds) <= {LineFault.DROP, LineFault.CORRUPT}
    # An equal plan produces the same faults.
    again = FaultPlan(rate=plan.rate, seed=plan.seed, kinds=plan.kinds, delay_s=plan.delay_s)
    assert [plan.request(b"12345678") for _ in range(30)] == [again.request(b"12345678") for _ in range(30)]


def test_repr_of_a_verb_call_is_its_source_text():
    call = strategies.VerbCall("write", ("481", 12), {"store": True})
    assert repr(call) == "write('481', 12, store=True)"
    assert repr(strategies.VerbCall("status")) == "status()"


@FEW
@given(lowest=st.integers(-(1 << 32), 0), highest=st.integers(0, 1 << 32))
def test_limits_finds_the_range_in_few_steps(lowest, highest):
    asked = []

    def accepts(number):
        asked.append(number)
        return lowest <= number <= highest

    assert limits(0, accepts) == (lowest, highest)
    assert len(asked) < 150


def test_limits_stops_for_an_unlimited_range():
    lowest, highest = limits(0, lambda _: True)
    assert lowest == -highest
    assert highest >= 1 << 32
