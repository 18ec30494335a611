"""Who may command by this door: nobody unless the plant file lists their address, and whatever is refused is noted."""

import pytest
from commanded_plant import NOT_ALLOWED, REFUSED, START, STOP, Plc, gateway
from played_units import table
from raw_master import Refused, until

from drivecomm.server import Role
from drivecomm.server.modbus_tcp import ModbusTcpDoor

WRITES = [
    b"\x06\x03\xe8\x00\x01",
    b"\x10\x03\xe8\x00\x01\x02\x00\x01",
    b"\x17\x00\x00\x00\x01\x03\xe8\x00\x01\x02\x00\x01",
]


@pytest.mark.parametrize("content", WRITES, ids=["06", "16", "23"])
def test_nothing_is_written_unless_the_file_says_from_where(master, plant, content):
    with pytest.raises(Refused) as caught:
        master.exchange(content)
    assert caught.value.code == 1
    assert not plant.commands


def test_a_door_without_commanders_has_no_command_registers(master):
    with pytest.raises(Refused) as caught:
        master.read(STOP, 16)
    assert caught.value.code == 2


@pytest.mark.parametrize("content", WRITES, ids=["06", "16", "23"])
def test_an_address_that_is_not_listed_commands_nothing_not_even_a_stop(plant, serve, content):
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
        # A flood of them does not push what matters out of the audit.
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
def test_whose_commands_are_taken(listed, address, may):
    assert ModbusTcpDoor(table(commands_from=listed)).settings.may_command(address) is may


def test_what_a_drive_does_not_allow_is_refused_and_noted(tmp_path):
    """The address is listed, and the drive allows this kind of door nothing."""
    with gateway(tmp_path, verbs='"reset"') as served, served.master() as master:
        plc = Plc(master)
        results = plc.give(START, kind=1, reference=50.0)
        assert (results.outcome, results.reason) == (REFUSED, NOT_ALLOWED)
        plc.cycles_until(lambda: plc.results().reference_outcome == REFUSED)
        assert plc.results().reference_reason == NOT_ALLOWED
        plc.kind, plc.sequence = 0, plc.sequence + 1
        results = plc.answered()
        assert (results.outcome, results.reason) == (REFUSED, NOT_ALLOWED)
        assert not served.runs()
        assert not served.verbs()
        refused = [(drive, verb) for drive, verb, what in served.notes.ended_with if what.startswith("refused")]
        assert refused[:3] == [("pump", "start"), ("pump", "set_reference"), ("pump", "start")]
