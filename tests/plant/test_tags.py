"""Tags of a plant: read from the plant file, imported from a table, and written to the plant file."""

import tomllib
from contextlib import suppress

import pytest
from hypothesis import given, strategies as st

from drivecomm.errors import FileFormatError, UsageError
from drivecomm.plant import imported_tags, read_plant, tag_cells, write_tags
from drivecomm.protocol import Tag

PLANT = """\
# our plant
format = 1

[[line]]
name = "hall"

# the feed pump
[[drive]]
name = "pump"
drive = "vabus:1"
options = { model = "agile" }
poll = [{ parameters = ["output_frequency", "480"] }]
TAGS
# the roof; do not touch
[[drive]]
name = "fan"
drive = "danfoss-fc:3"
poll = [{ parameters = ["output_current"] }] # often enough
[drive.options]
model = "fc302" # as on its plate

# the end
"""
SPEED = Tag(name="P101.SPEED", group="mixing/P101", deadband=0.05)
NAMED = 'tags = { output_frequency = { name = "P101.SPEED", group = "mixing/P101", deadband = 0.05 } }\n'


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "plant.toml"
    path.write_text(PLANT.replace("TAGS\n", ""))
    return path


def plant_of(file, tags):
    file.write_text(PLANT.replace("TAGS\n", tags))
    return read_plant(file)


def test_tags_of_a_drive_are_read(file):
    assert plant_of(file, NAMED).drives[0].tags == {"output_frequency": SPEED}
    assert plant_of(file, "tags = { status = { name = 'P101' } }\n").drives[0].tags == {"status": Tag(name="P101")}


@pytest.mark.parametrize(
    ("tags", "sentence"),
    [
        ("tags = { output_curent = {} }\n", "output_curent is not polled; write it under poll, too"),
        ("tags = { 480 = { nmae = 'x' } }\n", "unknown key 'nmae'; did you mean 'name'?"),
        (
            "tags = { 480 = { deadband = -1 } }\n",
            "invalid deadband = -1; write a number in the value's unit, 0 or more",
        ),
        ("tags = { 480 = { name = ' x' } }\n", "invalid name ' x' of a tag; write up to 200 printable characters"),
        ("tags = { 480 = { name = 'a' }, status = { name = 'a' } }\n", "two values have the tag 'a'; give each a name"),
        ("tags = { 480 = 'a' }\n", "invalid 480 = 'a'; write a table in braces"),
    ],
)
def test_invalid_tags_are_refused(file, tags, sentence):
    with pytest.raises(FileFormatError) as caught:
        plant_of(file, tags)
    assert sentence in str(caught.value)


def test_every_value_has_a_row_with_its_unit_and_meaning(file):
    rows = {(row["drive"], row["parameter"]): row for _, _, row in tag_cells(plant_of(file, NAMED))}
    assert list(rows) == [
        ("pump", "status"), ("pump", "output_frequency"), ("pump", "480"), ("fan", "status"), ("fan", "output_current"),
    ]  # fmt: skip
    assert list(rows["pump", "output_frequency"].values()) == [
        "P101.SPEED", "pump", "hall", "output_frequency", "frequency of the voltage at the drive's output", "Hz",
        "mixing/P101", "0.05",
    ]  # fmt: skip
    assert (rows["pump", "480"]["meaning"], rows["pump", "480"]["unit"]) == ("fixed frequency 1", "Hz")


@pytest.mark.parametrize(
    "text",
    [
        "tag,drive,parameter,group,deadband\nP101.SPEED,pump,output_frequency,mixing/P101,0.05\n",
        "tag;drive;parameter;group;deadband\r\nP101.SPEED;pump;output_frequency;mixing/P101;0,05\r\n;;;;\r\n",
        "sep=;\nTag;Drive;Parameter;Group;Deadband\nP101.SPEED; pump ;output_frequency;mixing/P101;0,05\n",
        "tag\tdrive\tparameter\tgroup\tdeadband\nP101.SPEED\tpump\toutput_frequency\tmixing/P101\t0.05\n",
        'drive,parameter,deadband,group,tag\n"pump","output_frequency","0,05","mixing/P101","P101.SPEED"\n',
    ],
    ids=["commas", "semicolons", "sep", "tabs", "quotes"],
)
def test_tables_of_spreadsheets_are_read(file, text):
    found = imported_tags(text, read_plant(file))
    assert (found.problems, found.others, found.tags) == ([], [], {"pump": {"output_frequency": SPEED}})


def test_empty_cell_removes_a_fact_and_missing_column_keeps_it(file):
    plant = plant_of(file, NAMED)
    kept = imported_tags("tag,drive,parameter\nP1,pump,output_frequency\n", plant)
    assert kept.tags == {"pump": {"output_frequency": Tag(name="P1", group="mixing/P101", deadband=0.05)}}
    text = "tag,drive,parameter,group,deadband,remark\n,pump,output_frequency,,,x\n"
    removed = imported_tags(text, plant)
    assert (removed.tags, removed.others) == ({"pump": {"output_frequency": Tag()}}, ["remark"])


def test_table_equal_to_the_plant_changes_nothing(file):
    text = "tag,drive,parameter,group,deadband\nP101.SPEED,pump,output_frequency,mixing/P101,0.05\n,pump,480,,\n"
    assert imported_tags(text, plant_of(file, NAMED)).tags == {}


def test_each_invalid_row_is_reported_with_its_line(file):
    rows = [
        "tag,drive,parameter,deadband",
        "a,pmup,480,",
        "P101.SPEED,fan,output_current,",
        "",
        ",pump,status,1",
        "b,fan,output_curent,",
        'c,"pump",480,"1\n2"',
        "d,pump,480,1,2",
        "e,pump,output_frequency,nan",
        "f,fan,status,,",
        "g,fan,output_current,1",
    ]
    found = imported_tags("\n".join(rows), plant_of(file, NAMED))
    assert [problem.partition(";")[0] for problem in found.problems] == [
        "line 2: there is no drive 'pmup'",
        "line 3: pump output_frequency has the tag 'P101.SPEED', too",
        "line 5: a status has no deadband",
        "line 6: fan has no value 'output_curent'",
        "line 7: invalid deadband '1\\n2'",
        "line 9: there are 5 cells for 4 columns",
        "line 10: invalid deadband = nan",
        "line 12: fan output_current is in line 3 already",
    ]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "the column drive is missing"),
        ("tag,drive\na,b\n", "the column parameter is missing"),
        ("drive,parameter\n", "there is no column tag, group or deadband"),
        ("tag,drive,parameter,tag\n", "the column tag is there twice"),
        ("tag,drive,parameter\na\0,b,c\n", ""),
    ],
)
def test_table_with_wrong_columns_is_refused(file, text, sentence):
    plant = read_plant(file)
    if not sentence:
        assert imported_tags(text, plant).problems
        return
    with pytest.raises(UsageError, match=sentence):
        imported_tags(text, plant)


@given(st.text(max_size=200))
def test_any_text_is_a_table_or_refused(tmp_path_factory, text):
    file = tmp_path_factory.getbasetemp() / "any.toml"
    if not file.exists():
        file.write_text(PLANT.replace("TAGS\n", ""))
    with suppress(UsageError):
        imported_tags(f"drive,parameter,tag{text}", read_plant(file))


def test_tag_names_may_be_swapped_in_one_table(file):
    plant = plant_of(file, 'tags = { 480 = { name = "a" }, status = { name = "b" } }\n')
    found = imported_tags("tag,drive,parameter\nb,pump,480\na,pump,status\n", plant)
    assert (found.problems, found.tags) == ([], {"pump": {"480": Tag(name="b"), "status": Tag(name="a")}})


@pytest.mark.parametrize(
    "own",
    [
        "",
        NAMED,
        "# why\n" + NAMED,
        'tags.output_frequency = { name = "old" } # of 1998\n',
        "[drive.tags] # of the panel\n# the speed\noutput_frequency = { name = 'old' } # of 1998\n",
        '[drive.tags.output_frequency]\nname = "old"\n',
        "tags = {}\n",
    ],
    ids=["none", "inline", "comment", "dotted", "table", "tables", "empty"],
)
@pytest.mark.parametrize("ending", ["\n", "\r\n"])
def test_written_tags_leave_the_rest_of_the_file_unchanged(file, own, ending):
    plant_of(file, own)
    text = file.read_text().replace("\n", ending)
    file.write_bytes(text.encode())
    before = tomllib.loads(text)
    new = {"480": Tag(name="P101.SET"), "output_frequency": Tag(group="g", deadband=1.0), "status": Tag(name="ä\"'")}
    write_tags(file, {0: new, 1: {"output_current": Tag(name="F1.A")}})
    drives = read_plant(file).drives
    assert (drives[0].tags, drives[1].tags) == (new, {"output_current": Tag(name="F1.A")})
    after = file.read_bytes().decode()
    for drive in (*before["drive"], *(content := tomllib.loads(after))["drive"]):
        drive.pop("tags", None)
    assert content == before
    comments = [line.strip() for line in text.splitlines() if line.startswith("#")]
    assert [line.strip() for line in after.splitlines() if line.startswith("#")] == comments
    assert after.index("[drive.options]") < after.index("F1.A") < after.index("# the end")
    assert after.index("P101.SET") < after.index("# the roof")


def test_removing_the_last_tag_removes_its_table(file):
    plant_of(file, NAMED)
    write_tags(file, {0: {"output_frequency": Tag()}})
    assert file.read_text() == PLANT.replace("TAGS\n", "")


def test_tags_are_written_to_drives_in_a_list(tmp_path):
    file = tmp_path / "plant.toml"
    drives = 'drive = [\n    { name = "pump", drive = "vabus:1" }, # one\n    { name = "fan", drive = "vabus:2" },\n]\n'
    file.write_text('format = 1\nline = [{ name = "hall" }]\n' + drives)
    write_tags(file, {1: {"status": Tag(name="F1")}})
    assert read_plant(file).drives[1].tags == {"status": Tag(name="F1")}
    assert "# one" in file.read_text()
