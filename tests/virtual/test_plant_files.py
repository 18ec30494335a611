"""Plant files: valid content, and the errors for invalid content."""

from math import inf
from textwrap import dedent

import pytest

import drivecomm.plant.files
from drivecomm.errors import FileFormatError
from drivecomm.plant import (
    FaultWindow,
    InjectStep,
    LineFault,
    PowerCutStep,
    StuckStep,
    TelegramFault,
    TripCondition,
    TripStep,
    read_fault,
    read_plant,
)
from drivecomm.protocol import DriveConfig, LinkLossPolicy, MachineUnit, NetworkAccess, PollGroup
from drivecomm.virtual import VirtualPlant

HALL = '[[line]]\nname = "hall"\n'
PUMP = '[[drive]]\nname = "pump"\ndrive = "vabus:1"\n'


@pytest.fixture
def read(tmp_path):
    def read_text(text):
        path = tmp_path / "plant.toml"
        path.write_text(text)
        return read_plant(path)

    return read_text


def test_plant_file_example_of_the_module_docstring_is_valid(read):
    text = drivecomm.plant.files.__doc__
    plant = read(text[text.index("format = 1") :])
    (line,) = plant.lines
    assert (line.name, line.echo, line.paced, line.settings) == ("hall", True, False, {"baudrate": 19200})
    assert line.noise.plan().kinds == (LineFault.CORRUPT, LineFault.DROP)
    assert line.noise.plan().seed == 1
    assert plant.drives == (
        DriveConfig(
            protocol="vabus",
            address=1,
            line="hall",
            name="pump",
            title="feed pump, hall 2",
            options={"model": "agile"},
            armed=True,
            confirmed=("output_voltage",),
            reply_delay_s=0.005,
            needs_pause_s=0.001,
            poll=(PollGroup(parameters=("output_frequency",), period_s=0.2, priority=1),),
            link_loss=LinkLossPolicy(policy="trip", watchdog_s=5),
            network=NetworkAccess(verbs={"http": ("start", "reset")}, write=("480",)),
            machine=MachineUnit(unit="m/min", per_hz="1.25"),
            values={"480": 1000},
            motor={"rated_kw": 7.5},
        ),
    )
    # A drive may be in several groups.
    assert plant.drives[0].groups == ("pumps", "hall 2")
    assert plant.script == (
        TelegramFault(
            line="hall",
            kind=LineFault.DROP,
            of="reply to a write",
            to={"parameter": 480},
            every=3,
            window=FaultWindow(from_s=10, until_s=60),
        ),
        PowerCutStep(drive="pump", off_at_s=20, back_at_s=35, factory=True),
        TripStep(drive="pump", code=5, at_s=40),
        StuckStep(drive="pump", parameter="210", value=0, window=FaultWindow(from_s=5, until_s=9)),
        InjectStep(line="hall", data=b"\x04A\xff", at_s=3),
    )
    VirtualPlant(plant)


def test_plant_file_fills_in_defaults(read):
    plant = read("format = 1\n" + HALL + '[[drive]]\ndrive = "fuji:7"\n')
    assert plant.drives[0].name == "fuji:7"
    assert plant.drives[0].line == "hall"
    assert plant.lines[0].paced
    assert plant.lines[0].noise is None
    assert plant.on_line("hall") == plant.drives
    assert plant.on_line("yard") == ()


def test_fault_condition_is_read_and_met():
    step = read_fault('drive = "pump"\ntrip = { code = 5, when = { parameter = "210", above = 45, for_s = 2 } }')
    assert step == TripStep(drive="pump", code=5, when=TripCondition(parameter="210", above=45, for_s=2))
    assert step.when.met_by(45.1)
    assert not step.when.met_by(45)
    assert TripCondition(parameter="1", below=3).met_by(-inf)


def fault(text):
    return "format = 1\n" + HALL + PUMP + "[[fault]]\n" + dedent(text)


@pytest.mark.parametrize(
    ("text", "sentences"),
    [
        ("", ["a plant begins with format = 1"]),
        ("format = true\n", ["a plant begins with format = 1"]),
        ("format = 1\nformat = 1\n", ["cannot be read as a plant"]),
        ("format = 1\n", ["one or more [[line]]"]),
        ("format = 1\nline = 3\n", ["invalid line = 3; write a table of its own each time"]),
        ("format = 1\nlines = 3\n", ["unknown key 'lines'", "did you mean 'line'"]),
        ("format = 1\n[[line]]\n", ["line 1: the key 'name' is missing; write name = a text in quotes"]),
        ('format = 1\n[[line]]\nname = ""\n', ["line 1: a line needs a name"]),
        ("format = 1\n" + HALL + HALL, ["two lines are named 'hall'"]),
        ("format = 1\n" + HALL + "echo = 1\n", ["line 1 (hall): invalid echo = 1; write true or false"]),
        ("format = 1\n" + HALL + "baudrate = true\n", ["invalid baudrate = True; write a whole number"]),
        ("format = 1\n" + HALL + "baudrate = 3\n", ["line 1 (hall): a baud rate of 3"]),
        ("format = 1\n" + HALL + "baud = 9600\n", ["unknown key 'baud'; did you mean 'baudrate'?"]),
        ("format = 1\n" + HALL + "noise = { rate = 2 }\n", ["line 1 (hall): invalid rate = 2", "from 0 to 1"]),
        ("format = 1\n" + HALL + "noise = { seed = 2 }\n", ["line 1 (hall), noise: the key 'rate' is missing"]),
        (
            "format = 1\n" + HALL + 'noise = { rate = 1, kinds = ["rust"] }\n',
            ["unknown kind of fault 'rust'", "write one of drop"],
        ),
        (
            "format = 1\n" + HALL + 'noise = { rate = 1, kinds = ["foreign"] }\n',
            ["line 1 (hall): invalid kinds; write one or more of"],
        ),
        ("format = 1\n" + HALL + "noise = { rate = 1, bits = 9 }\n", ["bits = 9"]),
        ("format = 1\n" + HALL + '[[drive]]\nname = "pump"\n', ["drive 1 (pump): the key 'drive' is missing"]),
        ("format = 1\n" + HALL + '[[drive]]\ndrive = "vabus"\n', ["'vabus' is not a drive", "PROTOCOL:ADDRESS"]),
        ("format = 1\n" + HALL + PUMP + "armed = 1\n", ["drive 1 (pump): invalid armed = 1; write true or false"]),
        ("format = 1\n" + HALL + PUMP + "arm = true\n", ["unknown key 'arm'; did you mean 'armed'?"]),
        ("format = 1\n" + HALL + PUMP + 'poll = "481"\n', ["drive 1 (pump): invalid poll = '481'; write a list"]),
        (
            "format = 1\n" + HALL + PUMP + 'poll = ["481"]\n',
            ["drive 1 (pump): invalid poll entry '481'; write { parameters"],
        ),
        ("format = 1\n" + HALL + PUMP + "poll = [{}]\n", ["poll 1: the key 'parameters' is missing"]),
        ("format = 1\n" + HALL + PUMP + "poll = [{ parameters = [] }]\n", ["(pump): nothing to poll"]),
        ("format = 1\n" + HALL + PUMP + "poll = [{ parameters = [481] }]\n", ["poll 1: parameters are texts"]),
        (
            "format = 1\n" + HALL + PUMP + 'poll = [{ parameters = ["1"], period_s = -1 }]\n',
            ["invalid period_s = -1"],
        ),
        ("format = 1\n" + HALL + PUMP + 'groups = "pumps"\n', ["(pump): invalid groups = 'pumps'; write a list"]),
        ("format = 1\n" + HALL + PUMP + "groups = [1]\n", ["(pump): groups holds texts in quotes, such as"]),
        ("format = 1\n" + HALL + PUMP + 'groups = [""]\n', ["drive 1 (pump): invalid group ''; write printable"]),
        ("format = 1\n" + HALL + PUMP + 'groups = [" x"]\n', ["invalid group ' x'", "without spaces around"]),
        ("format = 1\n" + HALL + PUMP + 'groups = ["a\\tb"]\n', ["invalid group 'a\\tb'; write printable"]),
        ("format = 1\n" + HALL + PUMP + 'groups = ["a,b"]\n', ["invalid group 'a,b'", "without commas"]),
        ("format = 1\n" + HALL + PUMP + 'groups = ["vabus:1"]\n', ["invalid group 'vabus:1'", "without commas"]),
        ("format = 1\n" + HALL + PUMP + 'groups = ["vabus:*"]\n', ["invalid group 'vabus:*'", "without commas"]),
        ("format = 1\n" + HALL + PUMP + 'groups = ["--all"]\n', ["invalid group '--all'", "begin with a dash"]),
        ("format = 1\n" + HALL + PUMP + 'groups = ["All"]\n', ["invalid group 'All'", "all drives already"]),
        ("format = 1\n" + HALL + PUMP + 'groups = ["a", "b", "a"]\n', ["the group 'a' is listed twice"]),
        (
            "format = 1\n" + HALL + PUMP + 'groups = ["fan"]\n[[drive]]\nname = "fan"\ndrive = "fuji:1"\n',
            ["line 7: drive 1 (pump): the group 'fan' has the name of a drive; rename one of them"],
        ),
        ("format = 1\n" + HALL + PUMP + "link_loss = {}\n", ["(pump), link_loss: the key 'policy' is missing"]),
        (
            "format = 1\n" + HALL + PUMP + 'link_loss = { policy = "pray" }\n',
            ["drive 1 (pump): unknown policy 'pray'", "hold, ramp, coast, trip"],
        ),
        (
            "format = 1\n" + HALL + PUMP + 'link_loss = { policy = "ramp", watchdog_s = 0 }\n',
            ["drive 1 (pump): invalid watchdog_s = 0; write seconds above 0"],
        ),
        (
            "format = 1\n" + HALL + PUMP + 'network = { http = ["strat"] }\n',
            ["drive 1 (pump): unknown verb 'strat' for http; did you mean 'start'?"],
        ),
        (
            "format = 1\n" + HALL + PUMP + 'network = { http = ["*"] }\n',
            ["drive 1 (pump): network has no wildcard; list each verb that http may use"],
        ),
        ("format = 1\n" + HALL + PUMP + 'network = { write = ["3-*"] }\n', ["network has no wildcard"]),
        ("format = 1\n" + HALL + PUMP + 'network = { local = ["start"] }\n', ["leave local out"]),
        (
            "format = 1\n" + HALL + PUMP + 'network = { http = "start" }\n',
            ["network: invalid http = 'start'"],
        ),
        ("format = 1\n" + HALL + PUMP + "network = { write = [480] }\n", ["network: write holds texts in quotes"]),
        ("format = 1\n" + HALL + "door = 3\n", ["line 1 (hall): unknown key 'door'"]),
        ("door = 3\nformat = 1\n" + HALL, ["line 1: invalid door = 3"]),
        ("format = 1\n[[server]]\n" + HALL, ["invalid server = [{}]; write a table"]),
        ("format = 1\n" + HALL + PUMP + PUMP, ["two drives are named 'pump'"]),
        (
            "format = 1\n" + HALL + PUMP + PUMP.replace("pump", "pump2"),
            ["drive 2 (pump2): vabus:1 is on line hall already, as pump"],
        ),
        ("format = 1\n" + HALL + PUMP.replace("pump", "vabus:7"), ["vabus:1 is named as if it were vabus:7"]),
        ("format = 1\n" + HALL + PUMP + 'line = "yard"\n', ["drive pump: there is no line 'yard'", "it has hall"]),
        ("format = 1\n" + HALL + '[[line]]\nname = "b"\n' + PUMP, ["drive 1 (pump): the key 'line' is missing"]),
        ("format = 1\n" + HALL + PUMP + 'values = { "480" = 1.5 }\n', ["drive 1 (pump), values: invalid 480 = 1.5"]),
        (
            "format = 1\n" + HALL + PUMP + "motor = { kw = 4 }\n",
            ["drive 1 (pump): unknown motor data 'kw'", "rated_kw"],
        ),
        ("format = 1\n" + HALL + PUMP + "motor = { rated_kw = 0 }\n", ["rated_kw = 0", "above 0"]),
        ("format = 1\n" + HALL + PUMP + "machine = 1.25\n", ["drive 1 (pump): invalid machine = 1.25; write a table"]),
        (
            "format = 1\n" + HALL + PUMP + 'machine = { per_hz = "1.25" }\n',
            ["drive 1 (pump), machine: the key 'unit' is missing"],
        ),
        (
            "format = 1\n" + HALL + PUMP + 'machine = { unit = "m/min", per_hz = 0 }\n',
            ["drive 1 (pump), machine: invalid per_hz = 0; write a number above 0"],
        ),
        (
            "format = 1\n" + HALL + PUMP + 'machine = { unit = "m/min", per_hz = inf }\n',
            ["drive 1 (pump), machine: invalid per_hz = inf"],
        ),
        (
            "format = 1\n" + HALL + PUMP + 'machine = { unit = "m/min", hz = 1 }\n',
            ["drive 1 (pump), machine: unknown key 'hz'"],
        ),
        (fault('drive = "pump"'), ["fault 1: a fault is one of kind, power, trip, stuck, inject"]),
        (fault('line = "hall"\nkind = "lost"'), ["fault 1: unknown kind of fault 'lost'; write one of drop"]),
        (fault('line = "hall"\nkind = "power"'), ["fault 1: invalid kind 'power' for telegrams"]),
        (fault('kind = "drop"'), ["needs either line or drive"]),
        (fault('line = "yard"\nkind = "drop"'), ["fault 1: there is no line 'yard' in this plant; it has hall"]),
        (fault('drive = "fan"\nkind = "drop"'), ["fault 1: there is no drive 'fan' in this plant; it has pump"]),
        (
            fault('line = "hall"\nkind = "drop"\nof = "writes"'),
            ["invalid of = 'writes'", "reply to a write"],
        ),
        (fault('drive = "pump"\nkind = "drop"\nof = "request"'), ["name the line in place of the drive"]),
        (fault('line = "hall"\nkind = "drop"\nto = { kind = "select" }'), ['write of = "reply"']),
        (fault('line = "hall"\nkind = "drop"\nevery = 0'), ["invalid every = 0"]),
        (fault('line = "hall"\nkind = "drop"\nevery = 2\nrate = 1'), ["every and rate exclude each other"]),
        (fault('line = "hall"\nkind = "drop"\nfrom_s = 5\nuntil_s = 5'), ["until_s = 5 is not after from_s = 5"]),
        (fault('line = "hall"\nkind = "delay"\ndelay_s = -1'), ["invalid delay_s = -1"]),
        (fault('drive = "pump"\npower = { off_at_s = 3, back_at_s = 2 }'), ["back_at_s = 2 is not after off_at_s = 3"]),
        (fault('drive = "pump"\npower = { off_at_s = 3, factory = true }'), ["write back_at_s"]),
        (fault('drive = "pump"\npower = 3'), ["fault 1: invalid power = 3; write a table in braces"]),
        (fault("power = { off_at_s = 3 }"), ["fault 1: the key 'drive' is missing"]),
        (fault('drive = "pump"\ntrip = { code = 0, at_s = 1 }'), ["invalid fault code 0"]),
        (fault('drive = "pump"\ntrip = { code = 5 }'), ["at_s or when"]),
        (fault('drive = "pump"\ntrip = { code = 5, when = { parameter = "1" } }'), ["above or below"]),
        (
            fault('drive = "pump"\ntrip = { code = 5, when = { above = 1 } }'),
            ["fault 1, trip, when: the key 'parameter'"],
        ),
        (fault('drive = "pump"\nstuck = { value = 5 }'), ["fault 1, stuck: the key 'parameter' is missing"]),
        (fault('line = "hall"\ninject = { data = "0g", at_s = 1 }'), ["invalid bytes '0g'", "two hexadecimal digits"]),
        (fault('line = "hall"\ninject = { data = "", at_s = 1 }'), ["no bytes to inject"]),
    ],
)
def test_invalid_plant_file_is_refused(read, tmp_path, text, sentences):
    with pytest.raises(FileFormatError) as caught:
        read(text)
    said = str(caught.value)
    whole = ("cannot be read", "are named", "in this plant")
    assert said.startswith(f"{tmp_path / 'plant.toml'}{': ' if any(each in said for each in whole) else ', line '}")
    for sentence in sentences:
        assert sentence in said


def test_server_tables_of_a_plant_file_are_ignored(read):
    alone = read("format = 1\n" + HALL + PUMP)
    text = '[server]\nname = "hall 2"\n[[door]]\nkind = "http"\nanything = 3\n[[alarm]]\non = "fault"\n'
    assert read("format = 1\n" + HALL + PUMP + text) == alone


def test_missing_plant_file_is_refused(tmp_path):
    with pytest.raises(FileFormatError, match=r"none\.toml: there is no such file"):
        read_plant(tmp_path / "none.toml")


def test_fault_with_several_kinds_is_refused():
    for text in ('line = "a"', 'drive = "pump"\npower = { off_at_s = 1 }\ntrip = { code = 5 }'):
        with pytest.raises(FileFormatError, match=r"a fault is one of .*; write one of them"):
            read_fault(text)


@pytest.mark.parametrize("text", ["=", "kind = 3", 'kind = "drop"', 'line = "a"\nkind = "drop"\nmore = 3'])
def test_invalid_fault_text_is_refused(text):
    with pytest.raises(FileFormatError, match="fault"):
        read_fault(text)
