"""Blocks of registers read by one telegram: never across a refused register, never more than the drive allows."""

from functools import cache

import pytest
from extents import some
from hypothesis import given, settings, strategies as st

from drivecomm.models import load_model, model_names
from drivecomm.protocol import Framed, answered as carried_out, installed, resolve_options
from drivecomm.virtual import virtual_drive
from drivecomm_modbus.messages import Request

NAMES = model_names("drivecomm_modbus", "modbus")


@cache
def series(name):
    """Return the operations, options, readable parameters and a virtual drive of a series."""
    plugin, model = installed["modbus"], load_model("drivecomm_modbus", "modbus", name)
    options = resolve_options(plugin, model, {})[1]
    readable = sorted(info.address for info in model.parameters.values() if "r" in info.access)
    return plugin.operations(1, options, model), options, readable, virtual_drive("modbus", 1, model=name)


def answered(drive, message):
    return drive.codec.decode(drive.hear(Framed(drive.codec.encode(message), message), 1.0).data, "reply")


@pytest.mark.soak
@pytest.mark.parametrize("name", some(3, NAMES))
@settings(deadline=None)
@given(data=st.data())
def test_block_does_not_span_registers_that_the_drive_refuses(name, data):
    operations, options, readable, drive = series(name)
    wanted = data.draw(st.lists(st.sampled_from(readable), min_size=1, max_size=40, unique=True))
    blocks = operations.blocks(wanted)
    assert sorted(place for block in blocks for place in block) == list(range(len(wanted)))
    for block in blocks:
        together = [wanted[place] for place in block]
        if len(together) == 1:
            continue
        request = next(operations.read_many(together)).message
        assert request.count <= options.max_registers
        reply = answered(drive, request)
        assert reply.exception is None, together
        assert len(reply.values) >= request.count
        if options.bridged_registers == 0 and request.function == 3:
            for start in range(request.start, request.start + request.count):
                alone = answered(drive, Request(address=1, function=3, start=start, count=1))
                assert alone.exception is None, start


@pytest.mark.parametrize("name", NAMES)
def test_blocks_of_all_readable_parameters_are_read_without_a_refusal(name):
    operations, _, readable, drive = series(name)
    for block in operations.blocks(readable):
        together = [readable[place] for place in block]
        exchange = operations.read_many(together) if len(together) > 1 else operations.read(together[0])
        assert answered(drive, next(exchange).message).exception is None, together


def test_parameter_in_a_block_is_read_from_its_own_registers():
    operations, _, readable, drive = series("gs2")
    block = next(each for each in operations.blocks(readable) if len(each) > 1)
    together = [readable[each] for each in block]
    for number, name in enumerate(together, 1):
        drive.poke(name, number)
    told = carried_out(operations.read_many(together), lambda ask: answered(drive, ask.message))
    assert [each.raw for each in told] == list(range(1, len(together) + 1))
