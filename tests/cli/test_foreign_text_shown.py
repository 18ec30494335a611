"""Texts from drives, files and servers, which commands print without terminal control characters."""

import json
import unicodedata

import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from drivecomm.cli import output
from drivecomm.cli.watch import words
from drivecomm.errors import NoReplyError
from drivecomm.plant.watching import DriveEvent, WatchedValue
from drivecomm.protocol import Reading

ESCAPES = "4\x1b[2J\x07\x9b31m\u202egnirts\u2028\r\nfake line\x7f\x00"
FOREIGN = st.text(st.characters(exclude_categories=["Cs"]) | st.sampled_from(ESCAPES), max_size=60)

each_text = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=50)


def is_plain(text):
    return not any(unicodedata.category(each) in ("Cc", "Cf", "Cs", "Zl", "Zp") for each in text)


def lines_of(capsys):
    out, err = capsys.readouterr()
    lines = [*out.split("\n")[:-1], *err.split("\n")[:-1]]
    assert all(map(is_plain, lines))
    return lines


@each_text
@given(FOREIGN)
def test_foreign_text_stays_one_line(capsys, text):
    for printed in (output.say, output.note):
        printed(text)
        assert len(lines_of(capsys)) == 1
    output.complain(NoReplyError(text), as_json=True, where=text)
    shown, told = lines_of(capsys)
    assert is_plain(json.loads(shown)["error"])
    assert told.startswith("drivecomm: ")
    output.tell(text, as_json=True, text=text)
    assert [json.loads(line)["text"] for line in lines_of(capsys)] == [text]


@each_text
@given(st.lists(st.tuples(FOREIGN, FOREIGN), min_size=1, max_size=5))
def test_table_of_foreign_texts_has_one_line_per_row(capsys, rows):
    output.print_columns(rows)
    assert len(lines_of(capsys)) == len(rows)


@given(FOREIGN)
def test_watch_shows_texts_of_drives_without_control_characters(text):
    reading = Reading(parameter="1", value=text, raw=0, unit="", text=text)
    shown = [
        words.in_full(WatchedValue(name="n", reading=reading, quality=quality, cause=text))
        for quality in ("good", "stale")
    ]
    shown.append(words.in_full(WatchedValue(name="n", reading=None, quality="bad", cause=text)))
    shown.append(words.event_line(DriveEvent(time_s=0.0, drive=text, kind="fault", text=text), None))
    assert all(is_plain(each.plain) for each in shown)


@pytest.mark.parametrize("as_json", [False, True])
def test_trace_event_stays_one_line(capsys, as_json):
    from drivecomm.link import TraceEvent

    event = TraceEvent(time=0.0, what="note", drive=ESCAPES, data=b"", detail=ESCAPES)
    output.show_trace(event, as_json=as_json)
    assert len(lines_of(capsys)) == 1
