"""The Modbus TCP door: its table, refused settings, and its register map."""

import csv
import io
import pkgutil
import socket
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from fake_plant import FakePlant, served
from fake_units import table

from drivecomm.cli import main
from drivecomm.errors import FileFormatError, PortError
from drivecomm.server import Serving, read_settings
from drivecomm.server.modbus_tcp import ModbusTcpDoor, modbus_tcp_door
from drivecomm.tomlfile import TomlTable

PLANT = """\
format = 1
[[door]]
kind = "modbus-tcp"
{door}
[[line]]
name = "hall"
port = "/dev/no-such-port"
[[drive]]
name = "pump"
title = "feed | pump"
drive = "vabus:1"
options = {{ model = "agile" }}
poll = [{{ parameters = ["output_frequency", "480"], period_s = 0.5 }}]
[[drive]]
name = "fan"
drive = "danfoss-fc:3"
"""


def written(tmp_path, door):
    path = tmp_path / "plant.toml"
    path.write_text(PLANT.format(door=door))
    return path


def test_modbus_tcp_door_listens_on_loopback_by_default():
    door = modbus_tcp_door(TomlTable({"units": {"pump": 1}}, "hall.toml"))
    assert door.name == "modbus-tcp 127.0.0.1:5020"
    assert door.settings.commands_from == ()


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ({"listen": "502"}, 'write an address and a port, such as "127.0.0.1:5020"'),
        ({"unit": {}}, "did you mean 'units'?"),
        ({"units": {}}, "no drive is a unit; write units ="),
        ({"units": ["pump"]}, "invalid units = ['pump']"),
        ({"units": {"pump": 0}}, "invalid pump = 0; write a number from 1 to 247"),
        ({"units": {"pump": 248}}, "invalid pump = 248"),
        ({"units": {"pump": True}}, "invalid pump = True"),
        ({"units": {"pump": 1, "fan": 1}}, "pump and fan cannot both be unit 1"),
        ({"registers": {"mixer": {"480": 200}}}, "mixer is not a unit"),
        ({"registers": {"pump": {"480": 201}}}, "invalid 480 = 201; write a multiple of 4 from 200 to 996"),
        ({"registers": {"pump": {"480": 196}}}, "invalid 480 = 196"),
        ({"registers": {"pump": {"480": 1000}}}, "invalid 480 = 1000"),
        ({"registers": {"pump": {"480": "200"}}}, "invalid 480 = '200'"),
        ({"registers": {"pump": {"480": 200, "481": 200}}}, "480 and 481 cannot both be at 200"),
        ({"registers": {"pump": {"480": {"address": 200, "type": "int16"}}}}, "write 'float32' or 'uint32'"),
        ({"registers": {"pump": {"480": {"type": "uint32"}}}}, "the key 'address' is missing"),
        ({"registers": {"pump": 200}}, "invalid pump = 200; write a table in braces"),
        ({"commands_from": ["pump.example"]}, "commands_from cannot hold 'pump.example'; write addresses"),
        ({"commands_from": [1]}, "commands_from cannot hold 1"),
        ({"lease_s": 31}, "invalid lease_s = 31; write seconds from 0.5 to 30"),
        ({"lease_s": 0}, "invalid lease_s = 0"),
    ],
)
def test_invalid_modbus_tcp_table_is_refused(content, text):
    with pytest.raises(FileFormatError) as caught:
        ModbusTcpDoor(table(**content))
    assert text in str(caught.value)
    assert str(caught.value).startswith("hall.toml: door 1")


def test_units_must_be_given_explicitly():
    with pytest.raises(FileFormatError, match="the key 'units' is missing; write units = a number from 1 to 247"):
        ModbusTcpDoor(TomlTable({}, "hall.toml"))


@pytest.mark.parametrize("listen", ["0.0.0.0:502", "[::]:502", "192.168.1.2:502"])
def test_network_address_needs_insecure_true(listen):
    with pytest.raises(FileFormatError, match=r"no encryption and no users; .*, or set insecure = true"):
        ModbusTcpDoor(table(listen=listen))
    assert ModbusTcpDoor(table(listen=listen, insecure=True)).name == f"modbus-tcp {listen}"


def test_port_in_use_is_reported():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        listen = f"127.0.0.1:{taken.getsockname()[1]}"
        refusal = pytest.raises(PortError, match=f"cannot listen on {listen}: .*; write another listen =")
        with refusal, served(modbus_tcp_door(table(listen=listen)), FakePlant()):
            pass


@pytest.mark.parametrize(
    ("door", "text"),
    [
        ("units = { pump = 1, fun = 2 }", "line 4: door 1 .*: units: there is no drive 'fun' for unit 2; did you mean"),
        ('units = { pump = 1 }\nregisters = { pump = { "481" = 200 } }', "line 5: .*481 of pump is not polled; write"),
    ],
)
def test_unknown_drive_or_quantity_prevents_the_start(tmp_path, door, text):
    path = written(tmp_path, door)
    [(_, said)] = read_settings(path).doors
    with pytest.raises(FileFormatError, match=text):
        Serving(path, doors=[ModbusTcpDoor(said)])


def test_modbus_tcp_door_has_its_entry_point():
    project = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert pkgutil.resolve_name(project["entry-points"]["drivecomm.doors"]["modbus-tcp"]) is modbus_tcp_door
    assert project["optional-dependencies"]["modbus-tcp"] == ["pymodbus>=3.16,<4"]


@pytest.mark.soak
def test_pymodbus_is_imported_only_to_serve_a_door(tmp_path):
    path = written(tmp_path, "units = { pump = 1 }")
    program = (
        "import sys\n"
        "from drivecomm.cli import main\n"
        f"assert main(['serve', {str(path)!r}, '--registers']) == 0\n"
        "assert not [each for each in sys.modules if each.partition('.')[0] in ('pymodbus', 'uvicorn', 'serial')]\n"
        "from drivecomm.server.modbus_tcp import modbus_tcp_door\n"
        "from drivecomm.tomlfile import TomlTable\n"
        "modbus_tcp_door(TomlTable({'units': {'pump': 1}}, 'plant.toml'))\n"
        "assert 'pymodbus' in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, timeout=60)


class TestMap:
    def test_map_as_markdown_lists_units_and_registers(self, tmp_path, capsys):
        path = written(tmp_path, 'units = { pump = 7, fan = 2 }\nregisters = { pump = { "480" = 204 } }')
        assert main(["serve", str(path), "--registers"]) == 0
        text = capsys.readouterr().out
        assert "| 2 | fan |  |\n| 7 | pump | feed &#124; pump |" in text
        assert "| 8 | 30009 | 40009 | float32 | output_frequency | Hz |" in text
        assert "## Further values of pump\n" in text
        assert "| 204 | 30205 | 40205 | float32 | 480 |" in text
        assert "heartbeat" not in text

    def test_map_lists_command_registers_if_commands_are_allowed(self, tmp_path, capsys):
        path = written(tmp_path, 'units = { pump = 7 }\ncommands_from = ["192.168.10.5"]')
        assert main(["serve", str(path), "--registers"]) == 0
        text = capsys.readouterr().out
        assert "## Commands, from 192.168.10.5/32" in text
        assert "| 1000 |  | 41001 | uint16 | stop |" in text
        assert "| 1008 | 31009 | 41009 | uint16 | answered_sequence |" in text

    def test_map_as_csv_has_every_register_of_every_unit_once(self, tmp_path, capsys):
        path = written(tmp_path, 'units = { pump = 7, fan = 2 }\nregisters = { pump = { "480" = 204 } }')
        assert main(["serve", str(path), "--registers", "--csv", str(tmp_path / "map.csv")]) == 0
        assert "map.csv" in capsys.readouterr().out
        rows = list(csv.DictReader(io.StringIO((tmp_path / "map.csv").read_text())))
        taken = [(row["unit"], int(row["address"]) + place) for row in rows for place in range(int(row["registers"]))]
        assert len(taken) == len(set(taken))
        assert {row["drive"] for row in rows if row["address"] == "204"} == {"pump"}
        assert {row["name"] for row in rows if row["address"] == "8"} == {"output_frequency"}

    def test_map_shows_the_model_note_unless_the_plant_file_confirms_it(self, tmp_path, capsys):
        path = written(tmp_path, "units = { pump = 7 }")
        assert main(["serve", str(path), "--registers"]) == 0
        assert "| pump | output_frequency | type and unit are derived |" in capsys.readouterr().out
        assert main(["serve", str(path), "--registers", "--csv", str(tmp_path / "map.csv")]) == 0
        rows = list(csv.DictReader(io.StringIO((tmp_path / "map.csv").read_text())))
        assert {row["note"] for row in rows if row["name"] == "output_frequency"} == {"type and unit are derived"}
        path.write_text(path.read_text().replace('name = "pump"', 'name = "pump"\nconfirmed = ["output_frequency"]'))
        assert main(["serve", str(path), "--registers"]) == 0
        assert "type and unit are derived" not in capsys.readouterr().out

    def test_map_needs_a_modbus_tcp_door(self, tmp_path, capsys):
        path = tmp_path / "plant.toml"
        path.write_text('format = 1\n[[line]]\nname = "hall"\n')
        assert main(["serve", str(path), "--registers"]) == 2
        assert 'write a [[door]] with kind = "modbus-tcp"' in capsys.readouterr().err

    def test_csv_option_needs_the_registers_option(self, tmp_path, capsys):
        path = written(tmp_path, "units = { pump = 7 }")
        assert main(["serve", str(path), "--csv", str(tmp_path / "map.csv")]) == 2
        assert "give --registers, too" in capsys.readouterr().err

    def test_register_addresses_never_change(self):
        """PLC programs rely on these addresses: rows may be added, never changed."""
        from drivecomm.server.modbus_tcp.layout import FIXED_QUANTITIES, command_rows, state_rows

        assert [(row.address, row.name) for row in state_rows()] == [
            (0, "layout"), (1, "state"), (2, "raw_status_word"), (3, "active_fault"), (4, "status_quality"),
            (5, "status_age"),
        ]  # fmt: skip
        assert list(FIXED_QUANTITIES)[:19] == [
            (8, "output_frequency"), (12, "output_current"), (16, "output_voltage"), (20, "output_power"),
            (24, "dc_link_voltage"), (28, "torque_percent"), (32, "torque"), (36, "motor_speed"),
            (40, "reference_frequency"), (44, "reference_percent"), (48, "heat_sink_temperature"),
            (52, "motor_thermal_load"), (56, "drive_thermal_load"), (60, "operating_hours"), (64, "running_hours"),
            (68, "energy"), (72, "fault_code"), (76, "alarm_word"), (80, "warning_word"),
        ]  # fmt: skip
        assert [(row.address, row.name) for row in command_rows()] == [
            (1000, "stop"), (1001, "heartbeat"), (1002, "sequence"), (1003, "command"), (1004, "reference_kind"),
            (1005, "reserved"), (1006, "reference"), (1008, "answered_sequence"), (1009, "outcome"), (1010, "reason"),
            (1011, "lease"), (1012, "lease_left"), (1013, "reference_outcome"), (1014, "reference_reason"),
            (1015, "stop_outcome"),
        ]  # fmt: skip
