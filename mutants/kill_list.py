"""The lists of the mutants in the documentation, with what killed each."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from mutant import HERE

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from planting import Fate

PAGE = HERE.parent / "docs" / "development" / "mutants.md"
FRAMEWORK_PAGE = HERE.parent / "docs" / "development" / "mutants-framework.md"
_BEGIN = "<!-- the list: written by mutants/run.py --write -->\n"
_LIST = re.compile(re.escape(_BEGIN) + ".*", re.DOTALL)


def write_page(page: Path, fates: Mapping[str, Sequence[Fate]]) -> None:
    """Replace the list on a page, which stands at its end."""
    tables = "\n".join(_table(group, each) for group, each in fates.items())
    page.write_text(_LIST.sub(lambda _: _BEGIN + "\n" + tables, page.read_text(encoding="utf-8")), encoding="utf-8")


def listed_ids(page: Path) -> list[str]:
    """Return the ids on a page, in its order."""
    return re.findall(r"^\| `([^`]+)` \|", page.read_text(encoding="utf-8"), re.MULTILINE)


def _table(group: str, fates: Sequence[Fate]) -> str:
    rows = "".join(f"| `{fate.mutant.id}` | {_cell(fate.mutant.mistake)} | {_killer(fate)} |\n" for fate in fates)
    killed = sum(not fate.survived for fate in fates)
    head = f"## {group}\n\n{killed} of {len(fates)} killed.\n\n| mutant | mistake | killed by |\n|---|---|---|\n"
    return head + rows


def _killer(fate: Fate) -> str:
    if fate.survived:
        return f"nothing: {_cell(fate.mutant.same)}"
    return f"`{_cell(fate.check.partition('/')[2] or fate.check)}`"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
