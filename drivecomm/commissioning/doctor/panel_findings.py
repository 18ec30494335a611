"""Findings on panel settings: differences from the plant, and settings that keep a drive from obeying commands."""

from __future__ import annotations

from itertools import groupby
from typing import TYPE_CHECKING, Literal, TypeAlias

from drivecomm.protocol import DOUBTFUL, SETTING_NAMES

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from drivecomm.commissioning.doctor.panel import PanelReading
    from drivecomm.protocol import Purpose

Weight: TypeAlias = Literal["fine", "note", "problem"]

_SO_THAT: dict[Purpose, str] = {
    "commands": "so that it obeys no command over the line",
    "reference": "so that it takes no reference over the line",
}

_SAID_BY = {
    "baudrate": {"baudrate"},
    "bytesize": {"bytesize"},
    "parity": {"parity"},
    "stopbits": {"stopbits"},
    "format": {"bytesize", "parity", "stopbits"},
    "line": set(SETTING_NAMES),
}
"""Options of a plant file that determine a setting, by the source of the setting."""


def panel_findings(readings: Sequence[PanelReading], *, carries_settings: bool) -> Iterator[tuple[Weight, str, str]]:
    """Yield weight, text and remedy of each finding on the panel settings of drives.

    carries_settings: whether the line has the settings of the plant. Behind a serial server it may have others, so a
    difference in a setting that the plant file does not state is only a note.
    """
    for drive, group in groupby(readings, key=lambda one: one.drive):
        several = list(group)
        for one in several:
            if not one.agrees:
                yield _weight(one, carries_settings=carries_settings), _difference(one), _remedy(one)
        right = sum(one.agrees for one in several)
        if right:
            text = f"{right} of {len(several)} panel settings that it reports match the plant file"
            yield "fine", f"{drive.full_name}: {text}", ""


def _weight(one: PanelReading, *, carries_settings: bool) -> Weight:
    setting = one.row.setting
    if setting.when or setting.sure in DOUBTFUL or setting.purpose == "link loss":
        return "note"
    if setting.purpose in _SO_THAT:
        # A drive that cannot be commanded need not obey.
        return "problem" if one.drive.armed else "note"
    said = one.drive.options.keys() & _SAID_BY.get(setting.made_from or "", set())
    return "problem" if carries_settings or said or setting.made_from == "address" else "note"


def _difference(one: PanelReading) -> str:
    setting = one.row.setting
    text = f"{one.drive.full_name}: {setting.parameter} ({setting.name}) is {one.shown}"
    if setting.made_from is not None:
        text += f"; the plant file says {one.row.made_of}"
    elif setting.purpose in _SO_THAT:
        text += f", {_SO_THAT[setting.purpose]}"
    return f"{text}; counts only {setting.when}" if setting.when else text


def _remedy(one: PanelReading) -> str:
    setting = one.row.setting
    means = f" ({setting.means})" if setting.means else ""
    if setting.purpose == "link loss":
        return f"drivecomm start {one.drive.name} sets it; at the panel set {setting.parameter} to {one.row.value}"
    return f"set {setting.parameter} to {' or '.join(one.row.right)}{means} at the panel ({setting.source})"
