"""Commissioning record of a drive as an HTML page to print, sign and file."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from drivecomm.cli.output import counted
from drivecomm.testing import html_page
from drivecomm.version import __version__

if TYPE_CHECKING:
    from drivecomm.cli.report import Section, SignedRecord


def page(signed: SignedRecord) -> str:
    """Return a record as one HTML file, black on white."""
    not_read = signed.record.now.not_read
    sections = [*signed.sections]
    if not_read:
        sections.append(("Not read", [(address, "", reason) for address, reason in not_read.items()]))
    return html_page(
        title=f"{signed.name.name}: commissioning record",
        kind="commissioning record",
        about=f"{escape(signed.title)}, {escape(signed.name.full_name)}, recorded by {escape(signed.by)} on "
        f"{signed.time:%Y-%m-%d %H:%M} UTC",
        good=not not_read,
        result=f"{counted(len(not_read), 'parameter')} could not be read" if not_read else "All parameters were read",
        notes=[f"drivecomm {__version__}, model {signed.record.now.model}", "Signed: ", "Date: "],
        body="\n".join(map(_section, sections)),
    )


def _section(section: Section) -> str:
    heading, rows = section
    lines = [
        f'<li class="row"><div class="line"><span class="mark"></span><span>{escape(what)}'
        f'<br><span class="quiet">{escape(remark)}</span></span><span class="count"><strong>{escape(value)}</strong>'
        "</span></div></li>"
        for what, value, remark in rows
    ]
    return f"<h2>{escape(heading)}</h2>\n<ul>\n{chr(10).join(lines)}\n</ul>"
