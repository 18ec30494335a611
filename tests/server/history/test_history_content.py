"""Values, events and commands are read from a history exactly as written: in order, by quantity and time."""

import sqlite3
import subprocess
import sys
from dataclasses import replace
from decimal import Decimal

import pytest
from past_values import NOON, event, value

from drivecomm.errors import FileFormatError, RefusedError, UsageError
from drivecomm.protocol import Reading
from drivecomm.server import Caller, CommandAnswer, CommandRequest, Role
from drivecomm.server.history import History, HistoryWriter, journal as journals, log_row, schema, store
from drivecomm.server.history_service import remembered_faults


@pytest.fixture
def file(tmp_path):
    return tmp_path / "history.sqlite"


def history_of(file, *batches, events=()):
    """Write each batch in one call, and return the history opened for reading."""
    journal = HistoryWriter(file)
    for batch in batches:
        journal.add_values(batch)
    journal.add_events(events)
    journal.close()
    return History(file)


@pytest.fixture
def small_segments(monkeypatch):
    monkeypatch.setattr(store, "ROWS_A_SEGMENT", 10)
    monkeypatch.setattr(journals, "ROWS_A_COMMIT", 4)


def written(file, values, *, at_once=5):
    """Write values, and convert them to segments whenever enough have gathered."""
    one = store.HistoryFile(file)
    for first in range(0, len(values), at_once):
        one.add(values[first : first + at_once], [])
        one.sort()
    one.close()


@pytest.mark.parametrize(
    ("number", "raw"),
    [
        (Decimal("12.50"), 1250),
        (Decimal("-0.05"), -5),
        (Decimal("1E+3"), 1),
        (Decimal("0.00"), 0),
        (Decimal("1E-9"), 1),
        (Decimal(123456789012345678901234), "hex"),
        (Decimal(7), 7),
        (7, 7),
        (-(2**63), 5),
        (2**63 - 1, 5),
        (Decimal("0.5"), 3),
        ("running", 0x0637),
        ("007", "007"),
        ("", 0),
    ],
)
def test_value_is_read_back_exactly(file, number, raw):
    with history_of(file, [value(1, value=number, raw=raw)]) as history:
        (back,) = history.values()
    assert str(back.value) == str(number)
    assert back.raw == raw
    assert type(back.raw) is type(raw)


def test_all_fields_of_a_value_are_stored(file):
    state = value(1, name="status", value="fault", raw=8, text="F0507 overcurrent", unit="", parameter="", note="n")
    with history_of(file, [state]) as history:
        (back,) = history.values("pump", "status")
    assert (back.time_s, back.drive, back.name, back.text, back.note) == (
        NOON + 1, "pump", "status", "F0507 overcurrent", "n",
    )  # fmt: skip
    assert back.source_s is None
    assert log_row(back).texts() == {
        "time": "2026-11-18T11:06:41.000Z", "drive": "pump", "name": "status", "address": "",
        "value": "fault", "unit": "",
        "text": "F0507 overcurrent", "raw": "8", "quality": "good", "note": "n",
    }  # fmt: skip


def test_bad_value_has_its_cause_and_stale_value_its_read_time(file):
    stale = value(5, quality="stale", cause="no reply", time_s=NOON + 5)
    old = read_at(stale, NOON + 2)
    with history_of(file, [value(6, quality="bad", cause="silent"), old]) as history:
        bad, late = history.values()
    assert (bad.value, bad.raw, bad.quality, bad.note, bad.time_s) == (None, None, "bad", "silent", NOON + 6)
    assert (late.value, late.quality, late.note) == (Decimal("0.05"), "stale", "no reply")
    assert (late.time_s, late.source_s) == (NOON + 5, NOON + 2)


def read_at(current, source_s):
    return replace(current, reading=replace_time(current.reading, source_s))


def replace_time(reading, time_s):
    fields = {name: getattr(reading, name) for name in Reading.__dataclass_fields__}
    return Reading(**{**fields, "time_s": time_s})


@pytest.mark.usefixtures("small_segments")
def test_values_of_a_quantity_are_selected_by_time_across_segments(file):
    values = [value(n // 2, drive=("pump", "fan")[n % 2], value=Decimal(n)) for n in range(104)]
    written(file, values)
    with History(file) as history:
        found = list(history.values("fan", "output_frequency", NOON + 3, NOON + 40))
        every = list(history.values())
    assert [each.value for each in found] == [2 * n + 1 for n in range(3, 41)]
    assert {each.drive for each in found} == {"fan"}
    assert [each.value for each in every] == list(range(104))
    assert [each.row for each in every] == list(range(1, 105))


@pytest.mark.usefixtures("small_segments")
def test_texts_and_notes_are_stored_in_every_segment(file):
    values = [
        value(n, text=f"t{n % 7}", note=("", "why")[n % 2], quality=("good", "uncertain")[n % 2]) for n in range(47)
    ]
    written(file, values)
    with History(file) as history:
        assert [(each.text, each.note, each.quality) for each in history.values()] == [
            (each.reading.text, each.reading.note, each.quality) for each in values
        ]


@pytest.mark.usefixtures("small_segments")
def test_reading_since_a_row_continues_over_segments_and_new_rows(file):
    written(file, [value(n) for n in range(33)])
    with History(file) as history:
        begun = history.since(11)
        first = [next(begun) for _ in range(3)]
        written(file, [value(100 + n, drive=f"new {n}") for n in range(30)])
        rest = [each.row for each in begun]
    assert [each.row for each in first] == [12, 13, 14]
    assert rest == list(range(15, 64))


@pytest.mark.usefixtures("small_segments")
def test_row_numbers_continue_after_reopening(file):
    for _ in range(3):
        written(file, [value(n) for n in range(10)])
    with History(file) as history:
        assert [each.row for each in history.since(0)] == list(range(1, 31))


@pytest.mark.usefixtures("small_segments")
def test_clock_set_back_an_hour_loses_no_value(file):
    """Rows stay in order of arrival, and points are in order of their time."""
    values = [value(n, value=Decimal(n)) for n in range(25)]
    values += [value(n, value=Decimal(n), time_s=NOON - 3600 + n) for n in range(25, 60)]
    written(file, values)
    with History(file) as history:
        assert [each.value for each in history.values()] == list(range(60))
        points = history.points("pump", "output_frequency", points=100_000)
        assert [each.value for each in history.since(0)] == list(range(60))
        before_noon = list(history.values("pump", "output_frequency", to_s=NOON - 1))
    assert sorted(point.value for point in points) == list(range(60))
    assert [point.time_s for point in points] == sorted(point.time_s for point in points)
    assert [each.value for each in before_noon] == list(range(25, 60))


def test_points_of_a_plot_keep_extremes_and_gaps(file):
    values = [value(n, value=Decimal(n % 10)) for n in range(5000)]
    values[1234] = value(1234, value=Decimal(99))
    values[3333] = value(3333, value=Decimal(-99))
    values[4000:4400] = [value(n, quality="bad", cause="silent") for n in range(4000, 4400)]
    with history_of(file, values) as history:
        points = history.points("pump", "output_frequency", points=100)
    assert 60 <= len(points) <= 120
    assert (NOON + 1234, 99, "good") in points
    assert (NOON + 3333, -99, "good") in points
    in_gap = [point for point in points if NOON + 4000 <= point.time_s < NOON + 4400]
    assert in_gap
    assert all(point[1:] == (None, "bad") for point in in_gap)
    assert [point.time_s for point in points] == sorted(point.time_s for point in points)


def test_points_of_a_state_are_its_changes(file):
    def state(n):
        return "running" if 100 <= n < 200 else "ready"

    values = [value(n, name="status", value=state(n), raw=1, unit="") for n in range(300)]
    with history_of(file, values) as history:
        points = history.points("pump", "status", points=500)
    assert [(point.time_s - NOON, point.value) for point in points] == [(0, "ready"), (100, "running"), (200, "ready")]


def test_few_values_are_all_points_of_a_plot(file):
    with history_of(file, [value(n) for n in range(50)]) as history:
        assert [point.value for point in history.points("pump", "output_frequency", NOON, NOON + 49)] == [
            Decimal(n).scaleb(-2) for n in range(50)
        ]


@pytest.mark.usefixtures("small_segments")
def test_history_lists_drives_and_quantities_and_suggests_names(file):
    written(file, [value(1), value(2, drive="fan"), value(3, name="output_current", unit="A", parameter="211")] * 11)
    with History(file) as history:
        assert history.drives() == ["pump", "fan"]
        assert [tuple(each) for each in history.quantities()] == [
            ("pump", "output_frequency", "241", "Hz"),
            ("pump", "output_current", "211", "A"),
            ("fan", "output_frequency", "241", "Hz"),
        ]
        assert len(history.quantities("fan")) == 1
        with pytest.raises(UsageError, match="has no drive 'pmp'; did you mean 'pump'"):
            next(history.values("pmp"))
        with pytest.raises(UsageError, match="has no 'output_curent' of pump; did you mean 'output_current'"):
            history.points("pump", "output_curent")


@pytest.mark.usefixtures("small_segments")
def test_history_returns_the_latest_value_of_each_quantity(file):
    # A value of an old drive, an older value of the pump, and one just written.
    values = [value(1, drive="old"), *[value(n) for n in range(40)], value(50, quality="bad", cause="silent")]
    written(file, values)
    with History(file) as history:
        old, pump = history.latest()
        assert (old.drive, old.value, old.row) == ("old", Decimal("0.01"), 1)
        assert (pump.value, pump.note, pump.row) == (None, "silent", 42)
        assert [each.drive for each in history.latest("old")] == ["old"]


def test_events_are_selected_by_drive_kind_and_time(file):
    events = [event(n, f"e{n}", drive=("pump", "fan")[n % 2], kind=("fault", "silent")[n % 2]) for n in range(20)]
    with history_of(file, events=events) as history:
        assert [each.event for each in history.events()] == events
        assert [each.event for each in history.events(limit=3)] == events[-3:]
        assert [each.event for each in history.events("fan", "silent", NOON + 2, NOON + 5)] == [events[3], events[5]]


def test_commands_are_stored_with_their_outcomes(file):
    mary = Caller(name="mary", role=Role.OPERATE, door="http")
    journal = HistoryWriter(file)
    asked = CommandRequest(drive="pump", verb="set_reference", arguments={"percent": Decimal("40.0")})
    journal.add_command(mary, asked, CommandAnswer(id="a1", outcome="done"), asked_s=NOON, done_s=NOON + 0.04)
    no = CommandAnswer(id="a2", outcome="failed", error=RefusedError("480", 5, "running"))
    journal.add_command(mary, CommandRequest(drive="fan", verb="start"), no, asked_s=NOON + 1, done_s=NOON + 2)
    journal.close()
    with History(file) as history:
        done, failed = history.commands()
        assert (done.who, done.door, done.drive, done.verb, done.id) == ("mary", "http", "pump", "set_reference", "a1")
        assert str(done.arguments["percent"]) == "40.0"
        assert (done.time_s, done.done_s, done.outcome, done.text) == (NOON, NOON + 0.04, "done", "")
        assert failed.outcome == "failed"
        assert "running" in failed.text
        assert history.commands("fan") == [failed]


def test_fault_log_of_a_drive_is_stored(file):
    journal = HistoryWriter(file)
    read = [Reading(parameter=f"15-30[{n}]", value=code, raw=code, text=f"A{code}") for n, code in enumerate((14, 7))]
    journal.add_fault_log("pump", read, time_s=NOON)
    journal.close()
    with History(file) as history:
        newest, older = history.fault_logs("pump")
    assert (newest.place, newest.address, newest.value, newest.text) == (1, "15-30[0]", "14", "A14")
    assert (older.place, older.text, older.time_s) == (2, "A7", NOON)


def test_value_that_cannot_be_stored_does_not_affect_others(file):
    nowhen = value(2, time_s=float("nan"))
    with history_of(
        file, [value(1), nowhen, value(3, name="other")], events=[event(1), event(2, text="\ud800")]
    ) as history:
        assert [each.raw for each in history.values()] == [1, 3]
        assert [each.event.number for each in history.events()] == [1]
        assert len(history.quantities()) == 2


def test_history_is_readable_while_it_is_written(file):
    journal = HistoryWriter(file)
    with History(file) as history:
        assert list(history.values()) == []
        journal.add_values([value(1)])
        journal.close()
        assert [each.value for each in history.values()] == [Decimal("0.01")]


def test_history_is_readable_in_a_read_only_folder(file, tmp_path):
    history_of(file, [value(1)]).close()
    for name in ("history.sqlite-wal", "history.sqlite-shm"):
        (tmp_path / name).unlink(missing_ok=True)
    tmp_path.chmod(0o500)
    file.chmod(0o400)
    try:
        with History(file) as history:
            assert len(list(history.values())) == 1
    finally:
        tmp_path.chmod(0o700)


@pytest.mark.parametrize("content", [b"", b"time,drive\n" * 100, "other"])
def test_other_file_is_refused_as_a_history(file, content):
    if content == "other":
        sqlite3.connect(file).execute("CREATE TABLE x (y)").connection.close()
    else:
        file.write_bytes(content)
    with pytest.raises(FileFormatError, match=r"history\.sqlite: (is not a|is a database of another|cannot be read)"):
        History(file)


def test_missing_history_is_reported(file):
    with pytest.raises(FileFormatError, match="no such history"):
        History(file)


def test_history_of_a_newer_version_is_refused_and_unchanged(file):
    history_of(file, [value(1)]).close()
    connection = schema.open_for_writing(file)
    connection.execute("PRAGMA user_version = 2")
    connection.close()
    before = file.read_bytes()
    for opened in (History, HistoryWriter):
        with pytest.raises(FileFormatError, match="written by a newer drivecomm"):
            opened(file)
    assert file.read_bytes() == before


@pytest.mark.soak
def test_stored_value_takes_less_than_30_bytes(file, monkeypatch):
    monkeypatch.setattr(store, "ROWS_A_SEGMENT", 4_000)
    written(file, [value(n % 5000, name=f"q{n % 200}", time_s=NOON + n / 2000) for n in range(40_000)], at_once=4000)
    assert file.stat().st_size / 40_000 < 30


def test_reading_a_history_does_not_import_asyncio_or_serial(file):
    history_of(file, [value(1)]).close()
    program = (
        "import sys; from drivecomm.server.history import History; print({'asyncio', 'serial'} & set(sys.modules))"
    )
    assert subprocess.check_output([sys.executable, "-c", program], text=True).strip() == "set()"


def test_latest_fault_log_of_each_drive_is_found(file):
    assert remembered_faults(file) == {}

    def entry(value):
        return Reading(parameter=f"15-30.{value}", value=value, raw=value, unit="", name="", text=f"fault {value}")

    journal = HistoryWriter(file)
    journal.add_fault_log("pump", [entry(3), entry(2), entry(1)], time_s=NOON)
    journal.add_fault_log("fan", [entry(9)], time_s=NOON + 1)
    journal.add_fault_log("pump", [entry(4), entry(3)], time_s=NOON + 2)
    journal.close()
    found = remembered_faults(file)
    assert [(each.place, each.value, each.text, each.time_s) for each in found["pump"]] == [
        (1, "4", "fault 4", NOON + 2), (2, "3", "fault 3", NOON + 2),
    ]  # fmt: skip
    assert [each.value for each in found["fan"]] == ["9"]
