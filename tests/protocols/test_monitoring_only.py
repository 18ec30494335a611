"""Monitoring-only series, whose models have no commands: they can be read, and nothing that could command is sent."""

import pytest
from gauge_series import GAUGE

import drivecomm
from drivecomm.errors import NotSupported
from drivecomm.models import is_monitoring_only, load_model, model_names
from drivecomm.protocol import DriveState, Stop, installed
from drivecomm.virtual import VirtualLine, virtual_drive


@pytest.fixture
def gauge(tmp_path):
    """Yield a monitoring-only drive, its virtual drive and the events of the bus."""
    path = tmp_path / "gauge.toml"
    path.write_text(GAUGE, encoding="utf-8")
    virtual = virtual_drive("modbus", 1, model=str(path))
    line, sent = VirtualLine([virtual]), []
    with drivecomm.open_bus(line.port, trace=sent.append) as bus:
        yield bus.drive("modbus", 1, model=str(path)), virtual, sent


def test_monitoring_only_drive_can_be_read(gauge):
    drive, virtual, _ = gauge
    virtual.motor.run(20, 0.0)
    assert drive.status().state is DriveState.RUNNING
    assert drive.read("output_frequency").unit == "Hz"
    virtual.trip(3, 0.0)
    assert drive.status().fault


@pytest.mark.parametrize(
    "command",
    [
        lambda drive: drive.start(),
        lambda drive: drive.start(reverse=True),
        lambda drive: drive.reverse(),
        lambda drive: drive.stop(),
        lambda drive: drive.stop(Stop.COAST),
        lambda drive: drive.reset(),
        lambda drive: drive.set_reference(hz=20),
        lambda drive: drive.set_reference(percent=20),
        lambda drive: drive.write("0x2000", 1),
        lambda drive: drive.write("8192", 1),
        lambda drive: drive.write("bus_control_word", 1),
        lambda drive: drive.write("bus_frequency", 20),
        lambda drive: drive.write_and_read("bus_control_word", 1),
    ],
)
def test_command_to_a_monitoring_only_drive_is_refused_unsent(gauge, command):
    drive, virtual, sent = gauge
    with pytest.raises(NotSupported, match="monitoring only"):
        command(drive)
    assert not sent
    assert virtual.peek("0x2000", 0.0) == 0


def test_monitoring_only_drive_accepts_settings(gauge):
    drive, _, _ = gauge
    drive.write("acceleration_time", 7)
    assert float(drive.read("acceleration_time").value) == 7


def test_capabilities_show_that_a_drive_is_monitoring_only(gauge):
    can = gauge[0].capabilities
    assert can.monitoring_only
    assert not can.stops
    assert (can.reverse, can.reference_hz, can.reference_percent) == (False, False, False)


def test_write_to_an_unlisted_register_of_a_monitoring_only_drive_counts_as_a_start(gauge):
    drive, _, _ = gauge
    assert drive.may_start("write", parameter="0x2002", value=1)
    assert not drive.may_start("write", parameter="0x0010", value=1)


def test_broadcast_stop_of_a_monitoring_only_series_is_refused(gauge):
    drive, _, sent = gauge
    with pytest.raises(NotSupported, match="monitoring only"):
        drive.bus.broadcast("modbus", model=drive.model).stop()
    assert not sent


def test_packaged_model_is_monitoring_only_if_it_has_no_commands():
    for name in model_names("drivecomm_modbus", "modbus"):
        model = load_model("drivecomm_modbus", "modbus", name)
        orders = {"start", "start_reverse", "stop", "coast", "quick", "dc_brake", "reset"} & model.control.keys()
        assert is_monitoring_only(installed["modbus"], model) is not bool(orders), name


@pytest.mark.parametrize("written", ["0x3000", "actual_frequency", "0x0010", "0x2002", "c5"])
def test_drive_with_imported_registers_refuses_every_write(written, tmp_path):
    path = tmp_path / "gauge.toml"
    path.write_text(GAUGE.replace('access = "r"', 'access = "r"\nsure = "imported"'), encoding="utf-8")
    sent = []
    with drivecomm.open_bus(VirtualLine([virtual_drive("modbus", 1, model=str(path))]).port, trace=sent.append) as bus:
        drive = bus.drive("modbus", 1, model=str(path))
        for write in (drive.write, drive.write_and_read):
            with pytest.raises(NotSupported, match="monitoring only"):
                write(written, 1)
        assert drive.may_start("write", parameter=written, value=1)
        assert not sent
        assert "imported" in drive.read("0x3000").note


# No source says how LECOM, WEG and EI Bisynch drives, Unidrive Classic, newer LS and VF-S15 are commanded.
SOME_MONITORED = ("ct-ansi", "ei-bisynch", "lecom", "ls-bus", "modbus", "toshiba", "weg")


@pytest.mark.parametrize("protocol", [name for name in installed if name not in SOME_MONITORED])
def test_series_of_a_commanded_protocol_are_not_monitoring_only(protocol):
    plugin = installed[protocol]
    for name in model_names(plugin.package, protocol):
        assert not is_monitoring_only(plugin, load_model(plugin.package, protocol, name)), name
