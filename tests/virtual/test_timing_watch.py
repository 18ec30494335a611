"""Timing faults of a master on a line, judged by its transmissions."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any

import pytest

import drivecomm
from drivecomm.errors import DriveCommError
from drivecomm.models import load_model
from drivecomm.plant import Fault, FaultPlan
from drivecomm.protocol import LineSettings, installed
from drivecomm.virtual import TimingWatch, VirtualLine, drive_type, violations, virtual_drive

if TYPE_CHECKING:
    from drivecomm.virtual import Transmission, Violation

ENQUIRY = b"\x04A00481\x05"
SETTINGS = LineSettings(baudrate=19200, bytesize=7, parity="E")


class Watched:
    """A line with drives, and the violations of the master that its watch finds."""

    def __init__(
        self, *names: tuple[str, int], paced: bool = True, faults: float = 0.0, kind: Fault = Fault.DROP, **options: Any
    ) -> None:
        types = {f"{name}:{address}": drive_type(name, address, options=options) for name, address in names}
        drives = {name: kind.new() for name, kind in types.items()}
        plan = FaultPlan(rate=faults, kinds=[kind])
        self.line = VirtualLine(drives.values(), paced=paced, faults=plan)
        self.rules = [types[name].rules(name, drive=drive) for name, drive in drives.items()]
        self.watch = TimingWatch(self.rules)
        self.seen: list[Transmission] = []
        self.found: list[Violation] = []
        self.line.on_transmit.append(self._take)
        self.line.monitors.append(lambda sent: self._take(sent) if sent.source != "master" else None)
        self.port = self.line.port()
        self.port.configure(SETTINGS)

    def _take(self, sent: Transmission) -> None:
        self.seen.append(sent)
        self.found += self.watch.take(sent)

    def ask(self, request: bytes = ENQUIRY, length: int = 19) -> bytes:
        self.port.write(request)
        return self.line.receive(self.line.time + 1, length)


def only(found: list[Violation]) -> Violation:
    assert len(found) == 1, [str(each) for each in found]
    return found[0]


@pytest.mark.parametrize("paced", [True, False])
def test_request_before_the_reply_is_a_violation_with_its_source(paced: bool) -> None:
    line = Watched(("vabus", 1), paced=paced)
    line.port.write(ENQUIRY)
    line.line.advance(0.006 + SETTINGS.wire_s(len(ENQUIRY)) * paced)
    line.ask()
    found = only(line.found)
    assert (found.rule, found.allowed, found.demanded) == ("reply not awaited", 0.5, True)
    assert found.measured == pytest.approx(0.006)
    assert str(found) == (
        "vabus:1: the next request began 6 ms after the last one, whose reply was due and may take 500 ms "
        "(ACT/ACU Modbus manual p. 35)"
    )


def test_request_during_a_reply_is_a_violation_without_a_printed_time() -> None:
    line = Watched(("vlt3500", 1))
    port = line.line.port()
    port.configure(LineSettings())
    with drivecomm.open_bus(line.line.port, echo=False) as bus:
        bus.drive("vlt3500", 1).status()
    request = next(sent for sent in line.seen if sent.source == "master").data
    line.found.clear()
    line.line.advance(1)
    port.write(request)
    line.line.advance(LineSettings().wire_s(len(request)) + 0.002)
    port.write(request)
    line.line.advance(1)
    found = only(line.found)
    assert (found.rule, found.demanded, found.source) == ("reply not awaited", True, "seen on the line")


def test_silent_drive_is_waited_for_during_its_whole_reply_time() -> None:
    line = Watched(("vabus", 1))
    line.line.power_off(line.line.drives[0])
    for pause_s in (0.2, 0.51):
        line.port.write(ENQUIRY)
        line.line.advance(SETTINGS.wire_s(len(ENQUIRY)) + pause_s)
    line.ask()
    assert only(line.found).measured == pytest.approx(0.2)


def test_turnaround_is_a_violation_if_a_manual_demands_it_and_else_a_note() -> None:
    line = Watched(("vabus", 1))
    line.ask()
    line.line.advance(0.001)
    line.ask()
    line.line.advance(0.003)
    line.ask()
    found = only(line.found)
    assert (found.rule, found.allowed, found.demanded) == ("turnaround", 0.002, True)
    assert found.measured == pytest.approx(0.001, abs=1e-4)
    noted = Watched(("vabus", 1), turnaround_s=0.02)
    noted.ask()
    noted.line.advance(0.01)
    noted.ask()
    assert only(noted.found).source == "set for this drive"


def test_default_of_drivecomm_is_a_note() -> None:
    line = Watched(("vabus", 1))
    for byte in ENQUIRY:
        line.port.write(bytes([byte]))
        line.line.advance(0.08)
    found = only(line.found)
    assert (found.rule, found.demanded, found.source) == ("gap in a telegram", False, "a default of drivecomm")
    assert found.measured == pytest.approx(0.08 - SETTINGS.character_s)
    assert str(found).startswith("note: vabus:1: a request had a pause of 79.5 ms inside it; it may have 50 ms")


def test_protocol_with_silence_limits_the_gap_in_a_telegram() -> None:
    line, settings = Watched(("modbus", 1)), LineSettings(parity="E")
    line.port.configure(settings)
    request = bytes.fromhex("01 03 00 00 00 01 84 0A")
    line.port.write(request[:4])
    line.line.advance(settings.wire_s(4) + 0.005)
    line.port.write(request[4:])
    line.line.advance(1)
    found = only(line.found)
    assert (found.rule, found.demanded) == ("gap in a telegram", True)
    assert found.allowed == pytest.approx(settings.wire_s(3.5))


def test_broadcast_is_followed_by_its_pause() -> None:
    line = Watched(("movilink", 1))
    line.port.configure(LineSettings(parity="E"))
    with drivecomm.open_bus(line.line.port) as bus:
        bus.drive("movilink", 1).status()
        telegrams = [sent.data for sent in line.seen if sent.source == "master"]
        bus.broadcast("movilink").stop()
    broadcast = [sent.data for sent in line.seen if sent.source == "master"][len(telegrams)]
    line.line.advance(2)
    line.found.clear()
    line.port.write(broadcast)
    line.line.advance(LineSettings(parity="E").wire_s(len(broadcast)) + 0.01)
    line.port.write(telegrams[0])
    line.line.advance(1)
    found = only(line.found)
    assert (found.rule, found.allowed, found.demanded) == ("pause after a broadcast", 0.025, True)


def test_request_interval_is_measured_from_start_to_start() -> None:
    line = Watched(("vabus", 1), request_interval_s=0.1)
    line.ask()
    line.line.advance(0.05)
    line.ask()
    assert only(line.found).rule == "request interval"


def test_settings_that_no_drive_has_are_reported_once() -> None:
    line = Watched(("vabus", 1), ("vabus", 2))
    line.port.configure(LineSettings(baudrate=1200))
    line.port.write(ENQUIRY)
    line.line.advance(1)
    line.port.write(ENQUIRY)
    line.line.advance(1)
    found = only(line.found)
    assert (found.rule, found.measured, found.allowed) == ("line settings", "1200 8N1", "19200 7E1")


@pytest.mark.parametrize("kind", [Fault.DROP, Fault.CORRUPT, Fault.TRUNCATE, Fault.DELAY, Fault.DUPLICATE])
def test_faults_of_the_line_are_not_violations_of_the_master(kind: Fault) -> None:
    line = Watched(("vabus", 1), faults=0.5, kind=kind)
    with drivecomm.open_bus(line.line.port) as bus:
        drive = bus.drive("vabus", 1)
        for _ in range(60):
            with suppress(DriveCommError):
                drive.read("481")
    assert not line.found, [str(each) for each in line.found]


@pytest.mark.parametrize("paced", [True, False])
@pytest.mark.parametrize("name", sorted(installed))
def test_drivecomm_master_keeps_every_rule(name: str, paced: bool) -> None:
    plugin = installed[name]
    address = next(iter(plugin.scan_addresses))
    model = load_model(plugin.package, name, plugin.default_model)
    line = Watched((name, address), paced=paced)
    with drivecomm.open_bus(line.line.port) as bus:
        drive = bus.drive(name, address, model=model.name)
        calls = [drive.status, drive.reset, drive.stop, drive.start, drive.status, drive.stop, drive.identify]
        calls += [lambda: drive.set_reference(percent=20)]
        calls += [lambda each=each: drive.read(each) for each in list(model.parameters)[:5]]  # type: ignore[misc]
        if drive.capabilities.broadcast:
            calls += [bus.broadcast(name).stop, drive.status]
        for call in calls:
            with suppress(DriveCommError):
                call()
    assert any(sent.source == "drive" for sent in line.seen)
    assert not line.found, [str(each) for each in line.found]


def test_recorded_transmissions_give_the_same_violations() -> None:
    line = Watched(("vabus", 1))
    line.ask()
    line.ask()
    line.line.inject(b"noise")
    line.line.advance(1)
    assert list(violations(line.seen, line.rules)) == line.found != []


def test_memory_of_a_timing_watch_does_not_grow() -> None:
    watch = TimingWatch(Watched(("vabus", 1)).rules)
    line = Watched(("vabus", 1))
    line.port.write(b"\x04A0048" * 2000)
    line.line.advance(10)
    for sent in line.seen * 20:
        watch.take(sent)
    assert sum(piece.length for piece in watch._pieces) <= 2048


@pytest.mark.parametrize("name", sorted(installed))
def test_two_requests_in_a_row_are_found_on_every_protocol(name: str) -> None:
    address = next(iter(installed[name].scan_addresses))
    line = Watched((name, address))
    with drivecomm.open_bus(line.line.port) as bus:
        bus.drive(name, address, model=installed[name].default_model).read(installed[name].parameter_examples[0])
    request = next(sent for sent in line.seen if sent.source == "master")
    port = line.line.port()
    port.configure(request.settings)
    line.line.advance(1)
    port.write(request.data)
    line.line.advance(request.settings.wire_s(len(request.data)) + 0.0001)
    port.write(request.data)
    line.line.advance(1)
    found = only(line.found)
    assert (found.rule, found.demanded, found.drive) == ("reply not awaited", True, f"{name}:{address}")


def test_monitors_of_a_line_do_not_replace_each_other() -> None:
    line, heard = Watched(("vabus", 1)), [list[str](), list[str]()]
    for each in heard:
        line.line.monitors.append(lambda sent, each=each: each.append(sent.source))  # type: ignore[misc]
    line.ask()
    del line.line.monitors[-1]
    line.line.advance(1)
    line.ask()
    assert heard == [["master", "drive"] * 2, ["master", "drive"]]


def test_short_telegram_inside_one_of_another_protocol_is_ignored() -> None:
    line = Watched(("modbus", 1), ("vabus", 2))
    settings = LineSettings(parity="E")
    line.port.configure(settings)
    # A byte 04 alone is an EOT of VABus.
    request = bytes.fromhex("01 03 00 04 00 01")
    request += _crc(request)
    line.port.write(request[:4])
    line.port.write(request[4:6])
    line.line.advance(settings.wire_s(6) + 0.02)
    line.port.write(request[6:])
    line.line.advance(1)
    assert only(line.found).rule == "gap in a telegram"


def _crc(data: bytes) -> bytes:
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return crc.to_bytes(2, "little")


@pytest.mark.parametrize("rest", ["01", "01 03 00", "01 10 00 00 00 20 40", "FF FF FF"])
def test_aborted_telegram_does_not_spoil_the_next_ones(rest: str) -> None:
    line = Watched(("modbus", 1))
    settings = LineSettings(parity="E")
    line.port.configure(settings)
    request = bytes.fromhex("01 03 00 00 00 01")
    request += _crc(request)
    line.port.write(bytes.fromhex(rest))
    for _ in range(5):
        line.line.advance(0.5)
        line.ask(request, 5)
    assert not [str(each) for each in line.found if each.rule != "gap in a telegram"]
    line.line.advance(0.001)
    line.ask(request, 5)
    assert line.found[-1].rule == "turnaround"


def test_needed_pause_is_an_option_of_a_virtual_drive() -> None:
    drive = virtual_drive("vabus", 1, needs_pause_s=0.5, values={"480": 1234})
    line = VirtualLine([drive])
    assert drive.peek("480", 0.0) == "000004D2"
    with drivecomm.open_bus(line.port) as bus:
        asked = bus.drive("vabus", 1, attempts=1)
        asked.read("481")
        with pytest.raises(drivecomm.NoReplyError):
            asked.read("481")
    with pytest.raises(drivecomm.UsageError, match="write a table"):
        virtual_drive("vabus", 1, values=3)
