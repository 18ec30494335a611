"""Control Techniques drives on a virtual line: starts, stops, references, short commands, groups, refusals, damage."""

import pytest

import drivecomm
from drivecomm.errors import (
    AddressError,
    NoReplyError,
    NotSupported,
    ParameterAddressError,
    RefusedError,
    StateError,
    UnexpectedReplyError,
    UsageError,
    ValueRefusedError,
)
from drivecomm.models import load_model
from drivecomm.protocol import Framed, Framer, Stop, installed
from drivecomm.virtual import VirtualLine, virtual_drive

PLUGIN = installed["ct-ansi"]
CODEC = PLUGIN.codec(None)


class Bench:
    def __init__(self, *addresses, model="unidrive-sp"):
        self.drives = [virtual_drive("ct-ansi", address, model=model) for address in addresses or (11,)]
        self.line = VirtualLine(self.drives)
        self.sent = []
        self.bus = drivecomm.open_bus(self.line.port, trace=self._trace)
        self.drive = self.bus.drive("ct-ansi", self.drives[0].address, model=model)

    def _trace(self, event):
        if event.what == "sent":
            self.sent.append(event.data)

    def hears(self, data):
        """Return the reply of each drive to the bytes of a request; None for a silent drive."""
        found = [drive.hear(Framed(data, CODEC.decode(data, "request")), 0.0) for drive in self.drives]
        return [each and each.data for each in found]


class Replies:
    """Replacements for the next replies of a drive, in order; None makes the drive silent."""

    def __init__(self, *data):
        self.left = list(data)

    def request(self, data, now):  # noqa: ARG002 - signature of a disturbance
        return [(0.0, data)]

    def reply(self, data, drive, now):  # noqa: ARG002
        data = self.left.pop(0) if self.left else data
        return [(0.0, data)] if data is not None else []


def asked(kind, address=11, place=None, data=None):
    group, unit = divmod(address, 10)
    menu, parameter = divmod(place, 100)
    fields = {"kind": kind, "group": group, "unit": unit, "menu": menu, "parameter": parameter, "data": data}
    return drivecomm.encode(
        "ct-ansi", {name: each for name, each in fields.items() if each is not None}, direction="request"
    )


def told(place, data):
    fields = {"kind": "value", "menu": place // 100, "parameter": place % 100, "data": data}
    return drivecomm.encode("ct-ansi", fields, direction="reply")


def words(bench):
    return [data for data in bench.sent if b"\x020642" in data]


@pytest.mark.parametrize(("reverse", "word"), [(False, "+387"), (True, "+393")])
def test_start_sends_one_control_word(reverse, word):
    bench = Bench()
    bench.drive.start(reverse=reverse)
    assert words(bench) == [asked("write", place=642, data=word)]


@pytest.mark.parametrize(("how", "word"), [(Stop.RAMP, "+385"), (Stop.COAST, "+384")])
def test_stop_clears_the_run_bits(how, word):
    bench = Bench()
    bench.drive.start()
    bench.drive.stop(how)
    assert words(bench)[-1] == asked("write", place=642, data=word)


def test_start_without_control_word_enable_is_refused_unsent():
    bench = Bench()
    bench.drives[0].poke("06.43", 0)
    with pytest.raises(StateError, match="control_word_enable"):
        bench.drive.start()
    assert not words(bench)


def test_reference_without_its_selector_is_refused_unsent():
    bench = Bench()
    bench.drives[0].poke("01.14", 3)
    with pytest.raises(StateError, match="reference_selector"):
        bench.drive.set_reference(hz=20)
    assert not any(b"\x020121" in data for data in bench.sent)


@pytest.mark.parametrize(("hz", "data"), [("0", "+0.0"), ("50", "+50.0"), ("12.5", "+12.5")])
def test_reference_is_sent_with_sign_and_decimals(hz, data):
    bench = Bench()
    bench.drive.set_reference(hz=hz)
    assert bench.sent[-1] == asked("write", place=121, data=data)


@pytest.mark.parametrize("hz", ["50.1", "12.55"])
def test_reference_above_its_maximum_or_between_steps_is_refused_unsent(hz):
    bench = Bench()
    with pytest.raises(ValueRefusedError):
        bench.drive.set_reference(hz=hz)
    assert not any(b"\x020121" in data for data in bench.sent)


def test_start_without_an_acknowledgement_is_sent_once():
    bench = Bench()
    status, enable = told(1040, "+1"), told(643, "+1")
    bench.line.disturbances.append(Replies(status, enable, None))
    with pytest.raises(NoReplyError):
        bench.drive.start()
    assert words(bench).count(asked("write", place=642, data="+387")) == 1


def test_stop_without_an_acknowledgement_is_sent_again():
    bench = Bench()
    bench.line.disturbances.append(Replies(None))
    bench.drive.stop()
    assert words(bench) == [asked("write", place=642, data="+385")] * 2


def test_undocumented_quick_stop_is_refused_unsent():
    bench = Bench()
    with pytest.raises(NotSupported):
        bench.drive.stop(Stop.QUICK)
    assert not bench.sent


def test_reset_first_clears_the_run_bits_and_leaves_the_motor_stopped():
    bench = Bench()
    bench.drive.start()
    bench.drives[0].trip(3, bench.line.time)
    bench.sent.clear()
    bench.drive.reset()
    writes = [data for data in bench.sent if b"\x02" in data]
    assert writes == [asked("write", place=642, data="+385"), asked("write", place=1038, data="+100")]
    bench.line.advance(5)
    status = bench.drive.status()
    assert (status.fault, status.running) == (False, False)


def test_second_reset_resets_again():
    bench = Bench()
    for _ in range(2):
        bench.drives[0].trip(3, bench.line.time)
        bench.drive.reset()
        assert not bench.drive.status().fault


@pytest.mark.parametrize(("healthy", "running"), [(1, 0), (1, 1), (0, 0)])
def test_unidrive_classic_status_is_read_from_three_parameters(healthy, running):
    bench = Bench(model="unidrive-classic")
    bench.line.disturbances.append(Replies(told(1001, f"+{healthy}"), told(1002, f"+{running}"), told(1006, "+0")))
    status = bench.drive.status()
    assert (status.fault, status.running) == (not healthy, bool(running))
    assert bench.sent == [asked("read", place=place) for place in (1001, 1002, 1006)]


@pytest.mark.parametrize(
    "command",
    [
        lambda drive: drive.start(),
        lambda drive: drive.stop(),
        lambda drive: drive.reset(),
        lambda drive: drive.set_reference(hz=20),
        *[
            lambda drive, code=code: drive.write(code, 1)
            for code in ("01.21", "06.15", "6.30", "06.31", "06.32", "06.34", "06.39", "10.33", "06.42")
        ],
    ],
)
def test_command_to_a_unidrive_classic_is_refused_unsent(command):
    bench = Bench(model="unidrive-classic")
    with pytest.raises(NotSupported):
        command(bench.drive)
    assert not bench.sent


def test_short_commands_refer_to_the_last_parameter():
    bench = Bench(11, 12)
    first = told(1124, "+0")
    assert bench.hears(asked("read", place=1124)) == [first, None]
    assert bench.hears(b"\x15") == [first, None]
    assert bench.hears(b"\x06") == [told(1125, "+2"), None]
    assert bench.hears(b"\x06") == [b"\x04", None]
    assert bench.hears(b"\x08") == [first, None]
    assert bench.hears(asked("read", 12, 121)) == [None, told(121, "+0.0")]
    assert bench.hears(b"\x15") == [None, told(121, "+0.0")]


def test_rewrite_is_obeyed_by_the_last_addressed_drive():
    bench = Bench(11, 12)
    rewrite = asked("write", place=121, data="+12.5")[5:]
    assert bench.hears(rewrite) == [None, None]
    bench.hears(asked("read", place=121))
    assert bench.hears(rewrite) == [b"\x06", None]
    assert [drive.peek("01.21", 0.0) for drive in bench.drives] == [125, 0]


@pytest.mark.parametrize(("address", "raw"), [(10, [125, 125, 0]), (0, [125, 125, 125])])
def test_group_write_and_broadcast_are_obeyed_without_a_reply(address, raw):
    bench = Bench(11, 19, 21)
    assert bench.hears(asked("write", address, 121, "+12.5")) == [None] * 3
    assert [drive.peek("01.21", 0.0) for drive in bench.drives] == raw


@pytest.mark.parametrize("address", [0, 1, 10, 20, 100])
def test_group_address_is_refused_as_a_drive_address(address):
    with pytest.raises(AddressError):
        Bench().bus.drive("ct-ansi", address)


def test_damaged_write_is_refused_by_the_addressed_drive_only():
    bench = Bench(11, 12)
    telegram = bytearray(asked("write", place=121, data="+12.5"))
    telegram[-1] ^= 1
    (damaged, *_) = Framer(CODEC, "request").feed(bytes(telegram))
    first, second = (drive.hear(damaged, 0.0) for drive in bench.drives)
    assert (first.data, second) == (b"\x15", None)
    assert bench.drives[0].peek("01.21", 0.0) == 0


def test_drive_truncates_excess_decimals():
    bench = Bench()
    assert bench.hears(asked("write", place=121, data=" 1.2999")) == [b"\x06"]
    assert bench.drives[0].peek("01.21", 0.0) == 12


@pytest.mark.parametrize("data", ["+1.25", "X10"])
def test_value_that_does_not_fit_the_model_is_an_unexpected_reply(data):
    bench = Bench()
    bench.line.disturbances.append(Replies(*[told(121, data)] * 3))
    with pytest.raises(UnexpectedReplyError, match="check the model"):
        bench.drive.read("01.21")


def test_reply_for_another_parameter_is_rejected():
    bench = Bench()
    bench.line.disturbances.append(Replies(*[told(122, "+1.0")] * 3))
    with pytest.raises(drivecomm.ReplyError, match="parameter"):
        bench.drive.read("01.21")


def test_unlisted_parameter_accepts_whole_numbers_only():
    bench = Bench()
    with pytest.raises(ValueRefusedError, match="whole number"):
        bench.drive.write("02.11", "5.5")
    bench.line.disturbances.append(Replies(b"\x06"))
    bench.drive.write("02.11", 5)
    assert bench.sent == [asked("write", place=211, data="+5")]


def test_unknown_parameter_is_refused():
    with pytest.raises(RefusedError, match="no such parameter"):
        Bench().drive.read("20.01")


@pytest.mark.parametrize("parameter", ["121", "1.2", "100.00", "-1.21", "01.211", ""])
def test_malformed_parameter_address_is_refused_with_the_right_form(parameter):
    with pytest.raises(ParameterAddressError, match="write menu and parameter"):
        Bench().drive.read(parameter)


def test_unknown_parameter_type_is_refused():
    with pytest.raises(UsageError, match="types are s32"):
        Bench().drive.read("01.21", type="f32")


def test_silent_drive_raises_no_reply_error():
    bench = Bench()
    with pytest.raises(NoReplyError):
        bench.bus.drive("ct-ansi", 12).read("01.21")


@pytest.mark.parametrize("name", ["unidrive-sp", "unidrive-classic"])
def test_facts_from_memory_are_unconfirmed(name):
    for info in load_model("drivecomm_ct_ansi", "ct-ansi", name).parameters.values():
        assert (info.sure == "unconfirmed") == ("from memory" in info.source), info
