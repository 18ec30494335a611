"""Measurements and findings of the line diagnosis, on virtual lines with known faults."""

import math
from dataclasses import replace

import pytest
from addresses import address_of

from drivecomm.commissioning.doctor import harmless_bytes, judge, latency_timer_s, measure
from drivecomm.errors import LinkDownError, UnknownProtocolError
from drivecomm.link import PortProxy
from drivecomm.plant import FaultPlan, LineFault
from drivecomm.protocol import DriveConfig, Framed, Framer, installed
from drivecomm.protocol.schema import crc16
from drivecomm.transport import PortReport, UsbIdentity
from drivecomm.virtual import DriveProxy, VirtualLine, virtual_drive

SERIAL = PortReport(
    url="/dev/ttyUSB0",
    kind="serial port",
    driver="ftdi_sio",
    usb=UsbIdentity(vendor=0x0403, product=0x6001, name="FT232R"),
    stable_name="/dev/serial/by-id/usb-FTDI",
    low_latency="on",
    latency_timer_ms=1,
)


def diagnose(line, report=SERIAL, *, port=None, **options):
    options = {"only": ["vabus"], "addresses": [1, 2], **options}
    measurements = measure(port or line.port(), **options)
    return measurements, judge(measurements, report)


def problems(findings):
    return [(one.about, one.text) for one in findings if one.weight == "problem"]


def only(findings, about):
    (found,) = [one for one in findings if one.about == about and one.weight == "problem"]
    assert found.remedy
    return found


class LatencyTimerPort:
    """Port of a virtual line behind an adapter that delivers bytes only at the ticks of its latency timer."""

    paced, real_time, descriptor = True, False, None

    def __init__(self, line, tick_s):
        self._port = line.port()
        self._tick_s = tick_s
        self._held = b""
        for name in ("now", "wall_time", "configure", "write", "wait", "hold_back", "close"):
            setattr(self, name, getattr(self._port, name))

    def take(self):
        return self.read(self.now(), 1)

    def read(self, until, at_least):
        while len(self._held) < at_least:
            tick = (math.floor(self.now() / self._tick_s + 1e-6) + 1) * self._tick_s
            if tick > until:
                self.wait(until)
                break
            self.wait(tick)
            self._held += self._port.take()
        data, self._held = self._held, b""
        return data


def test_sound_line_has_no_problems():
    line = VirtualLine([virtual_drive("vabus", 1), virtual_drive("danfoss-fc", 2), virtual_drive("fuji", 2)])
    measurements, findings = diagnose(line, only=None)
    assert problems(findings) == []
    assert [one.name for one in measurements.found] == ["danfoss-fc:2", "fuji:2", "vabus:1"]
    assert {str(one.settings) for one in measurements.noise} >= {"9600 8E1", "9600 8N1", "19200 7E1"}
    for one in measurements.replies:
        assert len(one.times_s) == one.asked
        assert all(delay > 0 for delay in one.delays_s)
    text = " ".join(one.text for one in findings)
    for part in (
        "ftdi_sio",
        "0403:6001",
        "by-id",
        "the line is quiet",
        "does not echo what it sends",
        "vabus:1 is done",
    ):
        assert part in text


@pytest.mark.parametrize("said", ["off", "expect", "auto"])
def test_echo_is_found_whatever_was_configured(said):
    line = VirtualLine([virtual_drive("vabus", 1)], echo=True)
    measurements, findings = diagnose(line, echo=said)
    assert [trial.kind for trial in measurements.echo] == ["whole"] * 3
    assert [one.name for one in measurements.found] == ["vabus:1"], "what was seen counts, not what was said"
    assert len(measurements.replies[0].times_s) == 24
    if said == "off":
        assert "--echo expect" in only(findings, "echo").remedy
    assert (problems(findings) == []) == (said != "off")


def test_configured_echo_that_is_missing_is_noted():
    _, findings = diagnose(VirtualLine([virtual_drive("vabus", 1)]), echo="expect")
    (found,) = [one for one in findings if one.about == "echo"]
    assert (found.weight, found.remedy) == ("note", "leave --echo out")


def test_changed_echo_suggests_two_transmitters():
    class Disturbed(VirtualLine):
        def receive(self, until, at_least):
            return bytes(byte ^ 1 for byte in super().receive(until, at_least))

    measurements, findings = diagnose(Disturbed(echo=True))
    assert {trial.kind for trial in measurements.echo} == {"changed"}
    assert "two transmitters" in only(findings, "echo").remedy


def test_echo_that_is_not_always_whole_is_reported():
    class Fickle(VirtualLine):
        sent = 0

        def transmit(self, data):
            self.sent += 1
            self.echo = self.sent != 2
            super().transmit(data)

    measurements, findings = diagnose(Fickle(), echo="auto")
    assert [trial.kind for trial in measurements.echo] == ["whole", "none", "whole"]
    assert "not always whole (2 of 3 times)" in " ".join(one.text for one in findings)


@pytest.mark.soak
def test_noise_is_reported_with_its_likely_cause():
    class Noisy(VirtualLine):
        noise = b""

        def receive(self, until, at_least):
            if until - self.time > 0.9:
                self.inject(self.noise)
            return super().receive(until, at_least)

    line = Noisy([virtual_drive("vabus", 1)])
    line.noise = b"\xfe\x13\x77" * 7
    assert "0 V" in only(diagnose(line, probes=2)[1], "noise").remedy
    line.noise = bytes(8)
    assert "swapped" in only(diagnose(line, probes=2)[1], "noise").remedy
    line.noise = bytes.fromhex("04 41 30 30 34 38 31 05")
    measurements, findings = diagnose(line, probes=2, only=["vabus"])
    assert measurements.noise[0].telegrams["vabus"] >= 1
    assert "other master" in only(findings, "noise").remedy


def test_line_without_answers_is_a_problem():
    measurements, findings = diagnose(VirtualLine())
    assert (measurements.found, measurements.replies, measurements.elsewhere) == ([], [], [])
    assert "no drive answers at 2 addresses (vabus at 19200 7E1)" in only(findings, "drives").text


@pytest.mark.parametrize("rate", [9600, 38400])
def test_drive_at_another_baud_rate_is_found(rate):
    line = VirtualLine([virtual_drive("vabus", 1, baudrate=rate)])
    measurements, findings = diagnose(line)
    assert [(found.name, settings.baudrate) for found, settings in measurements.elsewhere] == [("vabus:1", rate)]
    assert any(f"--baudrate {rate}" in one.remedy for one in findings)
    told, _ = diagnose(line, baudrate=rate)
    assert [one.name for one in told.found] == ["vabus:1"]
    unsought, _ = diagnose(line, search=False)
    assert unsought.elsewhere == []


def test_unreliable_drive_is_reported_with_its_answer_count():
    faults = FaultPlan(rate=0.3, seed=2, kinds=[LineFault.DROP], requests=False)
    measurements, findings = diagnose(VirtualLine([virtual_drive("vabus", 1)], faults=faults))
    answered = len(measurements.replies[0].times_s)
    assert 5 < answered < 24
    assert f"answered {answered} of 24 times" in only(findings, "time").text


def test_drive_that_needs_a_pause_is_named_with_the_pause():
    drive = virtual_drive("modbus", 1, model="delta")
    drive.needs_pause_s = 0.12
    measurements, findings = diagnose(VirtualLine([drive]), only=["modbus"], addresses=[1])
    assert measurements.replies[0].needs == {"turnaround_s": 0.2}
    found = only(findings, "time")
    assert "answered 12 of 24 times, and always with a pause of 200 ms before each request" in found.text
    assert "turnaround_s = 0.2" in found.remedy


def test_slow_drive_is_not_taken_for_one_at_another_baud_rate():
    class Slow(DriveProxy):
        def hear(self, find, now):
            reply = super().hear(find, now)
            return reply and replace(reply, delay_s=0.9)

    line = VirtualLine([Slow(virtual_drive("vabus", 1))])
    expected = DriveConfig(protocol="vabus", address=1, name="pump")
    measurements, findings = diagnose(line, expected=[expected], addresses=[2])
    assert measurements.sought[0].elsewhere is None
    found = only(findings, "drives")
    assert "answers at 19200 7E1 only with a reply time-out of 1.83 s" in found.text
    assert "reply_timeout_s = 1.83" in found.remedy
    measurements, findings = diagnose(line, addresses=[1])
    assert "vabus:1 answers at 19200 7E1, but late" in [text for about, text in problems(findings)]


class AlteringPort(PortProxy):
    """Port of a virtual line on which `change` alters each reply."""

    def __init__(self, line, change):
        super().__init__(line.port())
        self._change = change
        self._due = False

    def write(self, data):
        self._due = True
        super().write(data)

    def read(self, until, at_least):
        came = super().read(until, at_least)
        if came and self._due:
            self._due = False
            return self._change(came + super().read(self.now() + 0.02, 256))
        return came


@pytest.mark.parametrize("noise", [b"\x00", b"\xff"])
def test_noise_byte_before_each_reply_is_a_problem(noise):
    line = VirtualLine([virtual_drive("modbus", 1, model="delta")])
    port = AlteringPort(line, lambda reply: noise + reply)
    _, findings = diagnose(line, port=port, only=["modbus"], addresses=[1])
    found = only(findings, "time")
    assert f"1 byte of noise ({noise.hex().upper()}) with nearly every reply of modbus:1" in found.text
    assert "bias" in found.remedy


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (lambda reply: reply[1:], "first byte is missing"),
        (lambda reply: reply[:-1], "last byte is missing"),
        (lambda reply: reply[:-2] + reply[:-3:-1], "check bytes are in the wrong order"),
    ],
)
def test_typical_reply_damage_is_named_with_an_example(change, cause):
    line = VirtualLine([virtual_drive("modbus", 1, model="delta")])
    often = iter([True, True, True, True] + [False, True] * 100)
    port = AlteringPort(line, lambda reply: reply if next(often) else change(reply))
    _, findings = diagnose(line, port=port, only=["modbus"], addresses=[1], search=False)
    texts = [text for about, text in problems(findings) if about == "time"]
    assert any("were damaged, such as" in text and cause in text for text in texts)


def test_reply_from_another_address_is_named():
    line = VirtualLine([virtual_drive("modbus", 2, model="delta")])

    class Readdressed(AlteringPort):
        def write(self, data):
            changed = bytes([2]) + data[1:-2] if data[0] == 1 else data[:-2]
            super().write(changed + crc16(changed))

    expected = DriveConfig(protocol="modbus", address=1, name="fan", options={"model": "delta"})
    port = Readdressed(line, lambda reply: reply)
    _, findings = diagnose(line, port=port, only=["modbus"], addresses=[2], expected=[expected])
    assert "the drive of address 2 does in its place" in only(findings, "drives").text


def test_other_baud_rates_are_not_tried_if_the_port_cannot_set_them():
    class Raw(PortProxy):
        def configure(self, settings):
            self._port.configure(settings)
            return "raw TCP: the server has its own line settings"

    line = VirtualLine()
    seen = []
    expected = DriveConfig(protocol="vabus", address=1, name="fan")
    measure(
        Raw(line.port()),
        only=["vabus"],
        addresses=[2],
        expected=[expected],
        progress=lambda what, *_: seen.append(what),
    )
    assert seen
    assert not any("baud" in each for each in seen)


def test_drive_with_only_damaged_replies_is_reported():
    faults = FaultPlan(rate=1, seed=1, kinds=[LineFault.CORRUPT], requests=False, bits=1)
    line = VirtualLine([virtual_drive("danfoss-fc", 1)], faults=faults)
    measurements, findings = diagnose(line, only=["danfoss-fc"], addresses=[1])
    assert [(one.name, one.sound) for one in measurements.found] == [("danfoss-fc:1", False)]
    assert measurements.replies == []
    assert "answers, but damaged" in only(findings, "drives").text


def test_latency_timer_is_found_by_the_reply_times():
    line = VirtualLine([virtual_drive("vabus", 1)])
    measurements, findings = diagnose(line, port=LatencyTimerPort(line, 0.016))
    assert latency_timer_s(measurements.replies[0].arrivals_s) == 0.016
    assert "steps of 16 ms" in only(findings, "time").text
    quick = VirtualLine([virtual_drive("vabus", 1)])
    assert problems(diagnose(quick, port=LatencyTimerPort(quick, 0.001))[1]) == []


@pytest.mark.parametrize(("off", "timer_s"), [(1, 0.008), (4, None)])
def test_latency_timer_is_found_despite_a_single_late_reply(off, timer_s):
    late = [0.003 if place < off else 0.0 for place in range(20)]
    arrivals, now = [], 0.0
    for place in range(20):
        now += 0.008 * (1 + place % 4) + late[place]
        arrivals.append(now)
    assert latency_timer_s([0.0, *arrivals]) == timer_s


def test_slow_drive_is_not_taken_for_a_latency_timer():
    """Replies come exactly 16 ms after requests at uneven times; a latency timer would align their arrivals."""
    arrivals, now = [], 0.0
    for number in range(24):
        now += 0.016 + (0.0, 0.005, 0.011, 0.003, 0.007, 0.013, 0.002, 0.009)[number % 8]
        arrivals.append(now)
    assert latency_timer_s(arrivals) is None
    assert latency_timer_s(arrivals[:3]) is None


def test_reply_time_close_to_the_timeout_is_noted():
    line = VirtualLine([virtual_drive("vabus", 1)])
    limit = measure(line.port(), only=["vabus"], addresses=[1]).replies[0]
    close = max(limit.delays_s) * 1.2
    _, findings = diagnose(line, addresses=[1], reply_timeout_s=close)
    assert any(one.weight == "note" and "--timeout" in one.remedy for one in findings)


@pytest.mark.parametrize(
    ("report", "part"),
    [
        (None, "only the measurements"),
        (PortReport(url="line", kind="pseudo-terminal", stable_name="line"), "cannot be known from here"),
        (
            PortReport(url="socket://h:1", kind="raw TCP", stable_name="socket://h:1"),
            "the server sets the line settings",
        ),
        (PortReport(url="rfc2217://h:1", kind="RFC 2217", stable_name="rfc2217://h:1"), "an RFC 2217 connection"),
    ],
)
def test_port_finding_lists_the_unknown_facts(report, part):
    _, findings = diagnose(VirtualLine([virtual_drive("vabus", 1)]), report)
    assert problems(findings) == []
    assert any(part in one.text for one in findings if one.about == "port")


def test_latency_reported_by_the_adapter_is_a_problem():
    slow = PortReport(
        url="/dev/ttyUSB0",
        kind="serial port",
        usb=SERIAL.usb,
        stable_name="/dev/ttyUSB0",
        low_latency="off",
        latency_timer_ms=16,
        notes=("the adapter holds received bytes back for up to 16 ms; low-latency mode is not on", "something else"),
    )
    _, findings = diagnose(VirtualLine([virtual_drive("vabus", 1)]), slow)
    assert "up to 16 ms" in only(findings, "port").text
    assert any(one.text == "something else" for one in findings)


def test_adapter_that_hides_its_latency_is_noted():
    dumb = PortReport(url="COM3", kind="serial port", usb=SERIAL.usb, stable_name="COM3")
    _, findings = diagnose(VirtualLine([virtual_drive("vabus", 1)]), dumb)
    assert any("does not show; see the reply times" in one.text for one in findings)


def test_address_invalid_for_a_protocol_is_not_probed():
    measurements, _ = diagnose(VirtualLine(), only=["vabus", "danfoss-fc"], addresses=[31], listen_s=0.1)
    assert measurements.addresses == 1
    assert measurements.elsewhere == []


def test_echo_is_not_tested_if_no_bytes_are_harmless(monkeypatch):
    monkeypatch.setattr("drivecomm.commissioning.doctor.listening._finds", lambda *_: [Framed(b"?", None)])
    assert harmless_bytes() == b""
    measurements, findings = diagnose(VirtualLine([virtual_drive("vabus", 1)]), probes=1)
    assert (measurements.echo, [one for one in findings if one.about == "echo"]) == ([], [])


def test_broken_line_raises_link_down_error():
    line = VirtualLine([virtual_drive("vabus", 1)])
    port = line.port()
    with pytest.raises(LinkDownError):
        measure(port, only=["vabus"], progress=lambda *_: setattr(line, "broken", True))


def test_unknown_protocol_is_refused():
    with pytest.raises(UnknownProtocolError):
        measure(VirtualLine().port(), only=["profibus"])


@pytest.mark.parametrize("way", ["request", "reply"])
def test_echo_test_bytes_are_not_a_telegram_of_any_protocol(way):
    for plugin in installed.working():
        framer = Framer(plugin.codec(plugin.options()), way)
        finds = [*framer.feed(harmless_bytes()), *framer.flush()]
        assert not any(isinstance(find, Framed) for find in finds)
    assert all(byte < 0x80 for byte in harmless_bytes()), "seven data bits carry it too"


@pytest.mark.soak
def test_echo_test_bytes_start_no_drive():
    drives = [virtual_drive(name, address_of(name)) for name in installed]
    line = VirtualLine(drives)
    port = line.port()
    for drive in drives:
        port.configure(drive.settings)
        port.write(harmless_bytes())
        assert port.read(port.now() + 2, 1) == b""
    measure(port, addresses=[1], listen_s=0.1)
    assert not any(drive.motor.running for drive in drives)
