"""Addresses that may command by this door: only those of the plant file; refusals are recorded."""

import pytest
from commanded_plant import STOP
from fake_units import table
from raw_master import Refused, until

from drivecomm.server import Role
from drivecomm.server.modbus_tcp import ModbusTcpDoor

WRITES = [
    b"\x06\x03\xe8\x00\x01",
    b"\x10\x03\xe8\x00\x01\x02\x00\x01",
    b"\x17\x00\x00\x00\x01\x03\xe8\x00\x01\x02\x00\x01",
]


@pytest.mark.parametrize("content", WRITES, ids=["06", "16", "23"])
def test_writes_are_refused_without_commands_from(master, plant, content):
    with pytest.raises(Refused) as caught:
        master.exchange(content)
    assert caught.value.code == 1
    assert not plant.commands


def test_command_registers_are_missing_without_commands_from(master):
    with pytest.raises(Refused) as caught:
        master.read(STOP, 16)
    assert caught.value.code == 2


@pytest.mark.parametrize("content", WRITES, ids=["06", "16", "23"])
def test_unlisted_address_may_not_command_or_stop(plant, serve, content):
    with serve(commands_from=["192.0.2.0/24"])() as master:
        for _ in range(100):
            with pytest.raises(Refused) as caught:
                master.exchange(content)
            assert caught.value.code == 1
        until(lambda: plant.refusals)
        caller, command, why = plant.refusals[0]
        assert (caller.name, caller.role) == ("127.0.0.1", Role.VIEW)
        assert (command.drive, command.arguments) == ("pump", {"register": STOP, "words": "0001"})
        assert why == "commands_from of the door does not list this address"
        # A flood of refusals must not displace important records from the audit.
        assert len(plant.refusals) < 10
    assert not plant.commands


@pytest.mark.parametrize(
    ("listed", "address", "may"),
    [
        (["192.168.10.5"], "192.168.10.5", True),
        (["192.168.10.5"], "192.168.10.6", False),
        (["192.168.11.0/24", "192.168.10.5"], "192.168.11.77", True),
        (["192.168.10.5"], "::ffff:192.168.10.5", True),
        (["fe80::/10"], "fe80::1%eth0", True),
        (["127.0.0.1"], "", False),
        (["0.0.0.0/0"], "::1", False),
    ],
)
def test_commands_from_matches_addresses_and_networks(listed, address, may):
    assert ModbusTcpDoor(table(commands_from=listed)).settings.may_command(address) is may
