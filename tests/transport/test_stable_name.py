"""Stable names under which a port can be reopened."""

from __future__ import annotations

import pytest

from drivecomm.transport import SerialPort, stable_name


@pytest.fixture
def machine(tmp_path):
    """Return the folders of two adapters, one with two udev names, and of a name whose adapter is missing."""
    by_id = tmp_path / "serial" / "by-id"
    by_id.mkdir(parents=True)
    for name in ("ttyUSB0", "ttyUSB1"):
        (tmp_path / name).write_text("")
    (by_id / "usb-B-if00").symlink_to("../../ttyUSB0")
    (by_id / "usb-A-if00").symlink_to("../../ttyUSB0")
    (by_id / "usb-C-if00").symlink_to("../../ttyUSB7")
    return tmp_path, by_id


def test_adapter_with_several_names_gets_the_first_one(machine):
    folder, by_id = machine
    assert stable_name(str(folder / "ttyUSB0"), by_id) == str(by_id / "usb-A-if00")


def test_adapter_without_a_name_keeps_its_device_path(machine):
    folder, by_id = machine
    (by_id / "usb-C-if00").unlink()
    assert stable_name(str(folder / "ttyUSB1"), by_id) == str(folder / "ttyUSB1")


def test_dangling_name_hides_no_other(machine):
    folder, by_id = machine
    (by_id / "usb-0-if00").symlink_to("../../ttyUSB7")
    assert stable_name(str(folder / "ttyUSB0"), by_id) == str(by_id / "usb-A-if00")


def test_chosen_link_is_kept(machine):
    folder, by_id = machine
    (folder / "pump-line").symlink_to("ttyUSB0")
    for chosen in (folder / "pump-line", by_id / "usb-B-if00"):
        assert stable_name(str(chosen), by_id) == str(chosen)


def test_missing_folder_or_port_keeps_the_given_path(machine):
    folder, by_id = machine
    assert stable_name(str(folder / "ttyUSB0"), folder / "nothing") == str(folder / "ttyUSB0")
    assert stable_name(str(folder / "ttyUSB9"), by_id) == str(folder / "ttyUSB9")


@pytest.mark.parametrize("url", ["socket://10.0.0.9:4001", "rfc2217://plant:4001", "loop://"])
def test_url_is_its_own_stable_name(url, machine):
    assert stable_name(url, machine[1]) == url


def test_port_has_the_stable_name_of_its_device(monkeypatch, tmp_path, terminal):
    (tmp_path / "usb-A-if00").symlink_to(terminal)
    monkeypatch.setattr("drivecomm.transport.serial_port.stable_name", lambda url: stable_name(url, tmp_path))
    port = SerialPort(terminal)
    assert port.url == terminal
    assert port.stable_name == str(tmp_path / "usb-A-if00")
    port.close()
    again = SerialPort(port.stable_name)
    assert again.stable_name == port.stable_name
    again.close()
