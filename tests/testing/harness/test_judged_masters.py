"""Masters in plain pyserial that violate a rule of the line: assertions of fixtures, traces and reports."""

import os
import re
import time
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
import serial

import drivecomm
from drivecomm.errors import FileFormatError, NoReplyError, UsageError
from drivecomm.plant import PowerCutStep

pytest_plugins = ["pytester"]

needs_pty = pytest.mark.skipif(os.name != "posix", reason="this system has no pseudo-terminals")

ENQUIRY = b"\x04A00481\x05"


def opened(port, **settings):
    return serial.serial_for_url(port, **{"baudrate": 19200, "bytesize": 7, "parity": "E", "timeout": 0.5, **settings})


def rules(drive):
    return [(each.rule, each.demanded) for each in drive.violations]


@needs_pty
def test_assert_timing_fails_for_a_request_before_the_reply(lines):
    drive = lines.drive("vabus:1", listen="pty", paced=True, reply_delay_s=0.2)
    with opened(drive.port) as port:
        port.write(ENQUIRY)
        drive.assert_received(times=1)
        port.write(b"\x04A00480\x05")
        assert len(port.read(19)) == 19
    assert rules(drive) == [("reply not awaited", True)]
    with pytest.raises(
        AssertionError, match=r"the next request began .* may take 500 ms \(ACT/ACU Modbus manual p. 35"
    ):
        drive.assert_timing()
    drive.assert_settings()
    assert re.search(
        r"parameter=480  \[vabus:1: the next request began .* with 20 ms of tolerance\)\]", drive.line.trace()
    )
    drive.forget_received()
    drive.assert_timing()


@needs_pty
def test_gap_beyond_a_default_is_only_a_note(lines):
    drive = lines.drive("vabus:1", listen="pty")
    with opened(drive.port) as port:
        for each in ENQUIRY:
            port.write(bytes([each]))
            time.sleep(0.1)
    assert rules(drive) == [("gap in a telegram", False)]
    assert "[note: vabus:1: a request had a pause of " in drive.line.trace()
    drive.assert_timing(for_s=0)


@needs_pty
def test_assert_settings_fails_for_a_wrong_speed_on_a_terminal(lines):
    drive = lines.drive("vabus:1", listen="pty")
    with opened(drive.port, baudrate=1200, bytesize=8, parity="N") as port:
        port.write(ENQUIRY)
        # A pseudo-terminal has no wire, so the characters arrive despite the wrong speed.
        assert len(port.read(19)) == 19
    with pytest.raises(AssertionError, match="sent with 1200 baud and one stop bit, but the drive uses 19200 7E1"):
        drive.assert_settings()
    assert "a pseudo-terminal does not show data bits and parity, listen at rfc2217 for these" in drive.line.trace()


@needs_pty
def test_assert_settings_fails_for_two_stop_bits_on_a_terminal(lines):
    drive = lines.drive("vabus:1", listen="pty")
    with opened(drive.port, stopbits=2) as port:
        port.write(ENQUIRY)
        port.read(19)
    with pytest.raises(AssertionError, match="19200 baud and two stop bits"):
        drive.assert_settings()


@needs_pty
@pytest.mark.parametrize("settings", [{}, {"bytesize": 8, "parity": "N"}])
def test_assert_settings_ignores_parity_and_data_bits_on_a_terminal(lines, settings):
    drive = lines.drive("vabus:1", listen="pty")
    with opened(drive.port, **settings) as port:
        port.write(ENQUIRY)
        port.read(19)
    drive.assert_settings()


@needs_pty
def test_unconfigured_terminal_is_not_a_violation(lines):
    drive = lines.drive("vabus:1", listen="pty")
    with Path(drive.port).open("r+b", buffering=0) as port:
        port.write(ENQUIRY)
        drive.assert_received(times=1)
    drive.assert_settings()
    assert not drive.violations


@pytest.mark.filterwarnings("ignore::DeprecationWarning:serial")
def test_assert_settings_fails_for_wrong_parity_over_rfc2217(lines):
    drive = lines.drive("vabus:1", listen="rfc2217")
    with opened(drive.port, bytesize=8, parity="N") as port:
        port.write(ENQUIRY)
        port.read(19)
    with pytest.raises(AssertionError, match=r"sent with 19200 8N1, but the drive uses 19200 7E1 \(VABus short"):
        drive.assert_settings()


def test_assert_settings_is_refused_over_plain_tcp(lines):
    drive = lines.drive("vabus:1", listen="tcp")
    with pytest.raises(UsageError, match='make the line with listen="rfc2217"'):
        drive.assert_settings()


def test_drivecomm_as_master_violates_no_rule(lines, plugin):
    drive = lines.drive(f"{plugin.name}:{plugin.scan_addresses[0]}")
    with drivecomm.open_bus(drive.port) as bus:
        asked = bus.drive(plugin.name, plugin.scan_addresses[0], model=plugin.default_model)
        for _ in range(3):
            asked.read(plugin.parameter_examples[0])
    drive.assert_timing()
    drive.assert_settings()
    assert not drive.violations


def test_needs_pause_is_checked_and_simulated(lines):
    drive = lines.drive("vabus:1", needs_pause_s=0.5)
    with drivecomm.open_bus(drive.port) as bus:
        asked = bus.drive("vabus", 1, attempts=1)
        asked.read("481")
        with pytest.raises(NoReplyError):
            asked.read("481")
    with pytest.raises(AssertionError, match=r"it must leave 500 ms \(set for this drive\)"):
        drive.assert_timing()


def test_line_accepts_plant_file_keys_as_drive_options(lines):
    line = lines.line(["lecom:1,needs_pause_s=0.01,reply_delay_s=0.3"])
    with drivecomm.open_bus(line.port) as bus, pytest.raises(NoReplyError):
        bus.drive("lecom", 1, model="lenze-82xx", attempts=1).status()
    with pytest.raises(UsageError, match="invalid needs_pause_s = 'long'"):
        lines.drive("vabus:1", needs_pause_s="long")
    drive = lines.drive("vabus:1", values={"480": 1234}, motor={"rated_hz": 60})
    assert (drive.holds("480"), drive.motor.rated_hz) == ("000004D2", 60)


@pytest.mark.parametrize(
    "faults",
    [
        {"kind": "drop", "of": "reply to a read", "every": 2},
        [{"kind": "drop", "of": "reply to a read", "every": 2, "drive": "vabus:1"}],
        'kind = "drop", of = "reply to a read", every = 2',
        'kind = "drop"\nof = "reply to a read"\nevery = 2 # lines as in a file\n',
    ],
)
def test_fixtures_accept_faults_as_in_a_plant_file(lines, faults):
    drive = lines.drive("vabus:1", faults=faults)
    answers = []
    with drivecomm.open_bus(drive.port) as bus:
        asked = bus.drive("vabus", 1, model="agile", attempts=1)
        for _ in range(4):
            try:
                answers.append(bool(asked.read("481")))
            except NoReplyError:
                answers.append(False)
        asked.write("480", 12)
    assert answers == [True, False, True, False]
    assert "fault: drop of reply to a read, every 2; happened: 2 of 4" in dict(lines.traces()).popitem()[1]


def test_power_cut_applies_to_the_only_drive_of_a_line(lines):
    for cut in ({"power": {"off_at_s": 5}}, PowerCutStep(drive="vabus:1", off_at_s=5)):
        drive = lines.drive("vabus:1", faults=cut)
        with drivecomm.open_bus(drive.port) as bus:
            bus.drive("vabus", 1).read("481")
            drive.line.advance(6)
            with pytest.raises(NoReplyError):
                bus.drive("vabus", 1).read("481")


@pytest.mark.parametrize(
    "wrong", [[3], {"kind": "dropp"}, {"kind": "drop", "evry": 3}, "kind = ", {"power": {"off_at_s": -1}}]
)
def test_invalid_fault_is_refused(lines, wrong):
    with pytest.raises((UsageError, FileFormatError)):
        lines.drive("vabus:1", faults=wrong)


def test_junit_xml_of_a_failed_test_contains_seed_and_trace(run_pytest, pytester):
    text = """
        import drivecomm
        def test_fails(virtual_drive):
            drive = virtual_drive("vabus:1", faults=0.0)
            with drivecomm.open_bus(drive.port) as bus:
                bus.drive("vabus", 1).read("481")
            assert False
        def test_passes(virtual_drive):
            virtual_drive("vabus:1")
    """
    run_pytest(text, "--junitxml=report.xml", "--drivecomm-seed=7")
    cases = ET.parse(pytester.path / "report.xml").getroot().iter("testcase")
    properties = {
        case.get("name"): {each.get("name"): each.get("value") for each in case.iter("property")} for case in cases
    }
    assert properties["test_passes"] == {}
    assert properties["test_fails"]["drivecomm-seed"] == "7"
    assert "enquiry address=1 sys=0 dataset=0 parameter=481" in properties["test_fails"]["drivecomm-trace"]
