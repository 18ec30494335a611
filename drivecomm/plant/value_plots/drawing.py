"""Drawing of a plot with matplotlib, which only this module loads, and an HTML page with the plot and its figures."""

from __future__ import annotations

import io
from datetime import datetime
from html import escape
from typing import TYPE_CHECKING, Any

from drivecomm.errors import FileFormatError, UsageError
from drivecomm.plant.value_plots.curves import FAULT, SILENT

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from drivecomm.plant.value_plots.curves import PlotContents, StateSpan


_WIDTH, _PANEL_HEIGHT, _STATE_HEIGHT, _MARGIN = 10.0, 2.4, 0.36, 0.9
_MOST_IN_A_LEGEND = 12
_SHORTEST_WITH_TEXT = 0.08

# Hatching keeps the states distinct in print and for readers who see few colours.
_STATES = {
    "running": ("#2f7d4f", ""),
    "ready": ("#cfd8dc", ""),
    "not ready": ("#eceff1", ""),
    "stopping": ("#f0b429", ""),
    FAULT: ("#c62828", "////"),
    SILENT: ("#ffffff", "...."),
}
_OTHER = ("#90a4ae", "")

# A drive has the same colour in all panels; its quantities in one panel differ by their dashes.
_DASHES = ("-", "--", ":", "-.")


def draw_png(picture: PlotContents, title: str) -> bytes:
    """Return the plot as PNG."""
    return _drawn(picture, title, "png", dpi=130)


def draw_svg(picture: PlotContents, title: str) -> str:
    """Return the plot as SVG; the same picture gives the same text."""
    return _drawn(picture, title, "svg", metadata={"Date": None, "Creator": "drivecomm"}).decode("utf-8")


def save(picture: PlotContents, title: str, path: Path) -> None:
    """Write the plot in the format of the file ending.

    Raises UsageError for another ending, FileFormatError if the file cannot be written.
    """
    if path.suffix == ".png":
        content = draw_png(picture, title)
    elif path.suffix == ".svg":
        content = draw_svg(picture, title).encode()
    elif path.suffix in (".html", ".htm"):
        content = page_of(picture, title, draw_svg(picture, title)).encode()
    else:
        raise UsageError(f"{path}: a plot is .png, .svg or .html; give it one of these endings")
    try:
        path.write_bytes(content)
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be written: {error.strerror or error}") from error


def _drawn(picture: PlotContents, title: str, form: str, **how: Any) -> bytes:
    try:
        import matplotlib as mpl
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        raise UsageError("plots need matplotlib, which is not installed; install drivecomm[plot]") from None
    states_height = _STATE_HEIGHT * len(picture.drives) + (0.5 if picture.drives else 0)
    heights = [_PANEL_HEIGHT] * len(picture.panels) + ([states_height] if picture.drives else [])
    with mpl.rc_context(
        {"svg.hashsalt": "drivecomm", "svg.fonttype": "path", "timezone": "UTC", "hatch.linewidth": 0.6}
    ):
        figure = Figure(figsize=(_WIDTH, sum(heights) + _MARGIN), layout="constrained")
        FigureCanvasAgg(figure)
        panels = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
        for panel, unit in zip(panels, picture.panels, strict=False):
            _draw_values(panel, picture, unit)
        if picture.drives:
            _draw_states(panels[-1], picture)
        _draw_time(panels[-1])
        figure.suptitle(title, fontsize=11, fontweight="bold")
        content = io.BytesIO()
        figure.savefig(content, format=form, **how)
    return content.getvalue()


def _draw_values(panel: Any, picture: PlotContents, unit: str) -> None:
    curves = picture.panels[unit]
    drives = list(dict.fromkeys(curve.drive for curve in picture.curves))
    for place, curve in enumerate(curves):
        thin = curve.thinned()
        before = sum(other.drive == curve.drive for other in curves[:place])
        panel.plot(
            thin.times, thin.values, label=curve.title, linewidth=1.3,
            color=f"C{drives.index(curve.drive)}", linestyle=_DASHES[before % len(_DASHES)],
            # A point between two gaps draws no line, so it needs a marker.
            marker=".", markersize=2.2,
        )  # fmt: skip
    for fault in picture.faults:
        if any(curve.drive == fault.drive for curve in curves):
            panel.axvline(fault.begin, color=_STATES[FAULT][0], linestyle="--", linewidth=1)
    panel.set_ylabel({"degC": "°C", "": "number"}.get(unit, unit))
    panel.grid(visible=True, alpha=0.3)
    panel.margins(x=0.01)
    panel.legend(
        handles=panel.get_legend_handles_labels()[0][:_MOST_IN_A_LEGEND],
        loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8, frameon=False,
    )  # fmt: skip


def _draw_states(panel: Any, picture: PlotContents) -> None:
    from matplotlib.dates import date2num

    first = min(each.begin for each in picture.states)
    last = max(each.end for each in picture.states)
    whole_s = max((last - first).total_seconds(), 1e-3)
    shown: dict[str, Any] = {}
    for each in picture.states:
        colour, hatch = _STATES.get(each.state, _OTHER)
        row = picture.drives.index(each.drive)
        begin, end = float(date2num(each.begin)), float(date2num(each.end))
        bars = panel.broken_barh(
            [(begin, end - begin)], (row - 0.36, 0.72),
            facecolor=colour, edgecolor="#37474f", linewidth=0.5, hatch=hatch, label=each.state,
        )  # fmt: skip
        shown.setdefault(each.state, bars)
        if each.state == FAULT and each.text:
            _write_fault(panel, each, row, whole_s)
    panel.set_yticks(range(len(picture.drives)), picture.drives, fontsize=8)
    panel.set_ylim(len(picture.drives) - 0.4, -0.6)
    panel.margins(x=0.01)
    panel.legend(handles=list(shown.values()), loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8, frameon=False)


def _write_fault(panel: Any, fault: StateSpan, row: int, whole_s: float) -> None:
    share = (fault.end - fault.begin).total_seconds() / whole_s
    text = fault.text if share >= _SHORTEST_WITH_TEXT else fault.text.partition(" ")[0]
    panel.text(
        fault.begin, row, f" {text}", fontsize=7, va="center", ha="left", clip_on=True, color="white",
        bbox={"facecolor": _STATES[FAULT][0], "edgecolor": "none", "pad": 0.6},
    )  # fmt: skip


def _draw_time(panel: Any) -> None:
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

    here = datetime.now().astimezone()
    locator = AutoDateLocator(tz=here.tzinfo)
    panel.xaxis.set_major_locator(locator)
    panel.xaxis.set_major_formatter(ConciseDateFormatter(locator, tz=here.tzinfo))
    panel.set_xlabel(f"time, {here:%Z}")


_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 75rem; padding: 0 1rem; color: #263238; }
svg { width: 100%; height: auto; }
table { border-collapse: collapse; margin: 1rem 0; }
th, td { padding: 0.25rem 0.8rem; border-bottom: 1px solid #cfd8dc; text-align: left; }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; }
"""
_NUMBER = ' class="number"'


def page_of(picture: PlotContents, title: str, svg: str) -> str:
    """Return the HTML page. svg: the plot, as a complete SVG document."""
    drawing = svg[svg.index("<svg") :]
    parts = [f"<h1>{escape(title)}</h1>", drawing, *_curves(picture), *_faults(picture)]
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f"<title>{escape(title)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n"
        + "\n".join(parts)
        + "\n</body>\n</html>\n"
    )


def _curves(picture: PlotContents) -> list[str]:
    rows = []
    for curve in picture.curves:
        numbers = curve.numbers
        figures = (min(numbers), sum(numbers) / len(numbers), max(numbers), numbers[-1])
        texts = [f"{figure:.6g}" for figure in figures]
        rows.append([curve.drive, curve.name, curve.unit, *texts, str(len(numbers)), str(curve.gaps)])
    heads = ["drive", "quantity", "unit", "lowest", "mean", "highest", "last", "values", "gaps"]
    return ["<h2>Values</h2>", _table(heads, rows, numbers_from=3)] if rows else []


def _local(at: datetime) -> str:
    return at.astimezone().isoformat(" ", "seconds")


def _faults(picture: PlotContents) -> list[str]:
    rows = [
        [
            each.drive,
            each.text or "fault",
            _local(each.begin),
            _local(each.end),
        ]
        for each in picture.faults
    ]
    return ["<h2>Faults</h2>", _table(["drive", "fault", "from", "to"], rows, numbers_from=4)] if rows else []


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]], *, numbers_from: int) -> str:
    def line(cells: Sequence[str], tag: str) -> str:
        drawn = (
            f"<{tag}{_NUMBER if place >= numbers_from else ''}>{escape(cell)}</{tag}>"
            for place, cell in enumerate(cells)
        )
        return f"<tr>{''.join(drawn)}</tr>"

    return "\n".join(["<table>", line(heads, "th"), *(line(row, "td") for row in rows), "</table>"])
