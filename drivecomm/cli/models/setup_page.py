"""Set-up sheet as an HTML page, to print and tick off at the panel."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from drivecomm.models import PURPOSES
from drivecomm.protocol import CERTAIN
from drivecomm.testing import html_page
from drivecomm.version import __version__

if TYPE_CHECKING:
    from drivecomm.cli.models.setup import FilledSheet
    from drivecomm.models import SheetRow


def page(sheet: FilledSheet) -> str:
    """Return a sheet as one HTML file, black on white."""
    lacking = sum(bool(row.lacks) for row in sheet.rows)
    result = f"{len(sheet.rows)} settings" + (f", {lacking} of them without a known value" if lacking else "")
    return html_page(
        title=f"{sheet.drive.name if sheet.drive else sheet.model.title}: set-up sheet",
        kind="set-up sheet",
        about=escape(sheet.about),
        good=bool(sheet.rows) and not lacking,
        result=result if sheet.rows else "No panel setting of this series is documented in our sources",
        notes=[f"drivecomm {__version__}, model {sheet.model.protocol}/{sheet.model.name}", "Set by: ", "Date: "],
        body="\n".join(_section(sheet, purpose, heading) for purpose, heading in PURPOSES.items()),
    )


def _section(sheet: FilledSheet, purpose: str, heading: str) -> str:
    rows = [_row(row) for row in sheet.rows if row.setting.purpose == purpose]
    return f"<h2>{escape(heading)}</h2>\n<ul>\n{chr(10).join(rows)}\n</ul>" if rows else ""


def _row(row: SheetRow) -> str:
    setting = row.setting
    quiet = [
        row.made_of,
        f"factory {setting.factory}" if setting.factory else "",
        *row.remarks,
        setting.source if setting.sure in CERTAIN else f"{setting.source} ({setting.sure})",
    ]
    text = "; ".join(escape(each) for each in quiet if each)
    return (
        f'<li class="row"><div class="line"><span class="mark">☐</span><span><strong>{escape(setting.parameter)}'
        f'</strong> {escape(setting.name)}<br><span class="quiet">{text}</span></span>'
        f'<span class="count"><strong>{escape(row.value or "—")}</strong></span></div></li>'
    )
