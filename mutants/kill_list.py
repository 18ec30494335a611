"""The list of the mutants in the documentation, with what killed each."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from mutant import HERE

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from planting import Fate

PAGE = HERE.parent / "docs" / "mutants.md"
_BEGIN = "<!-- the list: written by mutants/run.py --write -->\n"
_LIST = re.compile(re.escape(_BEGIN) + ".*", re.DOTALL)


def write_page(fates: Mapping[str, Sequence[Fate]]) -> None:
    """Replace the list on the page, which stands at its end."""
    tables = "\n".join(_table(protocol, each) for protocol, each in fates.items())
    PAGE.write_text(_LIST.sub(lambda _: _BEGIN + "\n" + tables, PAGE.read_text(encoding="utf-8")), encoding="utf-8")


def listed_ids() -> list[str]:
    """Return the ids on the page, in its order."""
    return re.findall(r"^\| `([^`]+)` \|", PAGE.read_text(encoding="utf-8"), re.MULTILINE)


def _table(protocol: str, fates: Sequence[Fate]) -> str:
    rows = "".join(f"| `{fate.mutant.id}` | {_cell(fate.mutant.mistake)} | {_killer(fate)} |\n" for fate in fates)
    killed = sum(not fate.survived for fate in fates)
    head = f"## {protocol}\n\n{killed} of {len(fates)} killed.\n\n| mutant | mistake | killed by |\n|---|---|---|\n"
    return head + rows


def _killer(fate: Fate) -> str:
    if fate.survived:
        return f"nothing: {_cell(fate.mutant.same)}"
    return f"`{_cell(fate.check.partition('/')[2] or fate.check)}`"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
