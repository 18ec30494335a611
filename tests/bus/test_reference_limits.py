"""A reference above a drive's maximum is refused before it is sent, on every protocol; the motor keeps its speed."""

from decimal import Decimal

import pytest
from addresses import address_of

import drivecomm
from drivecomm.errors import NotSupported, UsageError, ValueRefusedError
from drivecomm.models import model_names
from drivecomm.protocol import installed
from drivecomm.virtual import VirtualLine, virtual_drive

HZ_OPTIONS = {
    "danfoss-fc": {"reference_maximum_hz": 50},
    "uss": {"reference_frequency_hz": 50},
    "vlt3500": {"maximum_hz": 50},
}
EVERY = [(name, model) for name in sorted(installed) for model in model_names(installed[name].package, name)]


class Running:
    """A motor that runs at half its maximum reference, and the telegrams that the master sends after that."""

    def __init__(self, bus, line, name, model):
        self.name, self.line = name, line
        self.virtual = line.drives[0]
        self.drive = bus.drive(name, self.virtual.address, model=model, confirmed=model, **HZ_OPTIONS.get(name, {}))
        able = self.drive.capabilities
        if not (able.reference_percent or able.reference_hz):
            pytest.skip(f"{model} takes no reference")
        try:
            self.drive.set_reference(**({"percent": 50} if able.reference_percent else {"hz": 20}))
            self.drive.start()
        except NotSupported as error:
            pytest.skip(f"{model} cannot be started: {error}")
        line.advance(60)
        self.sent = []
        line.monitors.append(lambda sent: self.sent.append(sent.data) if sent.sender is None else None)

    @property
    def speed(self):
        self.virtual.motor.advance(self.line.time)
        return round(self.virtual.motor.output_hz, 2)

    def commands(self):
        """Return the telegrams sent that do more than read or prepare a read."""
        protocol = installed[self.name]
        codec = self.virtual.codec
        return [data for data in self.sent if not protocol.intent(codec.decode(data, "request")).moves_nothing]


@pytest.fixture
def running(request):
    name, model = request.param
    line = VirtualLine([virtual_drive(name, address_of(name), model=model)])
    with drivecomm.open_bus(line.port) as bus:
        yield Running(bus, line, name, model)


every = pytest.mark.parametrize("running", EVERY, ids="-".join, indirect=True)


@every
@pytest.mark.parametrize("percent", ["100.01", 150, 199, -150, 1_000_000, float("nan"), float("inf"), "fast"])
def test_refused_percentage_sends_nothing_and_leaves_the_speed(running, percent):
    before = running.speed
    assert before > 0
    with pytest.raises(UsageError):
        running.drive.set_reference(percent=percent)
    assert running.sent == []
    running.line.advance(60)
    assert running.speed == before


@every
@pytest.mark.parametrize("hz", [1000, -1000, float("nan")])
def test_refused_frequency_commands_nothing_and_leaves_the_speed(running, hz):
    before = running.speed
    with pytest.raises(UsageError):
        running.drive.set_reference(hz=hz)
    assert running.commands() == []
    running.line.advance(60)
    assert running.speed == before


@every
def test_frequency_just_above_the_maximum_of_the_drive_is_refused(running):
    able = running.drive.capabilities
    maximum = able.reference_maximum
    if not (maximum and able.reference_hz):
        pytest.skip("no parameter is known to hold the maximum frequency")
    before, highest = running.speed, running.drive.read(maximum)
    assert highest.unit == "Hz"
    with pytest.raises(ValueRefusedError, match=f"above {highest}, the maximum frequency of .* \\(parameter {maximum}"):
        running.drive.set_reference(hz=highest.value + 1)
    assert running.commands() == []
    running.line.advance(60)
    assert running.speed == before
    running.drive.set_reference(hz=highest.value)


@pytest.mark.parametrize("name", ["danfoss-fc", "uss"])
def test_reference_limit_option_raises_the_limit_and_is_named_in_the_error(name):
    line = VirtualLine([virtual_drive(name, 1)])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive(name, 1, reference_limit=120)
        assert drive.capabilities.reference_limit == Decimal(120)
        drive.set_reference(percent=120)
        with pytest.raises(ValueRefusedError, match=f"130 % is above 120 %, the reference_limit of {name}:1"):
            drive.set_reference(percent=130)
        for wrong in (0, -5, 201, "much"):
            with pytest.raises(UsageError, match="reference_limit"):
                bus.drive(name, 2, reference_limit=wrong)


def test_maximum_frequency_is_read_once_and_again_before_a_refusal():
    line = VirtualLine([virtual_drive("vabus", 1, model="agile")])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("vabus", 1, model="agile")
        asked = []
        line.monitors.append(
            lambda sent: asked.append(sent.data) if b"00419" in sent.data and sent.sender is None else None
        )
        for hz in (10, 20, 30):
            drive.set_reference(hz=hz)
        assert len(asked) == 1
        line.drives[0].poke("419", 6000)
        drive.set_reference(hz=55)
        assert len(asked) == 2
        # A write to the drive may lower its maximum.
        drive.write("419", 40)
        with pytest.raises(ValueRefusedError, match=r"50 Hz is above 40\.00 Hz"):
            drive.set_reference(hz=50)
