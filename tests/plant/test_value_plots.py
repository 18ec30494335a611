"""Plots of value logs: their contents, and valid files in each format."""

import re
import sys
from datetime import UTC, datetime, timedelta
from html.parser import HTMLParser
from math import isnan
from xml.etree import ElementTree as ET

import pytest
from hypothesis import given, strategies as st

from drivecomm.errors import FileFormatError, UsageError
from drivecomm.plant import Outline
from drivecomm.plant.value_log import LogRow
from drivecomm.plant.value_plots import Curve, draw_svg, picture_of, save

BEGIN = datetime(2026, 3, 1, 8, tzinfo=UTC)


def row(second, name, value="", *, drive="pump", unit="Hz", quality="good", **more):
    return LogRow(
        time=BEGIN + timedelta(seconds=second),
        drive=drive,
        name=name,
        value=str(value),
        unit=unit,
        quality=quality,
        **more,
    )


def status(second, state, *, drive="pump", **more):
    return row(second, "status", state, drive=drive, unit="", **more)


ROWS = [
    *(row(second, "output_frequency", second) for second in range(5)),
    row(5, "output_frequency", quality="bad", unit=""),
    *(row(second, "output_frequency", 30) for second in range(6, 10)),
    *(row(second, "output_current", 5.5, unit="A") for second in range(10)),
    *(row(second, "output_frequency", 40, drive="fan") for second in range(10)),
    row(9, "software_version", "4.1", unit="", drive="fan"),
    status(0, "running"),
    status(5, "", quality="bad", note="did not answer"),
    status(6, "running"),
    status(9, "running"),
    status(0, "running", drive="fan"),
    status(3, "fault", drive="fan", text="14 earth fault"),
    status(6, "fault", drive="fan", text="14 earth fault"),
    status(8, "not_ready", drive="fan"),
]


def test_plot_has_a_panel_for_each_unit():
    picture = picture_of(ROWS)
    assert {unit: [curve.title for curve in panel] for unit, panel in picture.panels.items()} == {
        "Hz": ["pump output frequency", "fan output frequency"],
        "A": ["pump output current"],
        "": ["fan software version"],
    }


def test_missing_value_is_a_gap():
    curve = picture_of(ROWS).panels["Hz"][0]
    assert [isnan(value) for value in curve.values] == [False] * 5 + [True] + [False] * 4
    assert (curve.gaps, len(curve.numbers)) == (1, 9)


def test_stale_value_is_a_gap():
    curve = picture_of([row(0, "x", 1), row(0, "x", 1, quality="stale"), row(2, "x", 2)]).curves[0]
    assert (curve.numbers, curve.gaps) == ([1.0, 2.0], 1)


def test_plot_holds_states_and_faults():
    picture = picture_of(ROWS)
    assert [(each.drive, each.state, (each.end - each.begin).seconds) for each in picture.states] == [
        ("pump", "running", 5),
        ("pump", "no answer", 1),
        ("pump", "running", 3),
        ("fan", "running", 3),
        ("fan", "fault", 5),
        ("fan", "not ready", 0),
    ]
    assert [(each.text, each.begin) for each in picture.faults] == [("14 earth fault", BEGIN + timedelta(seconds=3))]


def test_plot_is_limited_to_the_given_drives_and_names():
    picture = picture_of(ROWS, drives=["fan"], names=["output_frequency"])
    assert [curve.title for curve in picture.curves] == ["fan output frequency"]
    assert picture.drives == ["fan"]
    with pytest.raises(UsageError, match="the log has no drive 'mixer'; it has pump, fan"):
        picture_of(ROWS, drives=["mixer"])
    with pytest.raises(UsageError, match="the log has no name 'torque'; it has output_frequency, output_current"):
        picture_of(ROWS, names=["torque"])
    with pytest.raises(UsageError, match="the log holds no numbers to plot"):
        picture_of([row(0, "x", quality="bad")])


@given(st.lists(st.one_of(st.just(float("nan")), st.floats(-1e3, 1e3)), min_size=1, max_size=400), st.integers(10, 60))
def test_thinning_keeps_extremes_order_and_gaps(values, most):
    times = [BEGIN + timedelta(seconds=second) for second in range(len(values))]
    curve = Curve(drive="d", name="n", unit="", times=times, values=values)
    thin = curve.thinned(most)
    assert thin.times == sorted(set(thin.times))
    # First, last and extremes of each stretch; more only at gaps, of which a limited number is kept.
    stretches = -(-most // Outline.POINTS)
    assert len(thin.values) <= max(most, stretches * (Outline.POINTS + 3 * (Outline.MOST_GAPS + 1)))
    if not curve.gaps:
        assert len(thin.values) <= most + Outline.POINTS
    if curve.numbers:
        assert (min(thin.numbers), max(thin.numbers)) == (min(curve.numbers), max(curve.numbers))
    assert bool(thin.gaps) == bool(curve.gaps)
    assert (str(thin.values[0]), str(thin.values[-1])) == (str(curve.values[0]), str(curve.values[-1]))


@pytest.mark.soak
def test_png_shows_the_fault(tmp_path):
    imread = pytest.importorskip("matplotlib.image").imread
    path = tmp_path / "plot.png"
    save(picture_of(ROWS), "log", path)
    content = path.read_bytes()
    assert content.startswith(b"\x89PNG\r\n\x1a\n")
    width, height = int.from_bytes(content[16:20], "big"), int.from_bytes(content[20:24], "big")
    assert width > 1000
    assert height > 800
    red = (imread(path)[:, :, :3] - [0.776, 0.157, 0.157]).__abs__().max(axis=2) < 0.02
    assert red.sum() > 1000, "the fault is to be seen"


@pytest.mark.soak
def test_svg_is_reproducible_and_loads_nothing(tmp_path):
    path = tmp_path / "plot.svg"
    save(picture_of(ROWS), "log", path)
    text = path.read_text(encoding="utf-8")
    assert text == draw_svg(picture_of(ROWS), "log")
    root = ET.fromstring(text)
    assert root.tag.endswith("}svg")
    assert not _fetched(text)
    lines = [group for group in root.iter() if group.get("id", "").startswith("line2d")]
    assert len(lines) > 5


class _Page(HTMLParser):
    def __init__(self):
        super().__init__()
        self.tags = []
        self.text = []

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))

    def handle_data(self, data):
        self.text.append(data)


@pytest.mark.soak
def test_html_page_loads_nothing_from_elsewhere(tmp_path):
    path = tmp_path / "plot.html"
    rows = [*ROWS, status(9, "fault", text="<b>5</b>")]
    save(picture_of(rows), "a <log>", path)
    content = path.read_text(encoding="utf-8")
    page = _Page()
    page.feed(content)
    tags = [tag for tag, _ in page.tags]
    assert tags.count("svg") == 1
    assert tags.count("table") == 2
    assert "b" not in tags
    assert not {"script", "link", "img", "iframe"} & set(tags)
    assert not _fetched(content)
    assert {"output_frequency", "14 earth fault", "<b>5</b>", "a <log>"} <= set(page.text)
    assert "<?xml" not in content


def _fetched(text):
    """Return the references that a browser would load from elsewhere; names of namespaces do not count."""
    return re.findall(r"""(?:src|href)=["'](?!#)[^"']*|url\(["']?(?!#)[^)]*|@import[^;]*""", text)


@pytest.mark.soak
def test_unwritable_plot_is_refused(tmp_path):
    picture = picture_of(ROWS)
    with pytest.raises(UsageError, match=r"a plot is .png, .svg or .html"):
        save(picture, "log", tmp_path / "plot.pdf")
    with pytest.raises(FileFormatError, match="cannot be written"):
        save(picture, "log", tmp_path / "nowhere" / "plot.svg")


def test_plot_without_matplotlib_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(UsageError, match=r"plots need matplotlib, which is not installed; install drivecomm\[plot\]"):
        save(picture_of(ROWS), "log", tmp_path / "plot.png")


def test_single_moment_and_states_alone_can_be_plotted(tmp_path):
    save(picture_of([row(0, "x", 1)]), "one", tmp_path / "one.svg")
    save(picture_of([status(0, "running"), status(5, "fault")]), "states", tmp_path / "states.svg")
    assert (tmp_path / "states.svg").exists()
