"""Drives with two protocols: the virtual drives of both agree in state, direction, readings and refusals."""

from contextlib import ExitStack

import pytest

import drivecomm
from drivecomm.errors import DriveCommError
from drivecomm.models import is_monitoring_only, load_model, model_names
from drivecomm.protocol import DriveState, Stop, installed
from drivecomm.virtual import VirtualLine, virtual_drive

PAIRS = {
    "bonfiglioli": (("modbus", "bonfiglioli"), ("vabus", "agile")),
    "danfoss": (("modbus", "danfoss-fc"), ("danfoss-fc", "fc300")),
    "g120": (("modbus", "siemens-g120"), ("uss", "g120")),
    "v20": (("modbus", "siemens-v20"), ("uss", "v20")),
    "fuji": (("modbus", "fuji-frenic"), ("fuji", "frenic")),
}
LIVE = (
    "output_frequency",
    "motor_speed",
    "torque",
    "torque_percent",
    "output_voltage",
    "status_word",
    "dc_link_voltage",
)
"""Common names whose readings must agree if both models have them; rated data and ramps belong to each model."""

WORDS_DIFFER = {("v20", Stop.COAST), ("v20", Stop.QUICK), ("fuji", "status_word")}
"""Cases that differ by design.

Register 40004 of a V20 is bit 3, USS coasts by OFF2, and set 1 has no quick stop. M14 has more of its bits over the
Fuji protocol.
"""


class One:
    """A virtual drive with one of its protocols, and the drive object of its master."""

    def __init__(self, protocol, model, stack):
        self.virtual = virtual_drive(protocol, 1, model=model)
        self.line = VirtualLine([self.virtual])
        self.drive = stack.enter_context(drivecomm.open_bus(self.line.port)).drive(protocol, 1, model=model)

    def set_reference(self, hz):
        can = self.drive.capabilities
        self.drive.set_reference(**({"hz": hz} if can.reference_hz else {"percent": 2 * hz}))

    def start(self, *, reverse=False):
        """Start in a direction, by the start if it offers one, otherwise by the sign of the reference."""
        can = self.drive.capabilities
        if not can.reverse:
            self.set_reference(-20 if reverse else 20)
        self.drive.start(reverse=reverse and can.reverse)

    def passes(self, seconds):
        # Feed the watchdogs as a poll plan would.
        for _ in range(seconds):
            self.line.advance(1)
            self.drive.status()

    def hz(self):
        self.virtual.follow(self.line.time)
        return round(self.virtual.motor.output_hz)

    def refuses(self, act, *arguments, **options):
        try:
            act(*arguments, **options)
        except DriveCommError as error:
            return type(error)
        return None


@pytest.fixture
def pair(name):
    with ExitStack() as stack:
        made = [One(protocol, model, stack) for protocol, model in PAIRS[name]]
        for one in made:
            one.set_reference(20)
        yield made


def same_state(pair):
    """Compare the output frequencies and the status fields that both drives report; return the state."""
    first, second = (one.drive.status() for one in pair)
    for field in ("state", "running", "fault", "warning", "at_reference", "reverse", "remote"):
        told = [getattr(each, field) for each in (first, second)]
        assert None in told or told[0] == told[1], f"{field}: {told}"
    assert pair[0].hz() == pair[1].hz()
    return first.state


def agree(name, pair):
    """Compare status, output frequency and readings of both drives; return the state."""
    state = same_state(pair)
    named = [one.drive.model.quantities for one in pair]
    for quantity in LIVE:
        if quantity in named[0] and quantity in named[1] and (name, quantity) not in WORDS_DIFFER:
            values = [float(one.drive.read(quantity).value) for one in pair]
            assert values[0] == pytest.approx(values[1], abs=0.1 if quantity != "status_word" else 0x400), quantity
    return state


@pytest.mark.parametrize("name", PAIRS)
def test_motor_runs_equally_in_both_directions(name, pair):
    for one in pair:
        one.start()
        one.passes(30)
    assert agree(name, pair) is DriveState.RUNNING
    assert pair[0].hz() == 20
    for one in pair:
        one.start(reverse=True)
        one.passes(30)
    assert agree(name, pair) is DriveState.RUNNING
    assert pair[0].hz() == -20


@pytest.mark.parametrize("how", [each for each in Stop if each is not Stop.DC_BRAKE])
@pytest.mark.parametrize("name", PAIRS)
def test_motor_stops_equally(name, how, pair):
    if (name, how) in WORDS_DIFFER:
        pytest.skip("the two protocols stop it so by different words")
    for one in pair:
        one.start()
        one.passes(10)
    assert len({one.refuses(one.drive.stop, how) for one in pair}) == 1
    states = []
    for one in pair:
        one.line.advance(0.2)
        states.append(one.drive.status().state)
    assert len(set(states)) == 1
    for one in pair:
        one.passes(30)
    agree(name, pair)


@pytest.mark.parametrize("name", PAIRS)
def test_tripped_drive_refuses_equally_until_it_is_reset(name, pair):
    for one in pair:
        one.start()
        one.passes(5)
        one.virtual.trip(3, one.line.time)
    assert same_state(pair) is DriveState.FAULT
    starts = {one.refuses(one.drive.start) for one in pair}
    assert len(starts) == 1
    assert starts != {None}
    assert len({one.refuses(one.drive.reset) for one in pair}) == 1
    for one in pair:
        one.passes(16)
        one.drive.reset()
    assert agree(name, pair) is not DriveState.FAULT
    assert pair[0].hz() == 0
    for one in pair:
        one.start()
        one.passes(10)
    assert agree(name, pair) is DriveState.RUNNING


@pytest.mark.parametrize("name", [each for each in PAIRS if each != "v20"])
def test_drive_shows_the_same_state_after_a_power_cycle(name, pair):
    """A V20 differs: its register set 1 cannot clear OFF2, so OFF2 is not set after power-up."""
    for one in pair:
        one.start()
        one.passes(5)
        one.virtual.power_cycle(one.line.time)
        one.passes(5)
    assert agree(name, pair) is not DriveState.RUNNING


@pytest.mark.parametrize("running", [False, True])
@pytest.mark.parametrize("name", PAIRS)
def test_writes_are_refused_equally(running, pair):
    for one in pair:
        if running:
            one.start()
            one.passes(5)
    infos = [{q: one.drive.model.parameters[at] for q, at in one.drive.model.quantities.items()} for one in pair]
    shared = infos[0].keys() & infos[1].keys()
    for quantity in sorted(each for each in shared if all(known[each].kind == "setting" for known in infos)):
        refused = set()
        for one in pair:
            before = one.drive.read(quantity)
            refused.add(one.refuses(one.drive.write, quantity, before.value) is not None)
            assert one.drive.read(quantity).value == before.value or quantity in LIVE
        assert len(refused) == 1, quantity


def test_bonfiglioli_start_is_refused_over_both_protocols_by_412():
    with ExitStack() as stack:
        pair = [One(protocol, model, stack) for protocol, model in PAIRS["bonfiglioli"]]
        refused = []
        for one in pair:
            one.set_reference(20)
            one.virtual.poke("412", 0)
            refused.append(one.refuses(one.drive.start))
            assert one.hz() == 0
        assert refused[0] is refused[1] is drivecomm.errors.StateError


@pytest.mark.parametrize("word", [0x0000, 0x0001, 0x0002, 0x0006, 0x0007, 0x000F, 0x0080])
def test_bonfiglioli_control_word_acts_as_contacts_over_both_protocols_by_412(word):
    with ExitStack() as stack:
        pair = [One(protocol, model, stack) for protocol, model in PAIRS["bonfiglioli"]]
        for one in pair:
            one.set_reference(20)
            one.virtual.poke("412", 0)
            one.drive.write("410", word)
            one.passes(20)
        assert (same_state(pair) is DriveState.RUNNING) is bool(word & 0x0006)
        assert pair[0].drive.status().remote is False


def test_each_drive_with_models_of_two_protocols_is_a_pair():
    """Monitoring-only models are left out, because their motor cannot be compared."""
    makers = {"bonfiglioli", "danfoss", "siemens", "fuji"}
    paired = {model for pair in PAIRS.values() for protocol, model in pair if protocol == "modbus"}
    for model in model_names("drivecomm_modbus", "modbus"):
        known = load_model("drivecomm_modbus", "modbus", model)
        if makers & set(known.title.lower().split()) and not is_monitoring_only(installed["modbus"], known):
            assert model in paired, f"{model} is known by another protocol too: add the pair"
