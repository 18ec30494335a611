"""Watched lines and drives in virtual and real time: received telegrams, held values, and failure messages."""

import os
import socket
import threading
import time
from contextlib import contextmanager
from decimal import Decimal

import pytest
from benches import COMMANDED

import drivecomm
from drivecomm.errors import ParameterAddressError, PortError, UsageError
from drivecomm.models import load_model
from drivecomm.plant import FaultPlan, LineFault
from drivecomm.protocol import LineSettings
from drivecomm.testing import LineMaker

needs_pty = pytest.mark.skipif(os.name != "posix", reason="this system has no pseudo-terminals")

VABUS = LineSettings(baudrate=19200, bytesize=7, parity="E")
ENQUIRY = bytes.fromhex("04 41 30 30 34 38 31 05")
VALUE = bytes.fromhex("41 02 30 30 34 38 31 30 38 30 30 30 30 30 33 45 38 03 48")


@contextmanager
def connected(port):
    host, _, number = port.partition("://")[2].partition(":")
    with socket.create_connection((host, int(number)), timeout=5) as master:
        master.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        yield master


def received_from(master, length):
    data = b""
    while len(data) < length:
        data += master.recv(length - len(data)) or pytest.fail("the line was closed")
    return data


class TestReceived:
    def test_received_has_fields_and_times_of_the_drives_telegrams(self, lines):
        line = lines.line(["vabus:1", "vabus:2", "danfoss-fc:3"])
        with drivecomm.open_bus(line.port) as bus:
            bus.drive("vabus", 1, model="agile").read("481")
            bus.drive("vabus", 2, model="agile").write("480", 12)
            bus.drive("danfoss-fc", 3, model="fc300").read("16-14")
        first, second, third = line.drives
        assert [each.fields for each in first.received] == [
            {"kind": "enquiry", "address": 1, "sys": 0, "dataset": 0, "parameter": 481}
        ]
        assert first.received[0].data == ENQUIRY
        assert first.received[0].time_s == pytest.approx(VABUS.wire_s(len(ENQUIRY)), abs=0.05)
        assert [each.kind for each in second.received] == ["select"]
        assert [each.fields["pnu"] for each in third.received] == [1614]

    def test_broadcast_is_received_by_every_drive(self, lines, plugin):
        if plugin.name not in COMMANDED:
            pytest.skip("drives of this protocol are monitored only")
        if plugin.broadcast_address is None:
            pytest.skip("this protocol has no broadcast")
        addresses = [plugin.addresses[0], plugin.addresses[1]]
        line = lines.line([f"{plugin.name}:{address}" for address in addresses])
        with drivecomm.open_bus(line.port) as bus:
            bus.broadcast(plugin.name, model=plugin.default_model).stop()
        line.advance(1)
        # The LS stop for all drives takes three telegrams: stop, write enable, stop.
        for drive in line.drives:
            drive.assert_received(times=3 if plugin.name == "ls-bus" else 1)

    def test_replies_of_other_drives_are_not_received(self, lines, plugin):
        names = [f"{plugin.name}:{plugin.addresses[0]}", f"{plugin.name}:{plugin.addresses[1]}"]
        line = lines.line(names)
        with drivecomm.open_bus(line.port) as bus:
            bus.drive(plugin.name, plugin.addresses[0], model=plugin.default_model).read(plugin.parameter_examples[0])
        assert line.drive(names[0]).received
        assert not line.drive(names[1]).received

    def test_damaged_telegram_is_recorded_and_mentioned_in_the_failure(self, lines):
        drive = lines.drive("vabus:1")
        drive.line.virtual.configure(VABUS)
        drive.line.inject(bytes.fromhex("04 41 02 30 30 34 38 30 30 38 30 30 30 30 30 34 42 30 03 00"))
        drive.line.advance(1)
        assert [each.error.category for each in drive.damaged] == ["checksum"]
        with pytest.raises(AssertionError, match="no select telegram, but it heard 1 damaged ones"):
            drive.assert_received(kind="select")

    def test_forget_received_clears_earlier_telegrams(self, lines):
        drive = lines.drive("vabus:1")
        with drivecomm.open_bus(drive.port) as bus:
            pump = bus.drive("vabus", 1, model="agile")
            pump.read("481")
            drive.forget_received()
            pump.read("480")
        assert [each.fields["parameter"] for each in drive.received] == [480]


class TestAssertReceived:
    @pytest.fixture
    def asked(self, lines):
        drive = lines.drive("vabus:1", model="agile")
        with drivecomm.open_bus(drive.port) as bus:
            pump = bus.drive("vabus", 1, model="agile")
            pump.write("480", 12)
            pump.read("481")
            pump.read("481")
        return drive

    def test_assert_received_passes_for_received_telegrams(self, asked):
        asked.assert_received()
        asked.assert_received(kind="select", parameter=480, data="000004B0")
        asked.assert_received(kind="enquiry", times=2)
        asked.assert_received(kind="enquiry", parameter=482, times=0, within_s=0)
        asked.assert_nothing_received(parameter=482)

    def test_failure_names_the_closest_received_telegram(self, asked):
        with pytest.raises(AssertionError) as caught:
            asked.assert_received(kind="select", parameter=481)
        text = str(caught.value)
        assert text.startswith("vabus:1 received no select telegram with parameter=481\nclosest: ")
        assert "enquiry address=1 sys=0 dataset=0 parameter=481 (kind is 'enquiry', not 'select')" in text
        assert text.count("\n") == 5

    def test_failure_names_a_misspelt_field(self, asked):
        with pytest.raises(AssertionError, match=r"it has no paramter"):
            asked.assert_received(kind="select", paramter=480)

    def test_assert_received_fails_for_a_wrong_number_of_telegrams(self, asked):
        with pytest.raises(AssertionError, match=r"received 2 enquiry telegrams, and not 1:\n"):
            asked.assert_received(kind="enquiry", times=1)
        with pytest.raises(AssertionError, match=r"received 1 select telegram, and not 2:\n"):
            asked.assert_received(kind="select", times=2)

    def test_assert_nothing_received_fails_after_any_telegram(self, lines, asked):
        lines.drive("vabus:1").assert_nothing_received()
        with pytest.raises(AssertionError, match=r"received 3 telegrams:\n  0\."):
            asked.assert_nothing_received()

    def test_failure_lists_only_the_latest_telegrams(self, lines):
        drive = lines.drive("vabus:1")
        with drivecomm.open_bus(drive.port) as bus:
            for _ in range(25):
                bus.drive("vabus", 1).read("481")
        with pytest.raises(AssertionError, match=r"received 25 telegrams:\n  \(15 earlier ones are left out\)\n"):
            drive.assert_nothing_received()

    def test_fields_match_as_python_value_or_as_text(self, lines):
        drive = lines.drive("vlt3500:3")
        with drivecomm.open_bus(drive.port) as bus:
            bus.drive("vlt3500", 3, model="vlt3500").write("205", Decimal("42.5"))
        assert any(each.fields.get("value") == "42.5" for each in drive.received), drive.received
        drive.assert_received(value="42.5")
        drive.assert_received(value=Decimal("42.5"))

    def test_assert_received_advances_virtual_time_for_a_telegram_under_way(self, lines):
        drive = lines.drive("vabus:1")
        drive.line.virtual.configure(VABUS)
        drive.line.virtual.transmit(ENQUIRY)
        assert not drive.received
        drive.assert_received(kind="enquiry")


class TestHolds:
    def test_holds_returns_the_raw_value_of_a_reading(self, lines):
        drive = lines.drive("vabus:1", model="agile")
        assert drive.holds("481") == "000003E8"
        assert drive.holds("fixed_frequency_2") == "000003E8"
        drive.assert_holds("481", 1000)
        drive.assert_holds("481", "000003E8")
        with pytest.raises(AssertionError, match=r"vabus:1 holds '000003E8' in 481, and not 1001 \('000003E9'\)"):
            drive.assert_holds("481", 1001)

    def test_holds_raises_for_an_unknown_parameter(self, lines):
        drive = lines.drive("vabus:1")
        with pytest.raises(ParameterAddressError):
            drive.holds("1599")
        with pytest.raises(ParameterAddressError):
            drive.assert_holds("1599", 1)

    def test_assert_holds_compares_raw_numbers_in_every_protocol(self, lines, plugin):
        """A parameter that can be set to a number is held as that number, and as no other one."""
        drive = lines.drive(f"{plugin.name}:{plugin.addresses[0]}")
        model = load_model(plugin.package, plugin.name, plugin.default_model)
        tried = 0
        for parameter in model.parameters:
            try:
                before = drive.holds(parameter)
                drive.poke(parameter, 3)
                held = drive.holds(parameter)
            except (drivecomm.DriveCommError, ValueError):
                continue
            if held == before:
                continue
            tried += 1
            drive.assert_holds(parameter, 3)
            drive.assert_holds(parameter, held)
            with pytest.raises(AssertionError):
                drive.assert_holds(parameter, 4, within_s=0)
        assert tried > (10 if len(model.parameters) > 40 else 1)

    def test_assert_holds_compares_measured_values_without_conversion(self, lines):
        drive = lines.drive("vabus:1", model="agile")
        for wrong in (5, 0, "x"):
            with pytest.raises(AssertionError):
                drive.assert_holds("210", wrong, within_s=0)
        drive.assert_holds("210", "00000000")

    def test_assert_holds_waits_for_the_value(self, lines):
        drive = lines.drive("vabus:1", model="agile")
        with drivecomm.open_bus(drive.port) as bus:
            pump = bus.drive("vabus", 1, model="agile")
            pump.write("412", 1)
            pump.set_reference(hz=10)
            pump.start()
            drive.assert_holds("210", "000003E8", within_s=60)
        assert drive.motor.output_hz == pytest.approx(10)


class TestWhatHappens:
    def test_poke_and_trip_change_the_drive(self, lines):
        drive = lines.drive("vabus:1", model="agile")
        drive.poke("481", 2500)
        with drivecomm.open_bus(drive.port) as bus:
            pump = bus.drive("vabus", 1, model="agile")
            assert pump.read("481").value == Decimal(25)
            drive.trip(3)
            assert pump.status().fault_code == 3

    def test_power_off_silences_one_drive_until_power_on(self, lines):
        line = lines.line(["vabus:1", "vabus:2"])
        with drivecomm.open_bus(line.port) as bus:
            pumps = [bus.drive("vabus", address) for address in (1, 2)]
            line.drive("vabus:1").power_off()
            with pytest.raises(drivecomm.NoReplyError):
                pumps[0].read("481")
            pumps[1].read("481")
            line.drive("vabus:1").power_on()
            pumps[0].probe()
        assert line.now() == line.virtual.time > 1

    def test_power_off_loses_volatile_writes(self, lines):
        drive = lines.drive("danfoss-fc:3", model="fc300")
        with drivecomm.open_bus(drive.port) as bus:
            fan = bus.drive("danfoss-fc", 3, model="fc300")
            fan.write("3-41", 10)
            drive.assert_holds("3-41", 1000)
            drive.power_off()
            drive.power_on()
            drive.assert_holds("3-41", 300)

    def test_fault_plan_drops_every_telegram(self, lines):
        line = lines.line(["vabus:1"], faults=FaultPlan(rate=1.0, kinds=[LineFault.DROP]))
        with drivecomm.open_bus(line.port) as bus, pytest.raises(drivecomm.NoReplyError):
            bus.drive("vabus", 1).read("481")
        line.drive("vabus:1").assert_nothing_received()

    def test_unplugged_adapter_works_again_after_plug_in(self, lines):
        drive = lines.drive("vabus:1")
        with drivecomm.open_bus(drive.port) as bus:
            pump = bus.drive("vabus", 1)
            drive.line.unplug()
            with pytest.raises(drivecomm.LinkDownError):
                pump.read("481")
            drive.line.plug_in()
            drive.line.advance(10)
            pump.read("481")

    def test_call_at_runs_an_action_at_its_time(self, lines):
        drive = lines.drive("vabus:1")
        drive.line.call_at(5, lambda: drive.poke("481", 7))
        drive.assert_holds("481", 7, within_s=10)
        assert drive.line.now() == pytest.approx(5, abs=0.01)

    def test_line_with_echo_serves_a_master_with_echo(self, lines):
        drive = lines.drive("vabus:1", echo=True)
        with drivecomm.open_bus(drive.port, echo=True) as bus:
            bus.drive("vabus", 1).read("481")


class TestWhatCannotBe:
    def test_invalid_drive_names_are_refused(self, lines):
        line = lines.line(["vabus:1"])
        with pytest.raises(UsageError, match=r"no vabus:2 is on this line; there are vabus:1"):
            line.drive("vabus:2")
        with pytest.raises(UsageError, match="vabus:1 is on this line twice"):
            lines.line(["vabus:1", "vabus:1,model=act"])
        with pytest.raises(UsageError, match="is not a drive; write PROTOCOL:ADDRESS"):
            lines.drive("vabus")
        with pytest.raises(drivecomm.UnknownProtocolError):
            lines.drive("profibus:1")
        with pytest.raises(UsageError, match="no option 'modle'"):
            lines.drive("vabus:1", modle="act")

    def test_fault_rate_above_one_is_refused(self, lines):
        with pytest.raises(UsageError, match=r"from 0 to 1, and not 5"):
            lines.line([], faults=5)

    def test_invalid_or_used_listening_address_is_refused(self, lines):
        with pytest.raises(UsageError, match="cannot listen at 'com:1'"):
            lines.drive("vabus:1", listen="com:1")
        taken = lines.drive("vabus:1", listen="tcp").port.removeprefix("socket://")
        with pytest.raises(PortError, match="cannot listen at"):
            lines.drive("vabus:1", listen=f"tcp:{taken}")

    def test_served_line_refuses_actions_of_virtual_time(self, lines):
        drive = lines.drive("vabus:1", listen="tcp")
        for act in (
            drive.power_off,
            drive.power_on,
            drive.line.unplug,
            drive.line.plug_in,
            lambda: drive.line.inject(b"x"),
            lambda: drive.line.call_at(1, drive.power_off),
        ):
            with pytest.raises(UsageError, match="served in real time"):
                act()


class TestServed:
    def test_line_is_served_over_tcp(self, lines):
        drive = lines.drive("vabus:1", listen="tcp")
        with connected(drive.port) as master:
            master.sendall(ENQUIRY)
            assert received_from(master, len(VALUE)) == VALUE
        drive.assert_received(kind="enquiry", parameter=481, times=1)
        drive.assert_holds("481", 1000)

    @needs_pty
    def test_line_is_served_at_a_pseudo_terminal(self, lines):
        drive = lines.drive("vabus:1", listen="pty")
        with drivecomm.open_bus(drive.port) as bus:
            assert bus.drive("vabus", 1, model="agile").read("481").value == 10
        drive.assert_received(kind="enquiry")

    @pytest.mark.soak
    def test_line_with_two_protocols_is_served_over_rfc2217(self, lines):
        line = lines.line(["vabus:1", "danfoss-fc:3"], listen="rfc2217", echo=True)
        with drivecomm.open_bus(line.port, echo=True) as bus:
            bus.drive("vabus", 1).read("481")
            bus.drive("danfoss-fc", 3, model="fc300").read("16-14")
        assert [drive.received[0].kind for drive in line.drives] == ["enquiry", "parameter"]

    def test_assert_received_waits_for_a_late_telegram(self, lines):
        drive = lines.drive("vabus:1", listen="tcp")
        with connected(drive.port) as master:
            late = threading.Timer(0.2, master.sendall, [ENQUIRY])
            late.start()
            drive.assert_received(kind="enquiry")
            late.join()

    def test_assertions_on_a_served_line_end_in_time(self, lines):
        drive = lines.drive("vabus:1", listen="tcp")
        began = time.monotonic()
        drive.assert_nothing_received(for_s=0.05)
        with pytest.raises(AssertionError, match="nor anything else"):
            drive.assert_received(within_s=0.1)
        assert 0.15 <= time.monotonic() - began < 2

    def test_served_line_drops_requests(self, lines):
        plan = FaultPlan(rate=1.0, kinds=[LineFault.DROP])
        drive = lines.drive("vabus:1", listen="tcp", faults=plan)
        with connected(drive.port) as master:
            master.sendall(ENQUIRY)
            drive.assert_nothing_received()
        assert plan.happened == {LineFault.DROP: 1}

    def test_served_line_delays_replies(self, lines):
        drive = lines.drive(
            "vabus:1",
            listen="tcp",
            reply_delay_s=0.0,
            faults=FaultPlan(rate=1.0, kinds=[LineFault.DELAY], requests=False, delay_s=0.4, seed=1),
        )
        with connected(drive.port) as master:
            began = time.monotonic()
            master.sendall(ENQUIRY)
            assert received_from(master, len(VALUE)) == VALUE
            # Seed 1 draws a first delay longer than this.
            assert time.monotonic() - began > 0.05

    def test_served_line_duplicates_requests(self, lines):
        plan = FaultPlan(rate=1.0, kinds=[LineFault.DUPLICATE], replies=False)
        drive = lines.drive("vabus:1", listen="tcp", faults=plan)
        with connected(drive.port) as master:
            master.sendall(ENQUIRY)
            drive.assert_received(times=2)

    def test_served_line_injects_foreign_traffic(self, lines):
        plan = FaultPlan(rate=1.0, kinds=[LineFault.FOREIGN], traffic=[ENQUIRY], traffic_within_s=0.05)
        line = lines.line(["vabus:1", "fuji:7"], listen="tcp", faults=plan)
        with connected(line.port) as master:
            master.sendall(b"\0")
            line.drive("vabus:1").assert_received(kind="enquiry")
            assert ENQUIRY in received_from(master, len(ENQUIRY))
        assert "??  04 41 30 30 34 38 31 05  enquiry" in line.trace()

    def test_received_telegrams_stay_after_close(self, lines):
        drive = lines.drive("vabus:1", listen="tcp")
        with connected(drive.port) as master:
            master.sendall(ENQUIRY)
            drive.assert_received()
        drive.line.close()
        with pytest.raises(ConnectionError), connected(drive.port):
            pass
        assert len(drive.received) == 1

    def test_poke_works_while_the_line_is_served(self, lines):
        drive = lines.drive("vabus:1", listen="tcp", reply_delay_s=0.0, model="agile")
        with connected(drive.port) as master:
            for number in range(100):
                drive.poke("481", number)
                master.sendall(ENQUIRY)
                assert int(received_from(master, len(VALUE))[9:17], 16) == number


class TestTrace:
    def test_trace_joins_pieces_and_marks_damage(self, lines):
        line = lines.line(["vabus:1,gap_s=1"], listen="tcp")
        with connected(line.port) as master:
            master.sendall(ENQUIRY[:3])
            time.sleep(0.01)
            master.sendall(ENQUIRY[3:])
            received_from(master, len(VALUE))
            master.sendall(b"\x04\x41\x02\x30\x30\x34\x38\x30\x30\x38\x30\x30\x30\x30\x30\x34\x42\x30\x03\x00")
            received_from(master, 2)
            master.sendall(b"hello")
            assert line.comes_about(lambda: "no telegram" in line.trace(), 2.0)
        shown = [row.split("  ", 1)[1].split("  ") for row in map(str.strip, line.trace().splitlines())]
        assert shown[0] == ["->", "04 41 30 30 34 38 31 05", "enquiry address=1 sys=0 dataset=0 parameter=481"]
        assert shown[1][0] == "<-"
        assert shown[2][2].startswith("[damaged: ")
        assert shown[3][2].startswith("nak")
        assert shown[4] == ["->", "68 65 6C 6C 6F", "[no telegram]"]

    def test_trace_marks_wrong_line_settings(self, lines):
        line = lines.line(["vabus:1"])
        with drivecomm.open_bus(line.port) as bus, pytest.raises(drivecomm.ReplyError):
            bus.drive("vabus", 1, baudrate=9600).read("481")
        assert "[sent with 9600 7E1, which no drive here uses]" in line.trace()

    def test_trace_marks_a_collision(self, lines):
        line = lines.line(["vabus:1"])
        line.virtual.configure(VABUS)
        line.virtual.transmit(ENQUIRY)
        line.advance(0.002)
        line.inject(b"\x55\x55")
        line.advance(1)
        assert "[collided with others on the wire, or broke off]" in line.trace()

    def test_trace_shows_the_last_80_telegrams(self, lines):
        line = lines.line(["vabus:1"])
        with drivecomm.open_bus(line.port) as bus:
            for number in range(50):
                bus.drive("vabus", 1).read(str(480 + number % 3))
        line.advance(1)
        rows = line.trace().splitlines()
        assert rows[0] == "(70 earlier ones are left out)"
        assert len(rows) == 81

    def test_trace_decodes_every_protocol_on_the_line(self, lines):
        from drivecomm.protocol import installed

        plugins = list(installed.working())
        names = [f"{each.name}:{each.addresses[number]}" for number, each in enumerate(plugins)]
        line = lines.line(names)
        with drivecomm.open_bus(line.port) as bus:
            for number, each in enumerate(plugins):
                bus.drive(each.name, each.addresses[number], model=each.default_model).read(each.parameter_examples[0])
        trace = line.trace()
        assert "[damaged" not in trace
        assert "[no telegram]" not in trace
        for drive in line.drives:
            for each in drive.received:
                assert each.data.hex(" ").upper() in trace


def test_line_maker_closes_its_lines_on_exit(tmp_path):
    before = threading.active_count()
    with LineMaker(0, folder=lambda: tmp_path) as maker:
        maker.drive("vabus:1", listen="tcp")
        maker.drive("vabus:1", listen="tcp")
        assert threading.active_count() == before + 2
    assert threading.active_count() == before
