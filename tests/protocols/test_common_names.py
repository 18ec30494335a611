"""Every common name of every installed model, read from the virtual drive of that model."""

from decimal import Decimal
from struct import pack, unpack

import pytest

import drivecomm
from drivecomm.models import converted, load_model, model_names, quantities
from drivecomm.protocol import installed
from drivecomm.virtual import VirtualLine, virtual_drive

MODELS = {
    f"{plugin.name}-{name}": (plugin.name, load_model(plugin.package, plugin.name, name))
    for plugin in installed.working()
    for name in model_names(plugin.package, plugin.name)
}
MAPPED = {
    f"{title}-{common}": (protocol, model, common)
    for title, (protocol, model) in MODELS.items()
    for common in model.quantities
}

# Raw numbers by type: where the sign bit is, which types are sent as hexadecimal characters,
# and which carry their own scale (Fuji format [12]: ten bits of mantissa, two of exponent from 0.01 on).
SIGN_BITS = {"int": 1 << 15, "int16": 1 << 15, "long": 1 << 31, "int32": 1 << 31}
IN_HEXADECIMAL = ("uint", "int", "long")
IN_CHARACTERS = ("text", "string")
OWN_SCALES = {"[12]": lambda word: (word & 0x3FF) * Decimal(10) ** ((word >> 10 & 3) - 2)}


def parameter_at(model, address):
    """Return the parameter of an address, or that of its array; None if the model has neither."""
    return model.find(address) or model.find(address.partition("[")[0])


def meant_by(held, info):
    """Return the value of a raw value in the parameter's unit, computed without the reading code."""
    if info.type in IN_CHARACTERS:
        return str(held).rstrip()
    if isinstance(held, str):
        # VLT 3500 sends numbers as decimal text, with their decimals.
        if info.type not in IN_HEXADECIMAL:
            return Decimal(held)
        held = int(held, 16)
    if info.type == "Float":
        data = held.to_bytes(4, "big")
        texts = [f"{unpack('>f', data)[0]:.{digits}g}" for digits in range(1, 10)]
        return Decimal(next(text for text in texts if pack(">f", float(text)) == data)) * info.factor
    if info.type in OWN_SCALES:
        return OWN_SCALES[info.type](held)
    sign = SIGN_BITS.get(info.type, 0)
    return (held - (2 * sign if held & sign else 0)) * info.factor


class Bench:
    """A virtual drive of a model whose motor turns, and its master."""

    def __init__(self, protocol, model, bus_of):
        self.virtual = virtual_drive(protocol, installed[protocol].addresses[0], model=model)
        self.line = VirtualLine([self.virtual])
        self.drive = bus_of(self.line).drive(protocol, self.virtual.address, model=model)

    def turn(self):
        """Make the motor turn without a command; the drive may stop it at the next request."""
        self.virtual.motor.run(25.0, self.line.time)
        self.line.advance(600)

    def held(self, address, info):
        """Return the value that the drive holds now."""
        return meant_by(self.virtual.peek(address, self.line.time), info)


@pytest.fixture(scope="module")
def bench():
    """Yield a function that returns the bench of a model; benches are shared, since the tests only read."""
    buses, benches = [], {}

    def bus_of(line):
        buses.append(drivecomm.open_bus(line.port))
        return buses[-1]

    def of(protocol, model):
        if (protocol, model.name) not in benches:
            benches[protocol, model.name] = Bench(protocol, model, bus_of)
        return benches[protocol, model.name]

    yield of
    for bus in buses:
        bus.close()


@pytest.mark.parametrize(("protocol", "model", "common"), MAPPED.values(), ids=MAPPED)
def test_common_name_is_read_in_its_unit_with_the_value_the_drive_holds(bench, protocol, model, common):
    one = bench(protocol, model)
    one.turn()
    address = model.quantities[common]
    info = parameter_at(model, address)
    assert info is not None, f"{common} is parameter {address}, which the model does not have"
    quantity = quantities()[common]
    before = one.held(address, info)
    reading = one.drive.read(common)
    after = one.held(address, info)
    assert reading.name == common
    if info.type in IN_CHARACTERS:
        assert (reading.value, reading.unit, quantity.unit) == (before, "", "")
        return
    assert reading.unit == quantity.unit
    # A motor that runs down gives slightly less with every read.
    ends = sorted(converted(Decimal(each), info.unit, quantity.unit) for each in (before, after))
    assert ends[0] <= Decimal(reading.value) <= ends[1]


@pytest.mark.parametrize("model", [model for _, model in MODELS.values()], ids=MODELS)
def test_common_names_are_registered_and_map_to_distinct_parameters(model):
    assert set(model.quantities) <= set(quantities())
    addresses = list(model.quantities.values())
    assert len(set(addresses)) == len(addresses), "two common names for one parameter"
    for info in model.parameters.values():
        # A maker's name equal to a common name must mean that quantity, because the common name takes precedence.
        if info.name in model.quantities:
            assert parameter_at(model, model.quantities[info.name]) is info


@pytest.mark.parametrize(("protocol", "model"), MODELS.values(), ids=MODELS)
def test_common_name_reads_the_quantity_of_the_motor(bench, protocol, model):
    """Check that the mapped parameter is the one that shows the quantity, not merely one that reads correctly."""
    one = bench(protocol, model)
    motor = one.virtual.motor
    shown = {
        "output_frequency": (lambda: motor.output_hz, 0.1),
        "output_current": (lambda: motor.current_a, 0.1),
        "output_power": (lambda: motor.power_kw, 0.1),
        "motor_speed": (lambda: motor.speed_rpm, 2),
        "dc_link_voltage": (lambda: motor.dc_link_v, 2),
        "heat_sink_temperature": (lambda: motor.temperature_c, 1),
    }
    for common in shown.keys() & model.quantities.keys():
        one.turn()
        if not _measured(one, model, common):
            continue
        measured, within = shown[common]
        before = measured()
        value = float(one.drive.read(common).value)
        low, high = sorted((before, measured()))
        assert low - within <= value <= high + within, common


def _measured(one, model, common):
    """Return whether the virtual drive measures the quantity; an undocumented parameter only keeps its start value."""
    info = parameter_at(model, model.quantities[common])
    return info.sure != "unconfirmed" or one.drive.read(common).value != 0
