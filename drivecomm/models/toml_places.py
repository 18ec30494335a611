"""In which line of a TOML file a table or a key stands, for messages; the standard library does not tell."""

from __future__ import annotations

import re

_HEADER = re.compile(r"\s*(\[\[?)\s*([^\[\]]+?)\s*\]\]?\s*(#.*)?$")
_KEY = re.compile(r"""\s*(?:"([^"]*)"|'([^']*)'|([A-Za-z0-9_-]+))\s*=""")


class Places:
    """The lines of one file, counted from 1. What is written inline or over several lines has the line of its key."""

    def __init__(self, text: str) -> None:
        self._lines: dict[tuple[str, int, str], int] = {}
        counted: dict[str, int] = {}
        table, number = "", 0
        for line, content in enumerate(text.splitlines(), start=1):
            if header := _HEADER.match(content):
                table = header[2]
                number = counted[table] = counted.get(table, -1) + 1
                self._lines.setdefault((table, number, ""), line)
            elif key := _KEY.match(content):
                self._lines.setdefault((table, number, key[1] or key[2] or key[3]), line)

    def of(self, table: str, number: int = 0, key: str = "") -> int:
        """Return the line of a key in the table with this name and number, of the table itself without a key.

        A key that is not there has the line of its table; a table that is not there the first line.
        """
        whole = self._lines.get((table, number, ""), 1)
        return self._lines.get((table, number, key), whole)
