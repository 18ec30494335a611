"""HTML page of a report: one file without scripts or external parts, for screen and paper."""

from __future__ import annotations

import platform
from html import escape
from string import Template
from typing import TYPE_CHECKING

from drivecomm.version import __version__

if TYPE_CHECKING:
    from collections.abc import Iterable

_PAGE = Template("""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>$title: $kind</title>
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
pre { font: .75rem/1.35 ui-monospace, monospace; white-space: pre-wrap; margin: .4rem 0; padding: .4rem .6rem;
      background: #f6f8fa; }
@media print { body { max-width: none; padding: 0; } li.row { break-inside: avoid; } details > pre { display: block; } }
code { font: .85rem/1.4 ui-monospace, monospace; }
</style>
</head>
<body>
<h1>$title</h1>
<p class="quiet">$about</p>
<p class="result $tone">$result</p>
<p class="quiet">$notes</p>
$body
</body>
</html>
""")


def made_with() -> str:
    """Return the versions of drivecomm and of Python that made a report."""
    return f"drivecomm {__version__}, Python {platform.python_version()}"


def html_page(*, title: str, kind: str, about: str, good: bool, result: str, notes: Iterable[str], body: str) -> str:
    """Return a page. about and body are HTML, the rest is text; kind follows the title in the window title."""
    return _PAGE.substitute(
        title=escape(title),
        kind=escape(kind),
        about=about,
        tone="good" if good else "bad",
        result=escape(result),
        notes="<br>".join(map(escape, notes)),
        body=body,
    )
