"""Open plants: drives by name, read-only unless armed, their status, and the plant file that a scan writes."""

import asyncio
from dataclasses import replace
from pathlib import Path
from threading import Barrier
from unittest.mock import Mock

import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

import drivecomm
from drivecomm.bus import Found, ReadOnly
from drivecomm.errors import FileFormatError, NoReplyError, ReadOnlyError, UsageError
from drivecomm.plant import (
    OpenPlant,
    Plant,
    PlantLine,
    ScannedLine,
    add_scanned,
    open_plant,
    plant_status,
    plant_text,
    read_plant,
    scanned_plant,
    scanned_text,
)
from drivecomm.protocol import (
    NETWORK_VERBS,
    Ask,
    DriveConfig,
    Intent,
    LineSettings,
    LinkLossPolicy,
    MachineUnit,
    NetworkAccess,
    Pause,
    PollGroup,
    Tell,
    installed,
)
from drivecomm.testing import play
from drivecomm.tomlfile import must_be_writable, write_atomically
from drivecomm.virtual import VirtualLine, VirtualPlant
from drivecomm_vabus.telegrams import Select

PLANT = Plant(
    lines=(PlantLine(name="hall"), PlantLine(name="yard")),
    drives=(
        DriveConfig(name="pump", protocol="vabus", address=1, line="hall", options={"model": "agile"}, armed=True),
        DriveConfig(name="fan", protocol="danfoss-fc", address=3, line="hall", options={"model": "fc300"}),
        DriveConfig(name="mixer", protocol="fuji", address=2, line="yard"),
        DriveConfig(name="belt", protocol="vlt3500", address=5, line="yard"),
    ),
)


class OpenedVirtualPlant:
    """Virtual plant that a master has opened; records the sent telegrams and the opened lines."""

    def __init__(self, plant=PLANT):
        self.virtual = VirtualPlant(plant)
        self.opened_lines = []
        self.sent = []
        self.plant = OpenPlant(plant, "hall.toml", port_of=self.port_of, trace=self.note)

    def port_of(self, line):
        self.opened_lines.append(line.name)
        return self.virtual.line(line.name).port

    def note(self, event):
        if event.what == "sent":
            self.sent.append(event)


@pytest.fixture
def served():
    one = OpenedVirtualPlant()
    with one.plant:
        yield one


def test_line_is_opened_when_its_first_drive_is_requested(served):
    assert list(served.plant.drives) == ["pump", "fan", "mixer", "belt"]
    assert len(served.plant.drives) == 4
    assert served.opened_lines == []
    assert str(served.plant.drive("pump").read("480")) == "30.00 Hz"
    assert served.opened_lines == ["hall"]
    assert served.plant.drives["fan"] is served.plant.drive("danfoss-fc:3")
    assert served.opened_lines == ["hall"]
    assert served.plant.bus("yard") is served.plant.bus("yard")
    assert served.opened_lines == ["hall", "yard"]


def test_unknown_names_are_refused(served):
    with pytest.raises(UsageError, match=r"hall.toml: there is no drive 'door' in this plant; it has pump, fan"):
        served.plant.drive("door")
    with pytest.raises(KeyError):
        served.plant.drives["danfoss-fc:3"]
    with pytest.raises(UsageError, match=r"hall.toml: there is no line 'cellar' in this plant; it has hall, yard"):
        served.plant.bus("cellar")


GROUPED = {"pump": ("wet", "hall 2"), "fan": ("hall 2",), "mixer": ("wet",), "belt": ()}
GROUPS = replace(PLANT, drives=tuple(replace(each, groups=GROUPED[each.name]) for each in PLANT.drives))


def test_group_returns_its_drives_in_the_order_of_the_plant_and_opens_their_lines():
    served = OpenedVirtualPlant(GROUPS)
    with served.plant as plant:
        assert plant.group("hall 2") == [plant.drive("pump"), plant.drive("fan")]
        assert served.opened_lines == ["hall"]
        assert plant.group("wet") == [plant.drive("pump"), plant.drive("mixer")]
        assert served.opened_lines == ["hall", "yard"]
    assert list(GROUPS.groups) == ["wet", "hall 2"]


@pytest.mark.parametrize("name", ["pump", "belt", "vabus:1", "dry", ""])
def test_unknown_group_is_refused(name):
    with pytest.raises(UsageError, match=f"hall.toml: there is no group '{name}' in this plant; .*t has wet, hall 2"):
        OpenedVirtualPlant(GROUPS).plant.group(name)


def test_group_is_refused_in_a_plant_without_groups(served):
    with pytest.raises(UsageError, match="there is no group 'wet' in this plant; it has none"):
        served.plant.group("wet")


def test_drive_refuses_a_group_and_lists_its_drives():
    with pytest.raises(UsageError, match=r"hall.toml: 'hall 2' is a group, of pump, fan; name one of its drives$"):
        OpenedVirtualPlant(GROUPS).plant.drive("hall 2")
    assert [each.name for each in GROUPS.named("wet")] == ["pump", "mixer"]
    assert [each.name for each in GROUPS.named("vabus:1")] == ["pump"]


def test_armed_drive_may_be_commanded(served):
    pump = served.plant.drive("pump")
    pump.write("480", "12.5")
    pump.start()
    assert served.virtual.drive("pump").motor.running


COMMANDS = {
    "write": lambda drive: drive.write("1", 1),
    "write_and_read": lambda drive: drive.write_and_read("1", 1),
    "write and store": lambda drive: drive.write("1", 1, store=True),
    "start": lambda drive: drive.start(),
    "reverse": lambda drive: drive.reverse(),
    "reset": lambda drive: drive.reset(),
    "reference in percent": lambda drive: drive.set_reference(percent=10),
    "reference in hertz": lambda drive: drive.set_reference(hz=10),
}


VERBS = {
    "jog": {"number": 1},
    "hold": {},
    "select_setup": {"number": 1},
    "select_preset": {"number": 1},
    "set_relay": {"number": 1, "on": True},
}


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("name", ["fan", "mixer", "belt"])
def test_read_only_drive_refuses_every_command(served, name, command):
    drive = served.plant.drive(name)
    with pytest.raises(UsageError) as refusal:
        COMMANDS[command](drive)
    assert str(refusal.value) == f"{name} is read-only in hall.toml; write armed = true there"
    assert served.sent == []


def test_commanding_verb_of_a_read_only_drive_sends_no_command(served):
    refused = 0
    for name in ("fan", "mixer", "belt"):
        drive = served.plant.drive(name)
        for verb, arguments in VERBS.items():
            if verb not in drive.capabilities.verbs:
                continue
            with pytest.raises(UsageError, match=f"^{name} is read-only"):
                drive.call(verb, **arguments)
            refused += 1
    assert refused >= 6
    with pytest.raises(UsageError, match="read-only"):
        served.plant.drive("fan").call("control_word", word=0x047C)
    for event in served.sent:
        assert installed[event.drive.partition(":")[0]].intent(event.message).only_asks, event


def test_read_only_drive_may_be_read_and_stopped(served):
    for name in ("fan", "mixer", "belt"):
        drive = served.plant.drive(name)
        drive.probe()
        drive.status()
        drive.identify()
        drive.stop()
    intents = [(event.drive, installed[event.drive.partition(":")[0]].intent(event.message)) for event in served.sent]
    asked = {drive for drive, intent in intents if not intent.only_asks}
    assert asked == {"danfoss-fc:3", "fuji:2", "vlt3500:5"}


def test_read_only_drive_cannot_be_set_up():
    served = OpenedVirtualPlant()
    with served.plant as plant, pytest.raises(UsageError, match="cannot be set up, because it is read-only"):
        plant.bus("hall").drive("vabus", 1, set_up={"480": 1}, read_only=True)


def test_read_only_drive_refuses_a_verb_that_sends_an_unanswered_telegram():
    """A telegram without a reply can command a drive, too."""
    vabus = installed["vabus"]

    class Shouting:
        def __init__(self, operations):
            self._operations = operations

        def __getattr__(self, name):
            return getattr(self._operations, name)

        @property
        def extra(self):
            return {"shout": self.shout}

        def shout(self):
            yield Tell(message=Select(address=1, parameter=410, data="000F"))

    shouting = replace(vabus, name="shouting", operations=lambda *given: Shouting(vabus.operations(*given)))
    take_away = installed.register(shouting)
    try:
        sent = []
        with drivecomm.open_bus(VirtualLine([]).port, trace=sent.append) as bus:
            bus.drive("shouting", 1).call("shout")
            assert len(sent) == 1
            with pytest.raises(ReadOnlyError, match=r"^shouting:1 is read-only; leave read_only=True out"):
                bus.drive("shouting", 1, read_only=True).call("shout")
            assert len(sent) == 1
    finally:
        take_away()


def test_awaited_read_only_drive_refuses_a_start():
    virtual = VirtualPlant(PLANT)

    async def start():
        async with drivecomm.open_bus_async(virtual.line("hall").port) as bus:
            drive = bus.drive("vabus", 1, read_only=True)
            drive.read_only_reason = "not today"
            assert drive.read_only_reason == "not today"
            await drive.start()

    with pytest.raises(ReadOnlyError, match=r"^not today$"):
        asyncio.run(start())


def test_reading_verb_of_a_read_only_drive_runs_and_gets_errors():
    def asking():
        yield Pause(seconds=1)
        try:
            yield Ask(message="ask")
        except NoReplyError:
            return (yield Ask(message="ask"))

    def commanding():
        yield Ask(message="ask")
        yield Ask(message="go")

    def choosing():
        yield from ()

    operations = Mock(extra={"look": asking, "move": commanding, "choose": choosing})
    ask_only = ReadOnly(lambda: operations, "no", lambda message: Intent(commands=message != "ask"))
    assert play(ask_only.extra["look"](), [("ask", NoReplyError("silence")), ("ask", "here")]) == "here"
    with pytest.raises(UsageError, match="no"):
        play(ask_only.extra["move"](), [("ask", "here")])
    with pytest.raises(UsageError, match="no"):
        play(ask_only.extra["choose"](), [])
    unknown = ReadOnly(lambda: operations, "no", None)
    with pytest.raises(UsageError, match="no"):
        play(unknown.extra["look"](), [])


def test_invalid_options_are_reported_with_the_drive_and_the_file():
    wrong = DriveConfig(name="pump", protocol="vabus", address=1, line="hall", options={"modle": "agile"})
    with (
        OpenedVirtualPlant(Plant(lines=(PlantLine(name="hall"),), drives=())).plant as plant,
        pytest.raises(UsageError, match=r"hall.toml: there is no drive"),
    ):
        plant.drive("pump")
    with pytest.raises(UsageError, match=r"drive pump: vabus drives have no option 'modle'"):
        VirtualPlant(Plant(lines=(PlantLine(name="hall"),), drives=(wrong,)))
    virtual = VirtualPlant(Plant(lines=(PlantLine(name="hall"),)))
    plant = OpenPlant(
        Plant(lines=(PlantLine(name="hall"),), drives=(wrong,)), "x.toml", port_of=lambda _: virtual.line("hall").port
    )
    with plant, pytest.raises(UsageError, match=r"x.toml: drive pump: vabus drives have no option 'modle'"):
        plant.drive("pump")


def test_plant_is_opened_from_a_file(tmp_path):
    path = tmp_path / "plant.toml"
    path.write_text('format = 1\n[[line]]\nname = "hall"\n[[drive]]\ndrive = "vabus:1"\n')
    with open_plant(path) as plant, pytest.raises(UsageError, match="line hall has no port; write port ="):
        plant.drive("vabus:1")
    with pytest.raises(FileFormatError, match="there is no such file"):
        open_plant(tmp_path / "none.toml")


def test_ambiguous_address_is_refused_with_the_drive_names():
    twice = Plant(
        lines=PLANT.lines,
        drives=tuple(DriveConfig(name=line, protocol="vabus", address=1, line=line) for line in ("hall", "yard")),
    )
    with pytest.raises(UsageError, match="several lines of this plant; name the drive: hall and yard"):
        twice.drive("vabus:1")
    assert twice.drive("yard").line == "yard"


@pytest.mark.parametrize(
    ("said", "reached"),
    [
        ({"port": "/dev/ttyUSB0", "listen": "tcp:127.0.0.1:4001"}, "/dev/ttyUSB0"),
        ({"listen": "tcp:127.0.0.1:4001"}, "socket://127.0.0.1:4001"),
        ({"listen": "tcp:4001"}, "socket://127.0.0.1:4001"),
        ({"listen": "rfc2217:[::1]:4001"}, "rfc2217://[::1]:4001"),
        ({"listen": "pty:/tmp/line"}, "/tmp/line"),
        ({"listen": "tcp:127.0.0.1:0"}, ""),
        ({"listen": "carrier:pigeon"}, ""),
        ({}, ""),
    ],
)
def test_line_is_reached_at_its_port_or_its_listening_address(said, reached):
    assert PlantLine(name="hall", **said).reached_at == reached


def test_line_is_opened_with_the_settings_of_the_plant():
    line = PlantLine(name="hall", echo=True, settings={"baudrate": 9600})
    plant = Plant(lines=(line,), drives=(DriveConfig(name="pump", protocol="vabus", address=1, line="hall"),))
    virtual = VirtualPlant(plant)
    with OpenPlant(plant, port_of=lambda _: virtual.line("hall").port) as opened:
        assert opened.drive("pump").facts.settings.baudrate == 9600
        opened.drive("pump").probe()
    with OpenPlant(plant, port_of=lambda _: virtual.line("hall").port, baudrate=19200) as opened:
        assert opened.drive("pump").facts.settings.baudrate == 19200
        assert opened.bus("hall").drive("vabus", 2).facts.settings.baudrate == 19200


def test_drive_requested_after_closing_opens_its_line_again():
    plant = Plant(
        lines=(PlantLine(name="hall"),), drives=(DriveConfig(name="pump", protocol="vabus", address=1, line="hall"),)
    )
    virtual = VirtualPlant(plant)
    opened = OpenPlant(plant, port_of=lambda _: virtual.line("hall").port)
    before = opened.drive("pump")
    assert opened.drive("pump") is before
    opened.close()
    with pytest.raises(UsageError, match="closed"):
        before.probe()
    opened.drive("pump").probe()
    opened.bus("hall").drive("vabus", 1).probe()
    opened.close()


class TestStatus:
    def test_status_reports_all_drives_in_plant_order(self):
        served = OpenedVirtualPlant()
        served.virtual.power_off("belt")
        with served.plant as plant:
            served.virtual.trip("fan", 14)
            reports = plant_status(plant)
        assert [report.drive.name for report in reports] == ["pump", "fan", "mixer", "belt"]
        assert [report.exit_code for report in reports] == [0, 5, 0, 4]
        assert reports[0].output_hz == 0
        assert reports[1].status.fault_text == "earth fault"
        assert reports[3].status is None
        assert "did not answer" in str(reports[3].error)
        for event in served.sent:
            assert installed[event.drive.partition(":")[0]].intent(event.message).only_asks, event

    def test_status_reports_other_lines_if_one_cannot_be_opened(self):
        virtual = VirtualPlant(PLANT)
        tried = []

        def port_of(line):
            if line.name == "hall":
                tried.append(line.name)
                raise drivecomm.PortError("port hall does not exist")
            return virtual.line(line.name).port

        with OpenPlant(PLANT, port_of=port_of) as plant:
            reports = plant_status(plant)
        assert [report.exit_code for report in reports] == [3, 3, 0, 0]
        assert tried == ["hall"]

    def test_status_reads_all_lines_concurrently(self):
        virtual = VirtualPlant(PLANT)
        both = Barrier(2, timeout=20)

        def port_of(line):
            # Passes only while the other line is being opened, too.
            both.wait()
            return virtual.line(line.name).port

        with OpenPlant(PLANT, port_of=port_of) as plant:
            assert [report.exit_code for report in plant_status(plant)] == [0, 0, 0, 0]

    def test_status_leaves_a_refused_value_out(self, tmp_path):
        model = tmp_path / "odd.toml"
        model.write_text(
            'format = 1\nprotocol = "vabus"\nname = "odd"\nextends = "agile"\n[quantities]\noutput_current = "1599"\n'
        )
        odd = DriveConfig(name="pump", protocol="vabus", address=1, line="hall", options={"model": str(model)})
        plant = Plant(lines=(PlantLine(name="hall"),), drives=(odd,))
        virtual = VirtualPlant(Plant(lines=plant.lines, drives=(replace(odd, options={"model": "agile"}),)))
        with OpenPlant(plant, port_of=lambda _: virtual.line("hall").port) as opened:
            (report,) = plant_status(opened)
        assert report.error is None
        assert report.current_a is None
        assert report.output_hz == 0

    def test_status_does_not_hide_programming_errors(self):
        def port_of(line):
            raise RuntimeError(line.name)

        with OpenPlant(PLANT, port_of=port_of) as plant, pytest.raises(RuntimeError):
            plant_status(plant)


# The plant file that a scan writes


def found(protocol="vabus", address=1, sound=True, **options):
    given_settings = options.pop("settings", LineSettings(baudrate=9600, bytesize=7, parity="E"))
    return Found(protocol=protocol, address=address, sound=sound, settings=given_settings, **options)


def read_text(text, path: Path):
    path.write_text(text, encoding="utf-8")
    return read_plant(path)


def test_scanned_drives_are_read_back_from_the_plant_file(tmp_path):
    other = LineSettings(baudrate=19200, parity="E", stopbits=1.5)
    drives = [
        found(),
        found("danfoss-fc", 3, settings=other, model="fc300", identity={"FC type": 'FC-"302"\x07\n'}),
        found("fuji", 2, sound=False, detail="checksum"),
    ]
    text = scanned_text([ScannedLine(port="COM3", found=drives, echo=True)])
    plant = read_text(text, tmp_path / "plant.toml")
    assert plant.lines == (PlantLine(name="COM3", port="COM3", echo=True),)
    assert [drive.name for drive in plant.drives] == ["vabus:1", "danfoss-fc:3"]
    assert plant.drives[1].options == {
        "model": "fc300",
        "baudrate": 19200,
        "bytesize": 8,
        "parity": "E",
        "stopbits": 1.5,
    }
    assert not any(drive.armed for drive in plant.drives)
    assert (text.count('# name = "pump1"'), text.count('# name = "pump2"')) == (1, 1)
    assert '# FC type FC-"302"' in text
    assert "# fuji:2 answered with damage only" in text


def test_settings_shared_by_all_drives_belong_to_the_line(tmp_path):
    plant = read_text(
        scanned_text([ScannedLine(port="COM3", found=[found(), found(address=2)])]), tmp_path / "plant.toml"
    )
    assert plant.lines[0].settings == {"baudrate": 9600, "bytesize": 7, "parity": "E", "stopbits": 1}
    assert [drive.options for drive in plant.drives] == [{}, {}]


def test_several_scanned_lines_make_one_plant_with_named_drives(tmp_path):
    lines = [ScannedLine(port="/dev/ttyUSB0", found=[found()]), ScannedLine(port="/dev/ttyUSB1", found=[found()])]
    plant = read_text(scanned_text(lines), tmp_path / "plant.toml")
    assert [line.name for line in plant.lines] == ["ttyUSB0", "ttyUSB1"]
    assert [(each.name, each.line) for each in plant.drives] == [
        ("ttyUSB0-vabus-1", "ttyUSB0"),
        ("ttyUSB1-vabus-1", "ttyUSB1"),
    ]


def test_scanned_line_is_added_to_a_handwritten_plant_file(tmp_path):
    path = tmp_path / "plant.toml"
    path.write_text(
        'format = 1\n# our hall\n[[line]]\nname = "hall"\nport = "COM3"\n\n'
        '[[drive]]\nname = "pump"  # the old one\ndrive = "vabus:1"\narmed = true\n'
    )
    lines = [
        ScannedLine(port="COM3", found=[found(), found(address=2)]),
        ScannedLine(port="COM4", found=[found(address=1)]),
    ]
    added = add_scanned(path, lines)
    assert [each.name for each in added] == ["hall-vabus-2", "COM4-vabus-1"]
    text, plant = path.read_text(), read_plant(path)
    assert "# our hall" in text
    assert "# the old one" in text
    assert [line.name for line in plant.lines] == ["hall", "COM4"]
    assert [(each.name, each.line, each.armed) for each in plant.drives] == [
        ("pump", "hall", True),
        ("hall-vabus-2", "hall", False),
        ("COM4-vabus-1", "COM4", False),
    ]
    assert plant.drives[1].options["baudrate"] == 9600
    before = path.read_text()
    assert add_scanned(path, lines) == []
    assert path.read_text() == before


def test_plant_file_with_its_drives_in_one_list_cannot_be_extended(tmp_path):
    path = tmp_path / "plant.toml"
    path.write_text('format = 1\nline = [{ name = "hall", port = "COM3" }]\ndrive = [{ drive = "vabus:1" }]\n')
    before = path.read_text()
    with pytest.raises(FileFormatError, match=r"nothing can be added, .*scan into another file"):
        add_scanned(path, [ScannedLine(port="COM4", found=[found()])])
    assert path.read_text() == before


def test_write_atomically_replaces_the_whole_file(tmp_path):
    path = tmp_path / "plant.toml"
    write_atomically(path, "one")
    write_atomically(path, "three")
    assert path.read_text() == "three"
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(FileFormatError, match="cannot be written"):
        write_atomically(tmp_path / "nowhere" / "plant.toml", "four")


def test_writability_is_checked_without_leaving_a_file(tmp_path):
    path = tmp_path / "plant.toml"
    must_be_writable(path)
    assert not list(tmp_path.iterdir())
    with pytest.raises(FileFormatError, match=r"there is no folder .*nowhere; make it first"):
        must_be_writable(tmp_path / "nowhere" / "plant.toml")
    with pytest.raises(FileFormatError, match="cannot be written: "):
        must_be_writable(Path("/proc/plant.toml"))


def test_write_atomically_keeps_the_old_file_after_an_error(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    path = tmp_path / "plant.toml"
    path.write_text("one")
    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(FileFormatError, match=r"plant\.toml: cannot be written: No space left"):
        write_atomically(path, "two")
    assert path.read_text() == "one"
    assert list(tmp_path.iterdir()) == [path]


def _is_unit(text):
    return text == text.strip() and text.casefold() not in ("hz", "%")


NAMES = st.text(min_size=1, max_size=5).filter(str.isprintable)
VALUES = st.one_of(st.booleans(), st.integers(-(2**40), 2**40), st.floats(allow_nan=False, allow_infinity=False), NAMES)
ABOVE_ZERO = st.decimals(min_value="0.0001", max_value="100000", places=4)
MACHINES = st.builds(MachineUnit, unit=NAMES.filter(_is_unit), per_hz=ABOVE_ZERO) | st.builds(
    MachineUnit,
    unit=st.just("m/min"),
    poles=st.sampled_from([2, 4, 6]),
    gear=st.none() | ABOVE_ZERO,
    per_turn=ABOVE_ZERO,
)


def is_free(name):
    """Return whether this text may end the name of a group."""
    return name == name.rstrip() and not set(name) & {",", ":"}


DRIVES = st.builds(
    DriveConfig,
    protocol=st.sampled_from(sorted(installed)),
    address=st.integers(1, 99),
    line=st.just("a"),
    name=st.one_of(st.just(""), NAMES),
    title=NAMES | st.just(""),
    groups=st.lists(NAMES.filter(is_free).map("group {}".format), max_size=3, unique=True).map(tuple),
    options=st.dictionaries(NAMES, VALUES, max_size=3),
    armed=st.booleans(),
    poll=st.lists(
        st.builds(
            PollGroup,
            parameters=st.lists(NAMES, min_size=1, max_size=3).map(tuple),
            period_s=st.floats(0, 1e6),
            priority=st.integers(-5, 5),
            options=st.dictionaries(NAMES, VALUES, max_size=2),
        ),
        max_size=2,
    ).map(tuple),
    reply_delay_s=st.none() | st.floats(0, 59),
    machine=st.none() | MACHINES,
    link_loss=st.none()
    | st.builds(
        LinkLossPolicy, policy=st.sampled_from(["hold", "ramp", "coast", "trip"]), watchdog_s=st.floats(0.1, 100)
    ),
    network=st.builds(
        NetworkAccess,
        verbs=st.dictionaries(
            NAMES.filter(lambda name: name not in ("write", "local")),
            st.lists(st.sampled_from(NETWORK_VERBS), max_size=3).map(tuple),
            max_size=2,
        ),
        write=st.lists(NAMES.filter(lambda name: "*" not in name), max_size=2).map(tuple),
    ),
)
LINES = st.builds(
    PlantLine,
    name=st.just("a"),
    port=NAMES | st.just(""),
    echo=st.booleans(),
    settings=st.sampled_from([{}, {"baudrate": 9600}, {"parity": "E", "stopbits": 1.5}]),
)


@pytest.mark.soak
@settings(max_examples=50, suppress_health_check=[HealthCheck.too_slow])
@given(
    line=LINES,
    drives=st.lists(DRIVES, max_size=3, unique_by=(lambda drive: drive.name, str)),
    several=st.booleans(),
    remark=st.text(max_size=8),
)
def test_every_written_plant_is_read_back_unchanged(tmp_path_factory, line, drives, several, remark):
    lines = (line, PlantLine(name="b")) if several else (line,)
    plant = Plant(lines=lines, drives=tuple(drives))
    remarks = {drive.name: remark for drive in drives}
    found = read_text(plant_text(plant, remarks), tmp_path_factory.getbasetemp() / "round.toml")
    assert found == plant
    assert [drive.groups for drive in found.drives] == [drive.groups for drive in plant.drives]


def test_scan_that_finds_nothing_makes_a_plant_without_drives():
    assert scanned_plant([ScannedLine(port="COM3", found=[])]).drives == ()
