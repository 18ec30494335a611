"""The code blocks of the documentation, and the remarks that say what tests do with them.

A block is run, unless the comment `<!-- not run: why -->` precedes it; then a Python block is still compiled.

`<!-- continues -->` gives a block the names of the block before it.

`<!-- prints -->` precedes the output of the Python block above it, in which `...` matches anything.

A block with a title is a file, not a script.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from textwrap import dedent

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]

_FENCE = re.compile(
    r"(?:^ *<!-- (?P<remark>[^\n]*?) -->\n\s*)?"
    r"^ *```(?P<language>\w+)(?P<rest>[^\n]*)\n(?P<code>.*?)^ *```$",
    re.MULTILINE | re.DOTALL,
)


@dataclass(frozen=True)
class Block:
    page: Path
    line: int
    language: str
    title: str
    remark: str
    code: str

    @property
    def is_run(self):
        return not self.remark.startswith("not run:") and not self.title

    def __str__(self):
        return f"{self.page.relative_to(ROOT)}:{self.line}"


def blocks_of(page):
    text = page.read_text(encoding="utf-8")
    for found in _FENCE.finditer(text):
        title = re.search(r'title="([^"]*)"', found["rest"])
        yield Block(
            page=page,
            line=text.count("\n", 0, found.start("code")),
            language=found["language"],
            title=title[1] if title else "",
            remark=found["remark"] or "",
            code=dedent(found["code"]),
        )


def pages_with(language):
    return [page for page in PAGES if any(block.language == language for block in blocks_of(page))]


def name_of(page):
    return str(page.relative_to(ROOT))
