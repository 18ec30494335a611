"""A report as a page of HTML that a maintainer can publish: one file, no scripts, nothing loaded from elsewhere."""

from __future__ import annotations

import platform
from html import escape
from string import Template
from typing import TYPE_CHECKING

from drivecomm.testing.report import sections_of
from drivecomm.version import __version__

if TYPE_CHECKING:
    from collections.abc import Iterable

    from drivecomm.protocol import Protocol
    from drivecomm.testing.report import CheckResult, Report, Row, Section

_PAGE = Template("""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>$title: conformance</title>
<style>
:root { color-scheme: light; }
body { margin: 0 auto; max-width: 60rem; padding: 1rem; background: #fff; color: #1b1f24;
       font: 1rem/1.5 system-ui, sans-serif; overflow-wrap: anywhere; }
h1 { font-size: 1.5rem; line-height: 1.25; margin: 0 0 .25rem; }
h2 { font-size: 1.15rem; margin: 2rem 0 .5rem; display: flex; flex-wrap: wrap; gap: .25rem .75rem;
     align-items: baseline; border-bottom: 1px solid #d0d7de; padding-bottom: .25rem; }
p { margin: .25rem 0; }
.quiet { color: #57606a; font-size: .9rem; font-weight: normal; }
.result { display: inline-block; margin: .75rem 0; padding: .4rem .9rem; border-radius: .4rem; font-weight: 600; }
.good { background: #dafbe1; color: #0a5221; }
.bad { background: #ffe3e0; color: #8c0d12; }
ul { list-style: none; margin: 0; padding: 0; }
li.row { padding: .4rem 0; border-bottom: 1px solid #eaeef2; }
.line { display: grid; grid-template-columns: 1.5rem 1fr auto; gap: 0 .5rem; }
.mark { font-weight: 700; }
.row.holds .mark { color: #0a5221; }
.row.fails .mark { color: #8c0d12; }
.count { text-align: right; white-space: nowrap; font-variant-numeric: tabular-nums; }
details { margin: .25rem 0 0 2rem; }
summary { cursor: pointer; color: #8c0d12; }
.failure { margin: .4rem 0; padding: .4rem .6rem; background: #fff5f4; border-left: 3px solid #cf222e; }
code { font: .85rem/1.4 ui-monospace, monospace; }
</style>
</head>
<body>
<h1>$title</h1>
<p class="quiet">Conformance of the protocol package <code>$name</code></p>
<p class="result $tone">$result</p>
<p class="quiet">drivecomm $version, Python $python, $seconds s$left_out</p>
$sections
</body>
</html>
""")


def page(plugin: Protocol, report: Report) -> str:
    """Return a report about a protocol as HTML."""
    failed, number = len(report.failed), len(report.results)
    result = f"all {number} checks hold" if report.ok else f"{failed} of {number} checks do not hold"
    return _PAGE.substitute(
        title=escape(plugin.title),
        name=escape(plugin.name),
        tone="good" if report.ok else "bad",
        result=result,
        version=escape(__version__),
        python=escape(platform.python_version()),
        seconds=f"{report.seconds:.1f}",
        left_out="".join(f"<br>left out: {escape(what)}" for what in report.left_out),
        sections="\n".join(map(_section, sections_of(report))),
    )


def _section(section: Section) -> str:
    count = f"{section.failed} of {section.number} do not hold" if section.failed else f"{section.number} hold"
    rows = "\n".join(map(_row, section.rows))
    return f'<h2>{escape(section.title)} <span class="quiet">{count}</span></h2>\n<ul>\n{rows}\n</ul>'


def _row(row: Row) -> str:
    holds = not row.failed
    return (
        f'<li class="row {"holds" if holds else "fails"}"><div class="line">'
        f'<span class="mark">{"✓" if holds else "✗"}</span>'
        f'<span>{escape(row.meaning or row.kind)} <span class="quiet">{escape(row.kind)}</span></span>'
        f'<span class="count quiet">{row.number - len(row.failed)}/{row.number}</span></div>'
        f"{_failures(row.failed)}</li>"
    )


def _failures(failed: Iterable[CheckResult]) -> str:
    told = "".join(
        f'<div class="failure"><code>{escape(result.name)}</code><br>{escape(result.reason)}</div>' for result in failed
    )
    return f"<details open><summary>what is wrong</summary>{told}</details>" if told else ""
