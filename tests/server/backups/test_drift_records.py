"""Drift records of drives, from comparisons of parameter sets that differ in one point."""

from dataclasses import replace
from datetime import UTC, datetime
from decimal import Decimal

from drivecomm.commissioning.drift import drift_between
from drivecomm.commissioning.parameter_sets import Approval, ParameterEntry, ParameterSet
from drivecomm.server.backups.drift_file import read_drifts, write_drifts
from drivecomm.server.backups.drift_records import drift_record, first_seen, newly_changed, news
from drivecomm.server.drift_state import NOT_COMPARED, DriveDrift

RESTORE = "drivecomm restore pump baselines/pump.toml --another-drive"
RAMP = ParameterEntry(address="420", name="acceleration", value=5, unit="s")
FREQUENCY = ParameterEntry(address="481", name="fixed", value=Decimal("10.00"), unit="Hz")


def set_of(*entries, **more):
    known = {entry.address: entry for entry in entries}
    return ParameterSet(**{"protocol": "vabus", "drive": "vabus:1", "model": "agile", "entries": known, **more})


APPROVED = set_of(
    RAMP,
    FREQUENCY,
    identity={"serial number": "4711"},
    approved=Approval(by="Anna", time=datetime(2026, 5, 4, 12, tzinfo=UTC)),
)


def now(*entries, **more):
    return set_of(*entries, **{"identity": APPROVED.identity, **more})


def record(found, before=NOT_COMPARED, read_s=100.0, approved=APPROVED, **first_s):
    of = drift_between(approved, found)
    return drift_record(of, before, read_s=read_s, first_s=first_s, restore=RESTORE)


SAME = record(now(RAMP, FREQUENCY))
CHANGED = record(now(replace(RAMP, value=7), FREQUENCY))


def test_drive_with_all_approved_values_is_as_approved():
    assert (SAME.state, SAME.changed, SAME.since_s, SAME.equal) == ("as approved", 0, None, 2)
    assert (SAME.approved_by, SAME.compared_s) == ("Anna", 100.0)


def test_change_records_both_values_and_its_time():
    assert (CHANGED.state, CHANGED.changed, CHANGED.since_s) == ("changed", 1, 100.0)
    assert str(CHANGED.changes[0]) == "420 acceleration: 5 -> 7 s"


def test_change_keeps_its_time_while_its_value_stays():
    later = record(now(replace(RAMP, value=7), FREQUENCY), CHANGED, 200.0)
    assert later.since_s == 100.0
    assert record(now(replace(RAMP, value=8), FREQUENCY), later, 300.0).since_s == 300.0


def test_change_has_the_time_of_the_first_backup_that_showed_it():
    assert record(now(replace(RAMP, value=7), FREQUENCY), **{"420": 40.0}).since_s == 40.0


def test_change_that_could_not_be_read_again_remains_a_change():
    unread = record(now(FREQUENCY, not_read={"420": "no reply"}), CHANGED, 200.0)
    assert (unread.state, unread.changes) == ("changed", CHANGED.changes)
    assert [each.address for each in unread.not_comparable] == ["420"]
    assert news(CHANGED, unread, {}) == []


def test_unreadable_change_ends_when_its_value_is_approved():
    approved = replace(APPROVED, entries={**APPROVED.entries, "420": replace(RAMP, value=7)})
    unread = record(now(FREQUENCY, not_read={"420": "no reply"}), CHANGED, 200.0, approved)
    assert (unread.state, unread.changes) == ("not comparable", ())


def test_unreadable_parameter_is_not_comparable_and_not_a_change():
    unread = record(now(FREQUENCY, not_read={"420": "no reply"}), SAME)
    assert (unread.state, unread.changed) == ("not comparable", 0)
    assert news(SAME, unread, {}) == []


def test_replaced_drive_is_reported_with_the_restore_command():
    found = record(now(replace(RAMP, value=7), FREQUENCY, identity={"serial number": "9999"}), SAME)
    assert (found.state, found.changed, found.replaced_since_s, found.restore) == ("replaced", 1, 100.0, RESTORE)
    ((is_warning, text),) = news(SAME, found, {})
    assert is_warning
    assert text == (
        "replaced by another drive: its serial number is '4711', and '9999' on this drive; to give it the approved "
        f"set: {RESTORE}"
    )
    assert news(found, found, {}) == []
    assert news(found, SAME, {}) == [(False, "the drive of its baseline is back")]


def test_news_names_values_their_author_and_the_number_of_differences():
    two = record(now(replace(RAMP, value=7), replace(FREQUENCY, value=Decimal("12.00"))), CHANGED)
    assert news(SAME, CHANGED, {"420": " (eva)"}) == [
        (True, "not set as approved, 1 parameter differs: 420 acceleration: 5 -> 7 s (eva)")
    ]
    assert news(CHANGED, two, {}) == [(True, "not set as approved, 2 parameters differ: 481 fixed: 10.00 -> 12.00 Hz")]
    assert news(two, CHANGED, {}) == [(False, "set as approved again, 1 parameter differs: 481 fixed")]
    assert news(CHANGED, SAME, {}) == [(False, "set as approved again, nothing differs: 420 acceleration")]


def test_news_of_a_new_baseline_names_who_approved_it():
    approval = Approval(by="Ben", time=datetime(2026, 6, 4, 12, tzinfo=UTC))
    approved = replace(APPROVED, entries={"420": replace(RAMP, value=7), "481": FREQUENCY}, approved=approval)
    again = record(now(replace(RAMP, value=7), FREQUENCY), CHANGED, 200.0, approved)
    ((_, text),) = news(CHANGED, again, {})
    assert text == "set as approved again by the new baseline of Ben, nothing differs: 420 acceleration"


def test_news_of_many_changes_names_the_first_five():
    many = [ParameterEntry(address=str(number), value=1) for number in range(8)]
    approved = replace(APPROVED, entries={each.address: each for each in many})
    found = record(now(*(replace(each, value=2) for each in many)), approved=approved)
    assert news(NOT_COMPARED, found, {})[0][1].endswith("4: 1 -> 2, and 3 more")


def test_first_seen_is_the_oldest_of_consecutive_backups_with_the_value():
    sets = [now(RAMP), now(FREQUENCY), now(RAMP), now(replace(RAMP, value=7)), now(RAMP)]
    backups = [(50.0 - place, each) for place, each in enumerate(sets)]
    assert first_seen({"420": RAMP}, now(RAMP), backups) == {"420": 48.0}


def test_first_seen_ignores_backups_of_another_drive():
    backups = [(2.0, now(RAMP)), (1.0, now(RAMP, identity={"serial number": "1"}))]
    assert first_seen({"420": RAMP}, now(RAMP), backups) == {"420": 2.0}


def test_newly_changed_excludes_known_changes():
    found = drift_between(APPROVED, now(replace(RAMP, value=7), FREQUENCY))
    assert list(newly_changed(found, SAME)) == ["420"]
    assert newly_changed(found, CHANGED) == {}


def test_drift_file_keeps_all_digits_and_types(tmp_path):
    known = {
        "pump": record(now(replace(RAMP, value="fast"), replace(FREQUENCY, value=Decimal("12.50")))),
        "fan": record(now(FREQUENCY, identity={}, not_read={"420": "no reply"})),
        "mixer": DriveDrift(state="no baseline"),
    }
    write_drifts(tmp_path / "state" / "drift.json", known)
    found = read_drifts(tmp_path / "state" / "drift.json")
    assert found == known
    assert str(found["pump"].changes[1].now) == "12.50"
    assert isinstance(found["pump"].since_s, float)


def test_damaged_drift_file_reads_as_empty(tmp_path):
    file = tmp_path / "drift.json"
    for text in ("", "[]", '{"format": 2, "drives": {}}', '{"format": 1, "drives": {"pump": {"state": "changed"}}}'):
        file.write_text(text)
        assert read_drifts(file) == {}
