"""Low latency, RS-485 direction control and the report of a port, without the hardware."""

from __future__ import annotations

import fcntl
import sys
import termios
import types

import pytest
import serial

import drivecomm
from drivecomm.transport import PortReport, SerialPort, UsbIdentity, direction, latency, local_report, port_report

linux = pytest.mark.skipif(sys.platform != "linux", reason="the requests are Linux's")

FTDI = types.SimpleNamespace(
    device="/dev/ttyUSB0", vid=0x0403, pid=0x6001, manufacturer="FTDI", product="FT232R", serial_number="A1"
)


class Driver:
    """A kernel driver behind a pyserial port, which answers the requests TIOCxSERIAL and TIOCxRS485."""

    def __init__(self, monkeypatch, *, flags=None, follows=True, rs485=None):
        self.flags = flags
        self.follows = follows
        self.rs485 = rs485
        monkeypatch.setattr(fcntl, "ioctl", self.answer)

    def fileno(self):
        return 0

    def set_low_latency_mode(self, on):
        assert on is True
        if self.flags is None:
            raise ValueError("Failed to update ASYNC_LOW_LATENCY flag")
        if self.follows:
            self.flags |= 0x2000

    @property
    def rs485_mode(self):
        raise AssertionError

    @rs485_mode.setter
    def rs485_mode(self, settings):
        assert settings.rts_level_for_tx
        assert not settings.loopback
        if self.rs485 is None:
            raise ValueError("Failed to set RS485 mode: Inappropriate ioctl for device")
        if self.follows:
            self.rs485 = 1

    def answer(self, _, request, words):
        if request == termios.TIOCGSERIAL and self.flags is not None:
            words[4] = self.flags
        elif request == 0x542E and self.rs485 is not None:
            words[0] = self.rs485
        else:
            raise OSError(25, "Inappropriate ioctl for device")


@pytest.fixture
def sysfs(tmp_path):
    """Return a sysfs folder with ttyUSB0, which has a latency timer, and ttyS0, which has none."""
    for name, driver in (("ttyUSB0", "ftdi_sio"), ("ttyS0", "serial8250")):
        (tmp_path / "drivers" / driver).mkdir(parents=True)
        (tmp_path / name / "device").mkdir(parents=True)
        (tmp_path / name / "device" / "driver").symlink_to(tmp_path / "drivers" / driver)
    (tmp_path / "ttyUSB0" / "device" / "latency_timer").write_text("16\n")
    return tmp_path


@linux
class TestLowLatency:
    def test_low_latency_is_set_by_the_flag(self, monkeypatch, sysfs):
        driver = Driver(monkeypatch, flags=0)
        assert latency.low_latency(driver, "/dev/ttyS0", sysfs) == "off"
        assert latency.enable_low_latency(driver, "/dev/ttyS0", sysfs)
        assert driver.flags == 0x2000
        assert latency.low_latency(driver, "/dev/ttyS0", sysfs) == "on"

    def test_low_latency_is_set_by_the_file_if_the_flag_is_unknown(self, monkeypatch, sysfs):
        driver = Driver(monkeypatch)
        assert latency.low_latency(driver, "/dev/ttyUSB0", sysfs) == "off"
        assert latency.enable_low_latency(driver, "/dev/ttyUSB0", sysfs)
        assert (sysfs / "ttyUSB0" / "device" / "latency_timer").read_text() == "1"
        assert latency.low_latency(driver, "/dev/ttyUSB0", sysfs) == "on"

    @pytest.mark.parametrize(("timer_ms", "is_low"), [(0, "on"), (1, "on"), (2, "off"), (8, "off")])
    def test_latency_timer_is_low_up_to_one_millisecond(self, sysfs, monkeypatch, timer_ms, is_low):
        (sysfs / "ttyUSB0" / "device" / "latency_timer").write_text(f"{timer_ms}\n")
        assert latency.low_latency(Driver(monkeypatch), "/dev/ttyUSB0", sysfs) == is_low

    def test_driver_that_ignores_the_low_latency_flag_is_detected(self, monkeypatch, sysfs):
        driver = Driver(monkeypatch, flags=0, follows=False)
        assert not latency.enable_low_latency(driver, "/dev/ttyS0", sysfs)
        with pytest.raises(
            drivecomm.PortError, match=r"port /dev/ttyS0 has no low-latency mode .* without low_latency"
        ):
            latency.require_low_latency(driver, "/dev/ttyS0", sysfs)

    def test_latency_file_without_write_permission_leaves_latency_unchanged(self, monkeypatch, sysfs):
        def refuse(*_):
            raise PermissionError

        monkeypatch.setattr("pathlib.Path.write_text", refuse)
        assert not latency.enable_low_latency(Driver(monkeypatch), "/dev/ttyUSB0", sysfs)

    def test_low_latency_is_unknown_without_flag_and_file(self, monkeypatch, sysfs):
        driver = Driver(monkeypatch)
        assert not latency.enable_low_latency(driver, "/dev/ttyS0", sysfs)
        assert latency.low_latency(driver, "/dev/ttyS0", sysfs) == "unknown"

    def test_low_latency_is_unknown_on_other_systems(self, monkeypatch, sysfs):
        driver = Driver(monkeypatch, flags=0x2000)
        monkeypatch.setattr(sys, "platform", "darwin")
        assert latency.low_latency(driver, "/dev/ttyS0", sysfs) == "unknown"


@linux
class TestDirection:
    def test_rs485_is_switched_on_by_a_capable_driver(self, monkeypatch):
        driver = Driver(monkeypatch, rs485=0)
        assert direction.direction(driver) == "off"
        direction.switch_on(driver, "/dev/ttyS0")
        assert direction.direction(driver) == "on"

    def test_rs485_is_refused_by_a_driver_without_it(self, monkeypatch):
        driver = Driver(monkeypatch)
        assert direction.direction(driver) == "unsupported"
        with pytest.raises(
            drivecomm.PortError, match=r"driver of port /dev/ttyS0 .*Inappropriate ioctl.*without rs485"
        ):
            direction.switch_on(driver, "/dev/ttyS0")

    def test_driver_that_ignores_the_rs485_request_is_detected(self, monkeypatch):
        with pytest.raises(drivecomm.PortError, match="it ignores the request"):
            direction.switch_on(Driver(monkeypatch, rs485=0, follows=False), "/dev/ttyS0")

    def test_rs485_is_unsupported_on_other_systems(self, monkeypatch):
        driver = Driver(monkeypatch, rs485=1)
        monkeypatch.setattr(sys, "platform", "win32")
        assert direction.direction(driver) == "unsupported"


class TestOptions:
    @pytest.mark.parametrize("option", [{"rs485": True}, {"low_latency": True}], ids=["rs485", "low_latency"])
    def test_unsupported_option_is_refused_and_the_port_closed(self, terminal, option):
        with pytest.raises(drivecomm.PortError, match=f"{terminal}.*without {next(iter(option))}"):
            SerialPort(terminal, **option)
        SerialPort(terminal, low_latency=False).close()

    @pytest.mark.parametrize("option", ["rs485", "low_latency"])
    @pytest.mark.parametrize("url", ["socket://127.0.0.1:1", "rfc2217://127.0.0.1:1", "loop://"])
    def test_remote_port_refuses_rs485_and_low_latency(self, url, option):
        with pytest.raises(drivecomm.UsageError, match=f"{option} is for ports of this machine, and {url} is not one"):
            SerialPort(url, **{option: True})

    @pytest.mark.parametrize(("wanted", "asked"), [(None, [True]), (True, [True]), (False, [])])
    def test_low_latency_is_requested_unless_it_is_switched_off(self, terminal, monkeypatch, wanted, asked):
        requests = []
        monkeypatch.setattr(serial.Serial, "set_low_latency_mode", lambda _, on: requests.append(on))
        monkeypatch.setattr(latency, "low_latency", lambda *_: "on")
        SerialPort(terminal, low_latency=wanted).close()
        assert requests == asked


@linux
class TestReport:
    def test_report_describes_an_adapter(self, monkeypatch, sysfs):
        monkeypatch.setattr(port_report.list_ports, "comports", lambda: [FTDI])
        monkeypatch.setattr(port_report, "stable_name", lambda _: "/dev/serial/by-id/usb-FTDI-A1")
        report = local_report(Driver(monkeypatch), "/dev/ttyUSB0", pseudo=False, sysfs=sysfs)
        assert report == PortReport(
            url="/dev/ttyUSB0",
            kind="serial port",
            driver="ftdi_sio",
            usb=UsbIdentity(vendor=0x0403, product=0x6001, maker="FTDI", name="FT232R", serial_number="A1"),
            stable_name="/dev/serial/by-id/usb-FTDI-A1",
            low_latency="off",
            latency_timer_ms=16,
            notes=("the adapter holds received bytes back for up to 16 ms; low-latency mode is not on",),
        )
        assert str(report.usb) == "0403:6001 FTDI FT232R A1"

    def test_report_of_an_adapter_without_a_serial_number_notes_it(self, monkeypatch, sysfs):
        nameless = types.SimpleNamespace(
            device="/dev/ttyUSB0", vid=0x1A86, pid=0x7523, manufacturer=None, product="USB Serial", serial_number=None
        )
        monkeypatch.setattr(port_report.list_ports, "comports", lambda: [nameless])
        report = local_report(Driver(monkeypatch, flags=0x2000), "/dev/ttyUSB0", pseudo=False, sysfs=sysfs)
        assert str(report.usb) == "1a86:7523 USB Serial"
        assert "no serial number" in report.notes[-1]

    def test_report_describes_an_on_board_port(self, monkeypatch, sysfs):
        monkeypatch.setattr(port_report.list_ports, "comports", lambda: [FTDI])
        report = local_report(Driver(monkeypatch, flags=0x2000, rs485=1), "/dev/ttyS0", pseudo=False, sysfs=sysfs)
        assert (report.driver, report.usb, report.low_latency, report.rs485) == ("serial8250", None, "on", "on")
        assert report.notes == ()

    @pytest.mark.parametrize(("written", "notes"), [("Y\n", 1), ("N\n", 0)])
    def test_report_notes_a_port_used_as_kernel_console(self, monkeypatch, sysfs, written, notes):
        (sysfs / "ttyS0" / "console").write_text(written)
        monkeypatch.setattr(port_report.list_ports, "comports", list)
        report = local_report(Driver(monkeypatch), "/dev/ttyS0", pseudo=False, sysfs=sysfs)
        assert [note for note in report.notes if "the kernel writes its messages" in note] == list(report.notes)
        assert len(report.notes) == notes

    def test_port_missing_in_sysfs_has_a_report_with_unknowns(self, monkeypatch, tmp_path):
        monkeypatch.setattr(port_report.list_ports, "comports", list)
        report = local_report(Driver(monkeypatch), "/dev/ttyS9", pseudo=False, sysfs=tmp_path)
        assert (report.driver, report.low_latency, report.latency_timer_ms) == ("", "unknown", None)


@pytest.mark.soak
@pytest.mark.parametrize(
    ("kind", "told"), [("pty", "pseudo-terminal"), ("tcp", "raw TCP"), ("rfc2217", "RFC 2217"), ("loop", "other")]
)
def test_every_kind_of_port_has_a_report(kind, told, serving):
    if kind == "loop":
        port = SerialPort("loop://")
        assert port.report().kind == told
        port.close()
        return
    with serving([], kind) as server:
        port = SerialPort(server.address)
        report = port.report()
        assert (report.kind, report.url, report.stable_name) == (told, server.address, server.address)
        port.close()
