"""Lists of the mutants in the documentation, each with the test or check that killed it."""

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
_SECTION = re.compile(r"^## .*?(?=^## |\Z)", re.MULTILINE | re.DOTALL)


def write_sections(page: Path, fates: Mapping[str, Sequence[Fate]]) -> None:
    """Replace the sections of these groups on the page; other sections stay."""
    text = page.read_text(encoding="utf-8")
    sections = {each.group().partition("\n")[0]: each.group().rstrip() for each in _SECTION.finditer(text)}
    for group, of_group in fates.items():
        sections[f"## {group}"] = _table(group, of_group).rstrip()
    head = _SECTION.sub("", text).rstrip()
    page.write_text("\n\n".join([head, *(sections[title] for title in sorted(sections))]) + "\n", encoding="utf-8")


def listed_ids(page: Path) -> list[str]:
    """Return the ids on a page, in order."""
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
