"""The page about the bus engine names every counter, every line fact and every echo mode."""

import re
from typing import get_args

from pages import ROOT

from drivecomm.link import COUNTERS, Echo
from drivecomm.protocol import LINE_FACT_NAMES

PAGE = (ROOT / "docs" / "explanation" / "bus.md").read_text(encoding="utf-8")


def rows_under(heading):
    section = PAGE.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]
    return re.findall(r"^\| (`.+?) \| (.+) \|$", section, re.MULTILINE)


def test_page_explains_every_counter():
    assert {name.strip("`"): meaning for name, meaning in rows_under("Statistics")} == COUNTERS


def test_page_names_every_line_fact():
    named = {name for names, _ in rows_under("Line facts of each drive") for name in re.findall(r"`(\w+)`", names)}
    assert named == LINE_FACT_NAMES


def test_page_names_every_echo_mode():
    assert [name.strip("`") for name, _ in rows_under("Echo")] == list(get_args(Echo))
