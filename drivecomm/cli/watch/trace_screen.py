"""The telegrams with one drive, decoded, as they come."""

from __future__ import annotations

import textwrap
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

from rich.text import Text
from textual.binding import Binding
from textual.screen import Screen
from textual.widgets import Footer, RichLog, Static

from drivecomm.link import trace_line

if TYPE_CHECKING:
    from textual.app import ComposeResult
    from textual.binding import BindingType

    from drivecomm.link import TraceEvent
    from drivecomm.plant.watching import Watcher

REFRESH_S = 0.5
_CHROME = 4
_INDENT = 18
_STYLES = {"damaged": "red", "noise": "red", "stray": "yellow", "note": "dim", "echo": "dim"}


class TraceScreen(Screen[None]):
    """Shows what goes over the line between the master and one drive; space holds it still."""

    CSS = """
    TraceScreen #title { height: 1; background: $panel; padding: 0 1; text-style: bold; }
    TraceScreen RichLog { height: 1fr; padding: 0 1; background: $surface; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,t,q", "app.pop_screen", "back", key_display="esc"),
        Binding("space", "hold", "hold still"),
    ]

    def __init__(self, watcher: Watcher, drive: str) -> None:
        super().__init__()
        self._watcher = watcher
        self._drive = drive
        self._latest: TraceEvent | None = None
        self._held = False

    def compose(self) -> ComposeResult:
        """Show the latest telegrams and the keys."""
        yield Static(self._title, id="title", markup=False)
        yield RichLog(markup=False, max_lines=2000)
        yield Footer()

    def on_mount(self) -> None:
        """Begin."""
        self.show()
        self.set_interval(REFRESH_S, self.show)
        self.query_one(RichLog).focus()

    @property
    def _title(self) -> str:
        return f"telegrams with {self._drive}{', held still' if self._held else ''}"

    def show(self) -> None:
        """Add the telegrams that have come since."""
        if self._held:
            return
        log = self.query_one(RichLog)
        for event in self._new_events():
            for line in _lines_of(event, self.size.width - _CHROME):
                log.write(Text(line, style=_STYLES.get(event.what, "")))
            self._latest = event

    def _new_events(self) -> list[TraceEvent]:
        events = list(self._watcher.telegrams(self._drive))
        for place in range(len(events) - 1, -1, -1):
            if events[place] is self._latest:
                return events[place + 1 :]
        return events

    def action_hold(self) -> None:
        """Hold the trace still, or let it go on."""
        self._held = not self._held
        self.query_one("#title", Static).update(self._title)
        self.show()


def _lines_of(event: TraceEvent, width: int) -> list[str]:
    """Return an event in lines that fit; whose it is stands above them all."""
    return textwrap.wrap(trace_line(replace(event, drive="")), max(width, 2 * _INDENT), subsequent_indent=" " * _INDENT)
