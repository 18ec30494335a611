"""Which name a port is opened by again."""

from __future__ import annotations

import pytest

from drivecomm.transport import SerialPort, stable_name


@pytest.fixture
def machine(tmp_path):
    """Two adapters, one of which udev has given two names, and a name whose adapter has gone."""
    by_id = tmp_path / "serial" / "by-id"
    by_id.mkdir(parents=True)
    for name in ("ttyUSB0", "ttyUSB1"):
        (tmp_path / name).write_text("")
    (by_id / "usb-B-if00").symlink_to("../../ttyUSB0")
    (by_id / "usb-A-if00").symlink_to("../../ttyUSB0")
    (by_id / "usb-C-if00").symlink_to("../../ttyUSB7")
    return tmp_path, by_id


def test_an_adapter_with_names(machine):
    folder, by_id = machine
    assert stable_name(str(folder / "ttyUSB0"), by_id) == str(by_id / "usb-A-if00")


def test_an_adapter_without(machine):
    folder, by_id = machine
    (by_id / "usb-C-if00").unlink()
    assert stable_name(str(folder / "ttyUSB1"), by_id) == str(folder / "ttyUSB1")


def test_a_name_that_leads_nowhere_hides_no_other(machine):
    folder, by_id = machine
    (by_id / "usb-0-if00").symlink_to("../../ttyUSB7")
    assert stable_name(str(folder / "ttyUSB0"), by_id) == str(by_id / "usb-A-if00")


def test_a_link_was_chosen(machine):
    folder, by_id = machine
    (folder / "pump-line").symlink_to("ttyUSB0")
    for chosen in (folder / "pump-line", by_id / "usb-B-if00"):
        assert stable_name(str(chosen), by_id) == str(chosen)


def test_no_such_folder_or_port(machine):
    folder, by_id = machine
    assert stable_name(str(folder / "ttyUSB0"), folder / "nothing") == str(folder / "ttyUSB0")
    assert stable_name(str(folder / "ttyUSB9"), by_id) == str(folder / "ttyUSB9")


@pytest.mark.parametrize("url", ["socket://10.0.0.9:4001", "rfc2217://plant:4001", "loop://"])
def test_a_url_stays(url, machine):
    assert stable_name(url, machine[1]) == url


def test_a_port_knows_its_name(monkeypatch, tmp_path, terminal):
    (tmp_path / "usb-A-if00").symlink_to(terminal)
    monkeypatch.setattr("drivecomm.transport.serial_port.stable_name", lambda url: stable_name(url, tmp_path))
    port = SerialPort(terminal)
    assert port.url == terminal
    assert port.stable_name == str(tmp_path / "usb-A-if00")
    port.close()
    again = SerialPort(port.stable_name)
    assert again.stable_name == port.stable_name
    again.close()
