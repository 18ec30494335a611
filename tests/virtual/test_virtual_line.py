"""The virtual line: durations, receivers of each transmission, and faults on the way."""

from dataclasses import replace

import pytest

import drivecomm
from drivecomm.errors import AddressError, LinkDownError, NoReplyError, UsageError
from drivecomm.models import load_model
from drivecomm.plant import Fault, FaultPlan, Plant, PlantLine
from drivecomm.protocol import DriveConfig, Framed, Framer, LineSettings, Motor, VirtualReply, installed
from drivecomm.virtual import Station, VirtualLine, VirtualPlant, heard, virtual_drive
from drivecomm.virtual.station import stations_of
from drivecomm_vabus.telegrams import Ack, Enquiry, Select, telegrams

ENQUIRY = bytes.fromhex("0441303034383105")
SETTINGS = LineSettings(baudrate=9600, bytesize=7, parity="E")
PLUGINS = list(installed.working())


class Parrot:
    """A drive that answers everything for its address with ACK after a delay."""

    def __init__(self, address=1, settings=SETTINGS, delay_s=0.01):
        self.address = address
        self.settings = settings
        self.gap_s = 0.05
        self.motor = Motor()
        self.codec = telegrams()
        self.delay_s = delay_s
        self.heard = []

    def hear(self, find, now):
        self.heard.append((round(now, 6), find.data))
        address = getattr(getattr(find, "message", None), "address", None)
        if not isinstance(find, Framed) or address != self.address:
            return None
        return VirtualReply(data=self.codec.encode(Ack(address=self.address)), delay_s=self.delay_s)


def master(line, settings=SETTINGS):
    port = line.port()
    assert port.configure(settings) == ""
    return port


# Time


def test_characters_take_their_time():
    parrot = Parrot()
    port = master(VirtualLine([parrot]))
    port.write(ENQUIRY)
    assert port.now() == 0.0
    character = 10 / 9600
    assert port.read(1.0, 1) == b"\x41"
    # Eight characters of the request, the reply delay, one character of the reply.
    assert port.now() == pytest.approx(9 * character + 0.01)
    assert port.read(1.0, 1) == b"\x06"
    assert port.now() == pytest.approx(10 * character + 0.01)
    assert parrot.heard == [(pytest.approx(8 * character, abs=1e-5), ENQUIRY)]


def test_read_ends_at_its_time():
    port = master(VirtualLine([Parrot(delay_s=0.5)]))
    port.write(ENQUIRY)
    assert port.read(0.1, 1) == b""
    assert port.now() == 0.1
    assert port.read(2.0, 2) == b"\x41\x06"
    assert port.now() < 0.6


def test_read_of_more_bytes_than_come_returns_them_at_its_time():
    port = master(VirtualLine([Parrot()]))
    port.write(ENQUIRY)
    assert port.read(0.3, 10) == b"\x41\x06"
    assert port.now() == 0.3


def test_read_in_the_past_takes_no_time():
    port = master(VirtualLine())
    port.wait(1.0)
    assert port.read(0.5, 1) == b""
    port.wait(0.5)
    assert port.now() == port.wall_time() == 1.0


def test_bytes_sent_too_early_wait_for_the_line():
    parrot = Parrot()
    line = VirtualLine([parrot])
    port = master(line)
    port.write(ENQUIRY)
    port.write(b"\x04")
    port.wait(1.0)
    character = 10 / 9600
    assert parrot.heard[0][0] == pytest.approx(8 * character, abs=1e-5)
    assert port.read(1.1, 9) == b"\x41\x06"


def test_backlog_is_the_time_until_all_bytes_are_sent():
    line = VirtualLine([])
    port = master(line)
    port.write(ENQUIRY)
    port.write(ENQUIRY)
    assert line.backlog_s == pytest.approx(16 * 10 / 9600)
    line.advance(0.01)
    assert line.backlog_s == pytest.approx(16 * 10 / 9600 - 0.01)


def test_drive_sends_no_reply_during_a_transmission_of_its_master():
    line, speakers = VirtualLine([Parrot(delay_s=0.01)]), []
    line.monitors.append(lambda sent: speakers.append(sent.source))
    port = master(line)
    port.write(ENQUIRY)
    line.advance(8 * 10 / 9600 + 0.001)
    port.write(b"U" * 30)
    line.advance(1.0)
    assert speakers == ["master", "master"]
    port.write(ENQUIRY)
    line.advance(1.0)
    assert speakers[2:] == ["master", "drive"]


def test_stop_bits_count_in_the_duration():
    slow = LineSettings(baudrate=300, bytesize=8, stopbits=2)
    assert slow.character_s == pytest.approx(11 / 300)
    parrot = Parrot(settings=slow)
    port = master(VirtualLine([parrot]), slow)
    port.write(ENQUIRY)
    port.wait(8 * 11 / 300 - 0.001)
    assert parrot.heard == []
    port.wait(8 * 11 / 300 + 0.001)
    assert len(parrot.heard) == 1


# Receivers


def test_drive_receives_others_but_not_itself():
    one, two = Parrot(1), Parrot(2)
    port = master(VirtualLine([one, two]))
    port.write(ENQUIRY)
    port.wait(1.0)
    assert [data for _, data in one.heard] == [ENQUIRY]
    assert [data for _, data in two.heard] == [ENQUIRY], "a reply is noise to who expects requests"


def test_echo_precedes_the_reply():
    port = master(VirtualLine([Parrot()], echo=True))
    port.write(ENQUIRY)
    assert port.read(1.0, 10) == ENQUIRY + b"\x41\x06"


def test_injected_bytes_reach_drives_and_master():
    parrot = Parrot()
    line = VirtualLine([parrot])
    port = master(line)
    line.inject(b"\x7f" + ENQUIRY)
    assert port.read(1.0, 11) == b"\x7f" + ENQUIRY + b"\x41\x06"
    assert len(parrot.heard) == 1


def test_gap_ends_an_unfinished_telegram():
    parrot = Parrot()
    station = Station(parrot)
    assert station.hear(ENQUIRY[:4], 0.0, 0.004) == []
    assert station.hear(ENQUIRY[4:], 0.010, 0.014) != []
    assert station.hear(ENQUIRY[:4], 1.0, 1.004) == []
    assert station.hear(ENQUIRY, 1.1, 1.108) != []
    assert [data for _, data in parrot.heard] == [ENQUIRY, ENQUIRY[:4], ENQUIRY]


def test_telegram_ended_by_a_gap_is_received_when_the_next_comes():
    parrot = Parrot()
    station = Station(parrot)
    station.hear(b"\x04", 0.0, 0.001)
    assert parrot.heard == []
    station.hear(ENQUIRY, 0.5, 0.508)
    assert [data for _, data in parrot.heard] == [b"\x04", ENQUIRY]


# Mismatched settings


@pytest.mark.parametrize("bytesize", [7, 8])
@pytest.mark.parametrize("parity", ["N", "E", "O", "M", "S"])
@pytest.mark.parametrize("stopbits", [1, 1.5, 2])
def test_equal_settings_receive_every_byte(bytesize, parity, stopbits):
    settings = LineSettings(bytesize=bytesize, parity=parity, stopbits=stopbits)
    data = bytes(range(1 << bytesize))
    assert heard(data, settings, settings) == data


def test_seven_data_bits_lose_the_eighth():
    seven = LineSettings(bytesize=7)
    assert heard(b"\x80\xff", seven, seven) == b"\x00\x7f"


def test_wrong_baud_rate_gives_garbage():
    sender, receiver = LineSettings(baudrate=9600), LineSettings(baudrate=19200)
    assert heard(ENQUIRY, sender, receiver) != ENQUIRY
    assert heard(ENQUIRY, receiver, sender) != ENQUIRY
    assert 0 < len(heard(ENQUIRY, receiver, sender)) < len(ENQUIRY)
    assert len(heard(ENQUIRY, sender, receiver)) > len(ENQUIRY)


def test_wrong_parity_is_not_noticed():
    even, odd = LineSettings(bytesize=7, parity="E"), LineSettings(bytesize=7, parity="O")
    # The parity bit is not checked, as with the default settings of common receivers.
    assert heard(ENQUIRY, even, odd) == ENQUIRY


def test_bytes_sent_at_7e1_and_received_at_8n1_have_the_parity_in_bit_7():
    received = heard(ENQUIRY, LineSettings(bytesize=7, parity="E"), LineSettings(bytesize=8))
    assert bytes(byte & 0x7F for byte in received) == ENQUIRY
    assert received != ENQUIRY


def test_empty_transmission_is_received_empty():
    assert heard(b"", LineSettings(), LineSettings(baudrate=300)) == b""


def test_small_baud_rate_error_changes_nothing():
    nearly = LineSettings(baudrate=9700)
    assert heard(ENQUIRY, LineSettings(), nearly) == ENQUIRY


def test_drive_with_other_settings_does_not_answer():
    drive = virtual_drive("vabus", 1, baudrate=9600)
    line, speakers = VirtualLine([drive]), []
    line.monitors.append(lambda sent: speakers.append(sent.source))
    with drivecomm.open_bus(line.port) as bus:
        with pytest.raises(NoReplyError):
            bus.drive("vabus", 1, attempts=1).read("481")
        assert set(speakers) == {"master"}
        assert bus.drive("vabus", 1, baudrate=9600).read("481").raw == drive.peek("481", line.time)


# Faults


def disturbed(kind, **options):
    plan = FaultPlan(rate=1.0, kinds=[kind], **options)
    return plan, [plan.reply(b"0123456789") for _ in range(200)]


def test_fault_plan_of_rate_zero_changes_nothing():
    plan = FaultPlan(rate=0.0)
    assert plan.request(b"abc") == plan.reply(b"abc") == [(0.0, b"abc")]
    assert plan.happened == {}


def test_dropped_telegram_does_not_arrive():
    plan, arrivals = disturbed(Fault.DROP)
    assert arrivals == [[]] * 200
    assert plan.happened == {Fault.DROP: 200}


def test_corrupted_telegram_has_one_wrong_character():
    _, arrivals = disturbed(Fault.CORRUPT)
    for ((delay, data),) in arrivals:
        assert delay == 0
        assert sum(a != b for a, b in zip(data, b"0123456789", strict=True)) == 1


def test_corrupted_telegram_has_one_wrong_bit_with_bits_1():
    _, arrivals = disturbed(Fault.CORRUPT, bits=1)
    for ((_, data),) in arrivals:
        assert sum((a ^ b).bit_count() for a, b in zip(data, b"0123456789", strict=True)) == 1


def test_truncated_telegram_has_any_shorter_length():
    _, arrivals = disturbed(Fault.TRUNCATE)
    assert {len(data) for ((_, data),) in arrivals} == set(range(10))
    assert all(b"0123456789".startswith(data) for ((_, data),) in arrivals)


def test_delayed_telegram_arrives_within_delay_s():
    _, arrivals = disturbed(Fault.DELAY, delay_s=0.3)
    assert all(0 <= delay <= 0.3 and data == b"0123456789" for ((delay, data),) in arrivals)
    assert max(delay for ((delay, _),) in arrivals) > 0.25


def test_duplicated_telegram_arrives_twice():
    _, arrivals = disturbed(Fault.DUPLICATE)
    assert arrivals == [[(0.0, b"0123456789")] * 2] * 200


def test_equal_seeds_give_equal_faults():
    def course(seed):
        plan = FaultPlan(rate=0.5, seed=seed)
        return [plan.request(b"0123456789") for _ in range(100)]

    assert course(1) == course(1)
    assert course(1) != course(2)


def test_fault_plan_disturbs_only_one_direction():
    assert FaultPlan(rate=1.0, kinds=[Fault.DROP], requests=False).request(b"a") == [(0.0, b"a")]
    assert FaultPlan(rate=1.0, kinds=[Fault.DROP], replies=False).reply(b"a") == [(0.0, b"a")]


def test_duplicated_reply_follows_the_first():
    port = master(VirtualLine([Parrot()], faults=FaultPlan(rate=1.0, kinds=[Fault.DUPLICATE], requests=False)))
    port.write(ENQUIRY)
    assert port.read(1.0, 10) == b"\x41\x06\x41\x06"


def test_duplicated_request_is_received_twice():
    parrot = Parrot()
    port = master(VirtualLine([parrot], faults=FaultPlan(rate=1.0, kinds=[Fault.DUPLICATE], replies=False)))
    port.write(ENQUIRY)
    port.wait(1.0)
    assert [data for _, data in parrot.heard] == [ENQUIRY, ENQUIRY]


def test_truncation_to_nothing_is_silence():
    class Nothing(FaultPlan):
        def request(self, data):
            return [(0.0, data[:0])]

    parrot = Parrot()
    port = master(VirtualLine([parrot], faults=Nothing(rate=0.0)))
    port.write(ENQUIRY)
    assert port.read(1.0, 1) == b""
    assert parrot.heard == []


# A broken line


def test_broken_line_fails_every_use_of_its_port():
    line = VirtualLine()
    port = master(line)
    line.broken = True
    for use in (
        lambda: port.write(b"a"),
        lambda: port.read(1.0, 1),
        lambda: port.wait(1.0),
        lambda: port.configure(SETTINGS),
        line.port,
    ):
        with pytest.raises(LinkDownError, match="the virtual line is broken"):
            use()
    port.close()
    line.broken = False
    port.write(b"a")


# Virtual drives


def test_virtual_drive_is_made_by_protocol_name():
    drive = virtual_drive("vabus", 7, baudrate=9600, gap_s=0.1, ram_datasets=False)
    assert drive.address == 7
    assert drive.settings == LineSettings(baudrate=9600, bytesize=7, parity="E")
    assert drive.gap_s == 0.1
    assert virtual_drive("vabus", 7, model="act").peek("481", 0.0) == drive.peek("481", 0.0)


def test_impossible_virtual_drive_is_refused():
    with pytest.raises(AddressError, match="vabus has no drive at address 31"):
        virtual_drive("vabus", 31)
    with pytest.raises(UsageError, match=r"vabus drives have no option 'colour'; they have .*sys"):
        virtual_drive("vabus", 1, colour="red")
    with pytest.raises(UsageError, match="no model 'none'"):
        virtual_drive("vabus", 1, model="none")


@pytest.mark.parametrize("plugin", PLUGINS, ids=lambda plugin: plugin.name)
def test_every_protocol_answers_its_own_probe(plugin):
    addresses = [plugin.addresses[0], plugin.addresses[-1]]
    line = VirtualLine([virtual_drive(plugin.name, address) for address in addresses])
    with drivecomm.open_bus(line.port) as bus:
        for address in addresses:
            bus.drive(plugin.name, address, model=plugin.default_model).probe()
        with pytest.raises(NoReplyError):
            bus.drive(plugin.name, plugin.addresses[2], model=plugin.default_model).probe()


def test_drives_of_all_protocols_share_a_line_and_ignore_each_other():
    settings = {"baudrate": 9600, "bytesize": 8, "parity": "N"}
    # Some telegrams of Huanyang drives are also Modbus ones: the two protocols must not share an address here.
    addresses = {plugin.name: plugin.addresses[4 if plugin.name == "huanyang" else 3] for plugin in PLUGINS}
    drives = {name: virtual_drive(name, address, **settings) for name, address in addresses.items()}
    line = VirtualLine(drives.values())
    with drivecomm.open_bus(line.port, **settings) as bus:
        for _ in range(3):
            for plugin in PLUGINS:
                name = plugin.parameter_examples[0]
                model = load_model(plugin.package, plugin.name, plugin.default_model)
                reading = bus.drive(plugin.name, addresses[plugin.name], model=model).read(name)
                assert reading.raw == drives[plugin.name].peek(name, line.time)
        assert all(not counter["retries"] and not counter["damaged"] for counter in bus.counters.values())


def test_trip_of_a_virtual_drive_shows_in_its_status():
    drive = virtual_drive("vabus", 1)
    line = VirtualLine([drive])
    with drivecomm.open_bus(line.port) as bus:
        drive.trip(0x0103, line.time)
        status = bus.drive("vabus", 1).status()
    assert status.fault
    assert status.fault_code == 0x0103


def test_references_beyond_any_motor_do_not_break_a_virtual_drive():
    # 480 has no limits in the model; the sum with the percentage no longer fits parameter 283.
    drive = virtual_drive("vabus", 1)
    codec = telegrams()

    def hear(message, now):
        return drive.hear(Framed(codec.encode(message), message), now)

    assert hear(Select(address=1, dataset=5, parameter=520, data="7FFF"), 1.0)
    assert hear(Select(address=1, dataset=5, parameter=480, data="7FFFFFFF"), 2.0)
    assert hear(Enquiry(address=1, parameter=283), 3.0)


@pytest.mark.parametrize("sender", [LineSettings(stopbits=2), LineSettings(stopbits=1.5), LineSettings(parity="M")])
def test_longer_stop_bit_is_received(sender):
    assert heard(ENQUIRY, sender, LineSettings()) == ENQUIRY


@pytest.mark.parametrize("plugin", PLUGINS, ids=lambda plugin: plugin.name)
def test_line_facts_of_a_model_apply_to_virtual_drive_and_master(plugin):
    known = load_model(plugin.package, plugin.name, plugin.default_model)
    model = replace(known, options={**known.options, "baudrate": 4800, "gap_s": 0.05})
    address = plugin.addresses[0]
    virtual = virtual_drive(plugin.name, address, model=model)
    drive = drivecomm.open_bus(VirtualLine([virtual]).port).drive(plugin.name, address, model=model)
    assert (virtual.settings, virtual.gap_s) == (drive.facts.settings, drive.facts.gap_s)
    assert (virtual.settings.baudrate, virtual.gap_s) == (4800, 0.05)
    assert virtual_drive(plugin.name, address, model=model, baudrate=9600).settings.baudrate == 9600


@pytest.mark.parametrize(
    "make",
    [
        lambda **options: virtual_drive("vabus", 1, **options),
        lambda **options: drivecomm.decode("vabus", b"\x04", direction="request", **options),
        lambda **options: drivecomm.open_bus(VirtualLine().port).drive("vabus", 1, **options),
    ],
)
def test_unknown_option_is_refused_with_a_suggestion(make):
    with pytest.raises(UsageError, match=r"vabus drives have no option 'ram_dataset'; did you mean 'ram_datasets'\?"):
        make(ram_dataset=True)


def test_unknown_line_setting_of_a_plant_is_refused_with_a_suggestion():
    line = PlantLine(name="hall", settings={"baud": 9600})
    plant = Plant(lines=(line,), drives=(DriveConfig(protocol="vabus", address=1, line="hall"),))
    with pytest.raises(UsageError, match=r"unknown line setting 'baud'; did you mean 'baudrate'\?"):
        VirtualPlant(plant)


def test_transmission_is_parsed_once_for_drives_of_the_same_codec(monkeypatch):
    fed = []
    monkeypatch.setattr("drivecomm.virtual.station.Framer", lambda *of: fed.append(of) or Framer(*of))
    line = VirtualLine([virtual_drive("vlt3500", address) for address in range(1, 31)])
    with drivecomm.open_bus(line.port) as bus:
        assert bus.drive("vlt3500", 30).read("516").raw is not None
    assert len(fed) == 2


def test_drives_with_different_codecs_share_no_parser():
    line = VirtualLine([virtual_drive("danfoss-fc", 1, pnu_bits=bits) for bits in (12, 11)])
    heard_by = [station.known for station in stations_of(line.drives)]
    assert heard_by[0] is not heard_by[1]
