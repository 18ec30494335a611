"""A page with a plot in it, and its figures as tables: one file that needs nothing from elsewhere."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from drivecomm.plant.value_plots.curves import Picture

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 75rem; padding: 0 1rem; color: #263238; }
svg { width: 100%; height: auto; }
table { border-collapse: collapse; margin: 1rem 0; }
th, td { padding: 0.25rem 0.8rem; border-bottom: 1px solid #cfd8dc; text-align: left; }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; }
"""


_NUMBER = ' class="number"'


def page_of(picture: Picture, title: str, svg: str) -> str:
    """Return the page. svg: the plot, as a document of its own."""
    drawing = svg[svg.index("<svg") :]
    parts = [f"<h1>{escape(title)}</h1>", drawing, *_curves(picture), *_faults(picture)]
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f"<title>{escape(title)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n"
        + "\n".join(parts)
        + "\n</body>\n</html>\n"
    )


def _curves(picture: Picture) -> list[str]:
    rows = []
    for curve in picture.curves:
        numbers = curve.numbers
        figures = (min(numbers), sum(numbers) / len(numbers), max(numbers), numbers[-1])
        texts = [f"{figure:.6g}" for figure in figures]
        rows.append([curve.drive, curve.name, curve.unit, *texts, str(len(numbers)), str(curve.gaps)])
    heads = ["drive", "quantity", "unit", "lowest", "mean", "highest", "last", "values", "gaps"]
    return ["<h2>Values</h2>", _table(heads, rows, numbers_from=3)] if rows else []


def _faults(picture: Picture) -> list[str]:
    rows = [
        [each.drive, each.text or "fault", each.begin.isoformat(" ", "seconds"), each.end.isoformat(" ", "seconds")]
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
