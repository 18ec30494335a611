"""Quality of a reading, and the mark that tells how sure the model is of its meaning."""

from drivecomm.protocol import ParameterInfo, Reading
from drivecomm.protocol.word_format import WordFormat


def reading(**told):
    return Reading(parameter="1", value=1, raw=1, **told)


def test_reading_with_a_note_of_the_model_is_good():
    assert reading(note="type and unit are derived").quality == "good"
    assert reading().quality == "good"


def test_reading_with_a_doubt_is_uncertain():
    assert reading(doubt="another master is on the line").quality == "uncertain"


def test_remark_joins_doubt_and_note():
    assert [each.remark for each in (
        reading(), reading(note="derived"), reading(doubt="two replies"), reading(note="derived", doubt="two replies"),
    )] == ["", "derived", "two replies", "two replies; derived"]  # fmt: skip


def test_float_pattern_that_is_not_a_number_is_uncertain():
    kind = WordFormat(type="f32", size=2)
    found = kind.reading(kind.raw_of((0x7FC0, 0)), "1", None)
    assert (found.value, found.quality, found.doubt) == (
        0x7FC00000, "uncertain", "not a number: the bare pattern of a float",
    )  # fmt: skip


def test_note_of_a_register_reading_states_the_mark_of_the_model():
    kind = WordFormat(type="u16", size=1)
    notes = []
    for sure in ("printed", "drive", "derived", "field", "unconfirmed", "contradicted"):
        found = kind.reading(7, "1", ParameterInfo(address="1", name="speed", title="", sure=sure))
        notes.append((found.quality, found.note))
    assert notes == [
        ("good", ""),
        ("good", ""),
        ("good", "type and unit are derived"),
        ("good", "type and unit are as seen on a drive"),
        ("good", "type and unit are unconfirmed"),
        ("good", "type and unit are contradicted by a drive"),
    ]
