"""USS checked against printed bytes and numbers, to catch mistakes that master and virtual drive share."""

from decimal import Decimal

import pytest

import drivecomm
from drivecomm.errors import ParameterAddressError, StateError, TelegramError, ValueRefusedError
from drivecomm.protocol import Framed, installed
from drivecomm.virtual import VirtualLine, virtual_drive
from drivecomm_uss.tasks import error_text

PLUGIN = installed["uss"]


class Talk:
    """A drive on a line, and the telegrams of its master."""

    def __init__(self, model="micromaster4"):
        self.requests = []
        self.virtual = virtual_drive("uss", 3, model=model)
        self.line = VirtualLine([self.virtual])
        self.bus = drivecomm.open_bus(self.line.port, trace=self._trace)
        self.drive = self.bus.drive("uss", 3, model=model)

    def _trace(self, event):
        if event.what == "sent":
            self.requests.append(event.message)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.bus.close()


@pytest.fixture
def talk():
    with Talk() as talk:
        yield talk


def encoded(**fields):
    return drivecomm.encode("uss", fields, direction="request")


@pytest.mark.parametrize(("field", "write"), [(1, True), (2, False)])
def test_ind_bit_9_selects_the_second_text_field_and_bit_8_writes(field, write):
    """Compendium Motion Control p. 8.1-14."""
    codec = PLUGIN.codec(PLUGIN.options(ind="masterdrives"))
    fields = {"address": 1, "ak": 15, "pnu": 7, "index": 0, "page": 0, "text_field": field, "text_write": write}
    fields |= {"text": "AB"} if write else {}
    data = codec.encode(PLUGIN.message({**fields, "control_word": 0, "reference": 0}, "request"))
    assert data[5] == (0x02 if field == 2 else 0) | write
    found = codec.decode(data, "request")
    assert (found.text_field, found.text_write) == (field, write)


def test_text_in_a_fixed_parameter_area_is_refused():
    codec = PLUGIN.codec(PLUGIN.options(ind="masterdrives", pkw_words=4))
    fields = {"address": 1, "ak": 15, "pnu": 7, "index": 0, "page": 0, "text_field": 1, "text_write": True}
    with pytest.raises(TelegramError, match="text"):
        codec.encode(PLUGIN.message({**fields, "text": "ABCD", "control_word": 0, "reference": 0}, "request"))


def test_telegram_of_odd_length_is_refused():
    with pytest.raises(TelegramError):
        drivecomm.decode("uss", bytes.fromhex("02 0B 01 10 34 00 00 00 00 00 00 00 2C"), direction="request")
    assert PLUGIN.codec(PLUGIN.options()).measure(bytes.fromhex("02 0B"), "reply") == 0


def test_float_is_read_as_the_shortest_decimal_of_its_bits(talk):
    talk.virtual.poke("1082", 0x42480000)
    assert talk.drive.read("1082").value == 50
    talk.virtual.poke("1082", 0x3DCCCCCD)
    assert str(talk.drive.read("1082").value) == "0.1"
    talk.virtual.poke("1082", 0x3F800001)
    assert talk.drive.read("1082").value == Decimal("1.0000001")


def test_value_that_no_32_bit_float_holds_is_refused(talk):
    with pytest.raises(ValueRefusedError, match="not rounded"):
        talk.drive.write("1082", Decimal("12.3456789012"))
    assert talk.drive.write("1082", Decimal("12.3")).value == Decimal("12.3")


@pytest.mark.parametrize(("task", "answer", "other"), [(7, 4, 5), (12, 4, 5), (8, 5, 4), (11, 5, 4)])
def test_reply_ak_must_match_the_array_task(task, answer, other):
    """USS specification table 4.2."""
    place = {"address": 1, "pnu": 4, "index": 2, "page": 0, "value": 1}
    request = PLUGIN.message({**place, "ak": task, "control_word": 0, "reference": 0}, "request")
    for ak, wanted in ((answer, ""), (other, "ak")):
        reply = PLUGIN.message({**place, "ak": ak, "status_word": 0, "actual": 0}, "reply")
        assert PLUGIN.mismatch(request, reply) == wanted


def test_array_element_is_read_by_task_6(talk):
    talk.drive.read("2014[1]")
    assert (talk.requests[-1].ak, talk.requests[-1].index) == (6, 1)
    talk.drive.read("1082")
    assert talk.requests[-1].ak == 1


def test_broadcast_stop_enables_only_its_stop_bit(talk):
    """USS specification, Appendix 2 to 4; no bit of word b may start a motor."""
    for how, bit in (("ramp", 0b001), ("coast", 0b011), ("quick", 0b101)):
        talk.bus.broadcast("uss").stop(drivecomm.Stop(how))
        request = talk.requests[-1]
        assert request.enable == (3, bit, 0, 0)
        assert not request.control_word & bit


def test_reference_of_100_percent_is_4000_hex_and_bit_11_reverses(talk):
    """NORD p. 46: 50 % is 2000H; V20 p. 112: 0C7F runs backwards."""
    talk.drive.set_reference(percent=50)
    assert talk.requests[-1].reference == 0x2000
    talk.drive.start(reverse=True)
    assert talk.requests[-2].control_word == 0x0C7F


def test_start_of_a_drive_with_a_fault_is_refused(talk):
    talk.drive.set_reference(percent=50)
    talk.virtual.trip(70, talk.line.time)
    with pytest.raises(StateError, match="has a fault"):
        talk.drive.start()
    assert all(not request.control_word & 1 for request in talk.requests)


def test_virtual_drive_ignores_a_control_word_without_bit_10(talk):
    talk.drive.set_reference(percent=50)
    talk.drive.start()
    talk.line.advance(20)
    talk.drive.call("control_word", word=0x007E)
    talk.line.advance(5)
    assert talk.virtual.motor.running


def test_virtual_drive_starts_by_an_edge_only(talk):
    talk.drive.call("control_word", word=0x047F)
    talk.drive.call("control_word", word=0x047F)
    assert not talk.virtual.motor.running
    talk.drive.call("control_word", word=0x047E)
    talk.drive.call("control_word", word=0x047F)
    assert talk.virtual.motor.running
    talk.virtual.trip(70, talk.line.time)
    talk.drive.call("control_word", word=0x04FF)
    talk.drive.call("control_word", word=0x047F)
    assert not talk.virtual.motor.running


def test_error_number_has_the_text_of_its_family():
    """CU09 p. 158, G120C p. 220, BU 0050."""
    assert error_text(201, "siemens") == "above the present limit"
    assert error_text(201, "nord") == "invalid order label"
    assert error_text(0x87, "g120") == "know-how protection"
    assert error_text(0x87, "siemens") == "unlisted error 135"


def test_start_of_a_running_motor_does_not_interrupt_it(talk):
    talk.drive.set_reference(percent=50)
    talk.drive.start()
    talk.line.advance(20)
    before = len(talk.requests)
    talk.drive.start()
    assert [request.control_word for request in talk.requests[before:]] == [0, 0x047F]


def test_reads_of_a_g120_carry_the_running_control_word():
    with Talk("g120") as talk:
        talk.drive.set_reference(percent=50)
        talk.drive.start()
        talk.line.advance(20)
        before = len(talk.requests)
        talk.drive.read("2022")
        talk.drive.status()
        assert {(request.control_word, request.reference) for request in talk.requests[before:]} == {(0x047F, 0x2000)}


def test_start_during_a_quick_stop_waits_until_the_drive_is_ready(talk):
    talk.drive.set_reference(percent=50)
    talk.drive.start()
    talk.line.advance(20)
    talk.drive.stop(drivecomm.Stop.QUICK)
    assert talk.drive.status().state is drivecomm.DriveState.STOPPING
    before = len(talk.requests)
    talk.drive.start()
    assert 0x047E in [request.control_word for request in talk.requests[before:]]
    talk.line.advance(20)
    assert talk.virtual.motor.running


def test_negative_word_of_a_nord_drive_has_a_high_word_of_ones():
    """BU 0050 p. 42."""
    with Talk("nord") as talk:
        assert talk.drive.write("400", -100).value == -100
        assert talk.requests[-1].pwe == (0xFFFF, 0xFF9C)
        talk.drive.write("400", 100)
        assert talk.requests[-1].pwe is None


READ_P1082 = bytes.fromhex("02 0C 03 14 3A 00 00 00 00 00 00 00 00 23")


@pytest.mark.parametrize(
    ("given", "characters", "answered"), [({}, 1.9, False), ({}, 2.1, True), ({"gap_s": 0.050}, 2.1, False)]
)
@pytest.mark.parametrize("baudrate", [9600, 38400])
def test_drive_starts_a_new_telegram_after_two_characters_of_silence(given, characters, answered, baudrate):
    """USS specification A-8; the bytes received before look like the start of a telegram."""
    drive = virtual_drive("uss", 3, baudrate=baudrate, **given)
    port = VirtualLine([drive]).port()
    port.configure(drive.settings)
    port.write(bytes.fromhex("02 30 03"))
    port.wait(port.now() + drive.settings.wire_s(3 + characters))
    port.write(READ_P1082)
    assert bool(port.read(port.now() + 0.2, 1)) is answered


def test_start_takes_over_the_reference_that_the_drive_holds():
    with Talk("v20") as talk:
        talk.drive.set_reference(percent=-25)
        talk.drive.start()
        talk.line.advance(20)
        talk.drive.stop()
        talk.line.advance(20)
        with drivecomm.open_bus(talk.line.port) as other:
            other.drive("uss", 3, model="v20").start()
            talk.line.advance(20)
            status = other.drive("uss", 3, model="v20").status()
        assert (status.running, status.reverse, status.actual_percent) == (True, True, -25)


def test_index_number_or_set_beyond_the_telegram_is_refused_unsent():
    options = PLUGIN.options()
    with Talk("nord") as nord, Talk() as siemens:
        for talk, parameter, further in (
            (nord, "400[64]", {}),
            (nord, "2048", {}),
            (nord, "400", {"parameter_set": 5}),
            (siemens, "2014[255]", {}),
            (siemens, "128000", {}),
            (siemens, "700", {"parameter_set": 2}),
        ):
            with pytest.raises(ParameterAddressError, match="there are"):
                talk.drive.read(parameter, **further)
        assert not nord.requests
        assert not siemens.requests
    assert len([*PLUGIN.address_space(options, None).addresses()]) == 30_000


def test_nord_drive_turns_clockwise_without_a_direction_bit():
    """BU 0050 p. 46: 047F and 2000H turn clockwise at 50 %, and the drive replies 0F37."""
    with Talk("nord") as talk:
        for word in (0x047E, 0x047F):
            talk.drive.set_reference(percent=50)
            talk.drive.call("control_word", word=word)
        talk.line.advance(30)
        status = talk.drive.status()
        assert (status.actual_percent, status.reverse) == (50, False)


@pytest.mark.parametrize(("flag", "turns"), [(3, False), (2, True)])
def test_broadcast_without_its_flag_is_ignored(talk, flag, turns):
    talk.drive.set_reference(percent=50)
    talk.drive.start()
    codec = talk.virtual.codec
    fields = {"broadcast": True, "enable": (flag, 1, 0, 0), "control_word": 0x043E, "reference": 0}
    message = PLUGIN.message(fields, "request")
    talk.virtual.hear(Framed(codec.encode(message), message), talk.line.time)
    talk.line.advance(30)
    talk.virtual.follow(talk.line.time)
    assert talk.virtual.motor.running is turns
