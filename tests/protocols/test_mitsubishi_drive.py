"""Mitsubishi and Shihlin drives over the computer link: effects of commands, and pitfalls of the protocol."""

import pytest

import drivecomm
from drivecomm.cli import main
from drivecomm.errors import (
    DamagedReplyError,
    NoReplyError,
    NotSupported,
    ParameterAddressError,
    RefusedError,
    StateError,
    UnexpectedReplyError,
    UsageError,
    ValueRefusedError,
)
from drivecomm.models import link_loss_of, load_model
from drivecomm.plant import FaultPlan, LineFault
from drivecomm.protocol import Framed, Framer, Noise, Stop, installed
from drivecomm.virtual import VirtualLine, virtual_drive

PLUGIN = installed["mitsubishi"]
MODELS = pytest.mark.parametrize("model", ["fr500", "fr700", "shihlin"])


def rest(text, *, begin=b"\x05", end=b""):
    return begin + text + b"%02X" % (sum(text) & 0xFF) + end


class Line:
    """A line with virtual drives that records the telegrams sent."""

    def __init__(self, *drives, **settings):
        self.line = VirtualLine([*drives], **settings)
        self.sent = []
        self.bus = drivecomm.open_bus(self.line.port, trace=self._note)

    def _note(self, event):
        if event.what == "sent":
            self.sent.append(bytes(event.data))

    def __enter__(self):
        self.bus.__enter__()
        return self

    def __exit__(self, *given):
        self.bus.__exit__(*given)


@pytest.fixture
def fr700():
    virtual = virtual_drive("mitsubishi", 1, model="fr700")
    with Line(virtual) as line:
        yield line, virtual, line.bus.drive("mitsubishi", 1, model="fr700")


@MODELS
@pytest.mark.parametrize("reverse", [False, True])
def test_start_runs_the_motor_and_stop_stops_it(model, reverse):
    virtual = virtual_drive("mitsubishi", 1, model=model)
    with Line(virtual) as line:
        drive = line.bus.drive("mitsubishi", 1, model=model)
        drive.set_reference(hz=20)
        drive.start(reverse=reverse)
        line.line.advance(30)
        status = drive.status()
        assert (status.running, bool(status.reverse), status.at_reference) == (True, reverse, True)
        assert virtual.motor.output_hz == (-20 if reverse else 20)
        digits = "0000" if model == "shihlin" else "00"
        drive.stop()
        assert line.sent[-1] == rest(b"01FA0" + digits.encode())
        line.line.advance(30)
        assert not drive.status().running


def test_start_without_a_reply_is_sent_once():
    virtual = virtual_drive("mitsubishi", 1, model="fr700")
    with Line(virtual) as line:
        drive = line.bus.drive("mitsubishi", 1, model="fr700")
        drive.status()
        hear = virtual.hear
        virtual.hear = lambda find, now: (hear(find, now), None)[1] if b"FA002" in find.data else hear(find, now)
        with pytest.raises(NoReplyError, match="whether the drive acted on it is not known"):
            drive.start()
        assert [each for each in line.sent if b"FA0" in each] == [rest(b"01FA002")]


def test_stop_without_a_reply_is_sent_again():
    virtual = virtual_drive("mitsubishi", 1, model="fr700")
    with Line(virtual) as line:
        drive = line.bus.drive("mitsubishi", 1, model="fr700")
        drive.start()
        hear, lost = virtual.hear, []
        virtual.hear = lambda find, now: (
            (lost.append(hear(find, now)), None)[1] if b"FA000" in find.data and not lost else hear(find, now)
        )
        drive.stop()
        assert [each for each in line.sent if b"FA000" in each] == [rest(b"01FA000")] * 2


@pytest.mark.parametrize(("model", "mode", "named"), [("fr700", 1, "external"), ("shihlin", 8, "PU")])
def test_start_in_another_operation_mode_is_refused_unsent(model, mode, named):
    virtual = virtual_drive("mitsubishi", 1, model=model)
    virtual.poke("H7B", mode)
    with Line(virtual) as line:
        with pytest.raises(StateError, match=f"operation_mode is {mode} .{named}"):
            line.bus.drive("mitsubishi", 1, model=model).start()
        assert not [each for each in line.sent if b"FA" in each or b"FB" in each]


def test_run_command_in_another_operation_mode_gets_a_mode_error(fr700):
    line, virtual, _ = fr700
    virtual.poke("H7B", 1)
    with pytest.raises(RefusedError, match="mode error") as raised:
        line.bus.drive("mitsubishi", 1).write("HFA", 2)
    assert raised.value.code == 10


@pytest.mark.parametrize(("hz", "written"), [(0, b"0000"), (120, b"2EE0"), ("0.01", b"0001")])
def test_reference_at_its_limits_is_written_to_ram(fr700, hz, written):
    line, _, drive = fr700
    drive.set_reference(hz=hz)
    assert line.sent[-1] == rest(b"01ED0" + written)


@pytest.mark.parametrize("hz", ["120.01", -1, "0.005"])
def test_reference_that_does_not_fit_is_refused_unsent(fr700, hz):
    line, _, drive = fr700
    with pytest.raises(ValueRefusedError):
        drive.set_reference(hz=hz)
    assert not [each for each in line.sent if b"ED" in each]


def test_reference_in_percent_refers_to_pr_1(fr700):
    line, virtual, drive = fr700
    virtual.poke("1", 6000)
    drive.set_reference(percent=50)
    assert line.sent[-1] == rest(b"01ED00BB8")


@MODELS
def test_running_is_read_from_the_unassignable_status_bits_only(model):
    virtual = virtual_drive("mitsubishi", 1, model=model)
    virtual._machine.live = lambda _: None
    register = "H79" if model == "fr700" else "H7A"
    with Line(virtual) as line:
        drive = line.bus.drive("mitsubishi", 1, model=model)
        for word, running in ((0x01, False), (0x02, True), (0x04, True), (0x82, True), (0x00, False)):
            virtual.poke(register, word)
            status = drive.status()
            assert (status.running, status.fault) == (running, False), word


@pytest.mark.parametrize(("model", "word"), [("fr500", 0x80), ("fr700", 0x8000), ("shihlin", 0x80)])
def test_fault_has_the_latest_code_and_is_reset_by_one_telegram(model, word):
    virtual = virtual_drive("mitsubishi", 1, model=model)
    with Line(virtual) as line:
        drive = line.bus.drive("mitsubishi", 1, model=model)
        virtual.trip(0x10, line.line.time)
        virtual.trip(0x10, line.line.time)
        status = drive.status()
        assert (status.fault, status.fault_code, status.word & word) == (True, 0x10, word)
        with pytest.raises(StateError, match="has a fault"):
            drive.start()
        line.sent.clear()
        drive.reset()
        assert [each for each in line.sent if b"FD" in each] == [rest(b"01FD09696")]
        assert not drive.status().fault
        assert drive.read("H74.low").value == 0x10


def test_page_is_selected_before_each_parameter(fr700):
    line, virtual, drive = fr700
    virtual.poke("240", 5)
    for _ in range(2):
        assert drive.read("240").value == 5
        assert line.sent[-2:] == [rest(b"01FF002"), rest(b"01300")]
        # Another master may select its own page in between.
        virtual.hear(
            Framed(b"", PLUGIN.message({"kind": "write", "station": 1, "code": "FF", "data": "00"}, "request")), 0
        )
    assert drive.read("1").value == 120
    assert line.sent[-2:] == [rest(b"01FF000"), rest(b"01010")]


@pytest.mark.parametrize("number", [100, 160, 240, 999])
def test_parameter_of_an_unknown_page_is_refused_unsent(number):
    with Line(virtual_drive("mitsubishi", 1)) as line:
        with pytest.raises(ParameterAddressError, match="not known"):
            line.bus.drive("mitsubishi", 1).read(str(number))
        assert line.sent == []


def test_write_to_a_code_with_another_meaning_is_refused_unsent():
    with Line(virtual_drive("mitsubishi", 1)) as line:
        drive = line.bus.drive("mitsubishi", 1)
        for code in ("H7A", "H79", "H70", "H74"):
            with pytest.raises(NotSupported, match="can only be read"):
                drive.write(code, 2)
        assert line.sent == []


def test_six_digit_reply_is_not_taken_for_a_frequency(fr700):
    _, virtual, drive = fr700
    six = PLUGIN.codec(PLUGIN.options()).encode(
        PLUGIN.message({"kind": "data", "station": 1, "data": "00EA60"}, "reply")
    )
    virtual._sent = lambda _: drivecomm.protocol.VirtualReply(data=six, delay_s=0.01)
    with pytest.raises(UnexpectedReplyError, match=r"Pr\. 37"):
        drive.read("output_frequency")


def scripted(*replies):
    """Return a drive that sends these replies in order and is silent afterwards."""
    virtual, left = virtual_drive("mitsubishi", 1, model="fr700"), [*replies]
    virtual.hear = lambda _find, _now: drivecomm.protocol.VirtualReply(data=left.pop(0), delay_s=0.01) if left else None
    return virtual


@pytest.mark.parametrize("code", range(6))
def test_request_that_arrived_damaged_is_sent_at_most_twice(code):
    nak = b"\x1501%X" % code
    with Line(scripted(nak, rest(b"011770", begin=b"\x02")[:-2] + b"\x0330")) as line:
        assert str(line.bus.drive("mitsubishi", 1, model="fr700").read("H6F").value) == "60.00"
    with Line(scripted(*[nak] * 9)) as line:
        with pytest.raises(DamagedReplyError, match="request arrived damaged"):
            line.bus.drive("mitsubishi", 1, model="fr700").read("H6F")
        assert line.sent == [rest(b"016F0")] * 2


@pytest.mark.parametrize("code", [7, 10, 11, 12])
def test_other_refusals_are_raised_without_a_retry(code):
    with Line(scripted(*[b"\x1501%X" % code] * 9)) as line:
        with pytest.raises(RefusedError) as raised:
            line.bus.drive("mitsubishi", 1, model="fr700").read("H6F")
        assert (raised.value.code, len(line.sent)) == (code, 1)


def test_request_to_a_silent_drive_is_sent_twice():
    with Line(scripted()) as line:
        with pytest.raises(NoReplyError):
            line.bus.drive("mitsubishi", 1, model="fr700").read("H6F")
        assert len(line.sent) == 2


def test_scan_sends_one_probe_to_each_station():
    drives = [virtual_drive("mitsubishi", station) for station in (0, 31)]
    with Line(*drives) as line:
        found = [each.name for each in line.bus.scan(["mitsubishi"])]
        assert found == ["mitsubishi:0", "mitsubishi:31"]
        # One probe for each silent station, and for those that answered with nothing but their model.
        assert len([each for each in line.sent if each[3:5] == b"7A"]) == 32


@pytest.mark.parametrize(
    "options", [{"terminator": "cr"}, {"terminator": "crlf"}, {"wait": False}, {"wait": 15}, {"dialect": "shihlin"}]
)
def test_drive_with_other_options_is_read(options):
    virtual = virtual_drive("mitsubishi", 1, model="fr700", **options)
    with Line(virtual) as line:
        drive = line.bus.drive("mitsubishi", 1, model="fr700", **options)
        virtual.poke("H6F", 0)
        assert drive.read("H6F").value == 0
        drive.start()
        assert virtual.motor.running


@pytest.mark.parametrize(
    "options", [{"wait": 16}, {"wait": -1}, {"wait": True}, {"terminator": "lf"}, {"dialect": "hitachi"}]
)
def test_invalid_option_is_refused(options):
    with pytest.raises(UsageError):
        PLUGIN.options(**options)


def test_option_without_a_wait_digit_differs_from_wait_0():
    without, zero = PLUGIN.options(wait=False), PLUGIN.options(wait=0)
    assert without != zero
    assert PLUGIN.codec(without) is not PLUGIN.codec(zero)


@pytest.mark.parametrize(
    ("request_", "reply"),
    [
        (rest(b"016F0")[:-1] + b"0", b"\x15012"),
        (rest(b"016F0")[:-1], b"\x15013"),
        (rest(b"01ED01 70"), b"\x15017"),
        (rest(b"026F0")[:-1] + b"0", b""),
    ],
)
def test_damaged_request_is_refused_by_the_addressed_drive_only(request_, reply):
    virtual = virtual_drive("mitsubishi", 1)
    framer = Framer(virtual.codec, "request")
    found = [*framer.feed(request_), *framer.flush()]
    answers = [virtual.hear(find, 1.0) for find in found if not isinstance(find, Noise)]
    assert b"".join(each.data for each in answers if each is not None) == reply


def multi(send, receive, run, hz):
    return PLUGIN.message(
        {
            "kind": "multi", "station": 1, "code": "F0", "wait": 0, "send_type": send, "receive_type": receive,
            "data1": run, "data2": hz,
        },
        "request",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("mode", "hz", "errors", "runs"),
    [(0, "1388", (15, 15), True), (1, "1388", (10, 15), False), (0, "FFFF", (15, 12), True)],
)
def test_multi_command_reply_has_an_error_code_for_each_part(mode, hz, errors, runs):
    virtual = virtual_drive("mitsubishi", 1, model="fr700")
    virtual.poke("H7B", mode)
    answer = virtual.hear(Framed(b"", multi(0, 0, "0002", hz)), 1.0)
    reply = virtual.codec.decode(answer.data, "reply")
    assert (reply.error1, reply.error2) == errors
    assert PLUGIN.mismatch(multi(0, 0, "0002", hz), reply) == ""
    assert virtual.motor.running is runs


def test_acknowledgement_of_the_master_is_not_answered():
    virtual = virtual_drive("mitsubishi", 1, model="fr700")
    for kind in ("ack", "nak"):
        assert virtual.hear(Framed(b"", PLUGIN.message({"kind": kind, "station": 1}, "request")), 1.0) is None


def test_parameter_write_to_eeprom_needs_store(fr700):
    _, virtual, drive = fr700
    with pytest.raises(NotSupported, match="store=True"):
        drive.write("72", 3)
    drive.write("72", 3, store=True)
    virtual.power_cycle(1.0)
    assert virtual.peek("72", 2.0) == 3


def test_power_cycle_resets_the_page():
    virtual = virtual_drive("mitsubishi", 1, model="fr700")
    virtual.hear(
        Framed(b"", PLUGIN.message({"kind": "write", "station": 1, "code": "FF", "data": "02"}, "request")), 1.0
    )
    assert virtual._dialect.page == 2
    virtual.power_cycle(2.0)
    assert virtual._dialect.page == 0


@pytest.mark.parametrize("model", ["fr500", "fr700"])
def test_link_loss_text_says_that_any_telegram_feeds_the_watchdog(model):
    said = link_loss_of(load_model(PLUGIN.package, "mitsubishi", model))
    assert "any station" in said
    assert "Pr. 122" in said


def test_late_replies_never_give_a_wrong_value():
    virtual = virtual_drive("mitsubishi", 1, model="fr700")
    virtual.poke("HED", 1234)
    right = {"H6F": "0.00", "1": "120.00", "240": "1", "H7B": "0"}
    for seed in range(6):
        faults = FaultPlan(rate=0.3, kinds=[LineFault.DELAY], delay_s=1.5, seed=seed)
        with Line(virtual_drive("mitsubishi", 1, model="fr700"), faults=faults) as line:
            drive = line.bus.drive("mitsubishi", 1, model="fr700")
            for name in 15 * [*right]:
                try:
                    found = str(drive.read(name).value)
                except drivecomm.DriveCommError:
                    continue
                assert found == right[name]


def test_ramp_is_the_only_stop():
    model = load_model(PLUGIN.package, "mitsubishi", "fr700")
    with Line(virtual_drive("mitsubishi", 1, model="fr700")) as line:
        assert line.bus.drive("mitsubishi", 1, model=model).capabilities.stops == {Stop.RAMP}


def test_scan_of_several_settings_warns_that_drives_may_trip(tmp_path, capsys):
    asked = ["scan", "--port", str(tmp_path / "none"), "--protocol", "mitsubishi", "--baudrate", "9600,19200"]
    assert main(asked) != 0
    assert "Pr. 121" in capsys.readouterr().err
    assert main([*asked[:-1], "19200"]) != 0
    assert "Pr. 121" not in capsys.readouterr().err
