"""Values over time drawn as characters, with gaps."""

from hypothesis import given, strategies as st

from drivecomm.cli.watch.panels import GAP, chart, sparkline

VALUES = st.lists(st.one_of(st.none(), st.floats(-1e6, 1e6)), min_size=1, max_size=60)


def test_sparkline_scale_includes_zero():
    assert sparkline([0.0, 5.0, None, 10.0]) == "▁▅ █"
    assert sparkline([7.0, 7.0]) == "██"
    assert sparkline([0.0, 0.0]) == "▁▁"
    assert sparkline([-10.0, 0.0]) == "▁█"
    assert sparkline([]) == ""


def test_chart_shows_its_scale():
    assert chart([0.0, 25.0, 50.0, None], 4) == [
        "50   █ ",
        "     █ ",
        "    ██ ",
        " 0 ▁██ ",
    ]


@given(VALUES)
def test_higher_value_is_never_drawn_lower(values):
    drawn = sparkline(values)
    assert len(drawn) == len(values)
    shown = sorted((value, character) for value, character in zip(values, drawn, strict=True) if value is not None)
    assert [character for _, character in shown] == sorted(character for _, character in shown)
    assert [character == GAP for character in drawn] == [value is None for value in values]


@given(VALUES, st.integers(2, 24))
def test_chart_fills_its_lines_from_below(values, height):
    lines = chart(values, height)
    assert len(lines) == height
    assert len({len(line) for line in lines}) == 1
    columns = zip(*(line[-len(values) :] for line in lines), strict=True)
    for value, column in zip(values, columns, strict=True):
        text = "".join(column)
        assert text.lstrip(GAP).count(GAP) == 0
        assert (text.strip(GAP) == "") == (value is None)
