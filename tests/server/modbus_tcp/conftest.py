"""Modbus TCP doors of a fake plant, and one over virtual drives for PLCs that send commands."""

import time

import fake_plant
import pytest
from commanded_plant import DONE, STOP, Plc, gateway
from fake_units import Plant, table
from raw_master import Master, until

from drivecomm.server.modbus_tcp import modbus_tcp_door


@pytest.fixture
def plant():
    return Plant()


@pytest.fixture
def serve(plant):
    """Yield a function that opens a door with these keys and returns a function that connects a master to it."""
    ends = []

    def begin(**content):
        door = modbus_tcp_door(table(**content))
        serving = fake_plant.served(door, plant)
        serving.__enter__()
        ends.append(serving)
        return lambda unit=1: Master(door.port, unit)

    yield begin
    for serving in ends:
        serving.__exit__(None, None, None)


@pytest.fixture
def master(serve):
    with serve()() as found:
        yield found


@pytest.fixture(scope="module")
def hall(tmp_path_factory):
    with gateway(tmp_path_factory.mktemp("hall")) as found:
        yield found


@pytest.fixture
def served(hall):
    """Yield the gateway, with its motor at rest and no lease held."""
    yield hall
    with hall.master() as master:
        master.write_one(STOP, 1)
        until(lambda: master.read(1015, 1) == [DONE])
    until(lambda: not hall.runs())
    until(lambda: not hall.plant.leases())
    until(lambda: "pump" not in hall.core.kept)
    until(lambda: hall.plant.drive("pump").standing_stop is None)
    time.sleep(0.15)
    hall.notes.asked_for.clear()
    hall.notes.ended_with.clear()
    hall.notes.stops.clear()


@pytest.fixture
def plc(served):
    with served.master() as master:
        yield Plc(master)
