"""Line settings and ports in configuration files of other programs."""

import pytest

from drivecomm.commissioning.importing import read_foreign

HUB = """
modbus:
  - name: hall
    {where}
    sensors:
      - {{name: Speed, slave: 1, address: 5}}
"""


@pytest.mark.parametrize(
    ("where", "port", "options"),
    [
        ("{type: serial, port: COM3, baudrate: 9600, parity: even}", "COM3", {"baudrate": 9600, "parity": "E"}),
        ("{type: serial, port: COM3, method: ascii}", "COM3", {"framing": "ascii"}),
        ("{type: tcp, host: 10.0.0.7, port: 1502}", "modbus-tcp://10.0.0.7:1502", {}),
        ("{type: rtuovertcp, host: gate, port: 4001}", "socket://gate:4001", {}),
    ],
)
def test_home_assistant_hub_gives_port_and_line_settings(tmp_path, where, port, options):
    path = tmp_path / "hub.yaml"
    path.write_text(HUB.format(where=where.strip("{}").replace(", ", "\n    ")), encoding="utf-8")
    found = read_foreign(path)
    assert (found.port, found.options) == (port, options)


def test_invalid_line_setting_is_listed(tmp_path):
    path = tmp_path / "hub.yaml"
    path.write_text(HUB.format(where="type: serial\n    port: COM3\n    baudrate: fast"), encoding="utf-8")
    found = read_foreign(path)
    assert not found.options
    assert str(found.left[0]) == "modbus[0]: baudrate fast: not a line setting of a Modbus drive"


@pytest.mark.parametrize(
    ("mode", "port"),
    [("", "modbus-tcp://10.0.0.7:1502"), ('transmission_mode = "RTUoverTCP"', "socket://10.0.0.7:1502")],
)
def test_telegraf_controller_gives_the_port(tmp_path, mode, port):
    path = tmp_path / "t.conf"
    path.write_text(
        f'[[inputs.modbus]]\ncontroller = "tcp://10.0.0.7:1502"\n{mode}\ncoils = [{{ name = "run", address = [1] }}]\n',
        encoding="utf-8",
    )
    assert read_foreign(path).port == port


def test_second_line_in_a_file_is_left_out_and_listed(tmp_path):
    path = tmp_path / "t.conf"
    section = (
        '[[inputs.modbus]]\nslave_id = 1\ncontroller = "tcp://{host}:502"\n'
        'coils = [{{ name = "run", address = [{at}] }}]\n'
    )
    path.write_text(section.format(host="a", at=1) + section.format(host="b", at=2), encoding="utf-8")
    found = read_foreign(path)
    assert [each.number for each in found.registers] == [1]
    assert found.left[0].reason.startswith("another line")
