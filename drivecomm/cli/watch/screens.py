"""Screens on top of the table of drives: parameters, telegrams, a question."""

from __future__ import annotations

import textwrap
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

from rich.text import Text
from textual.binding import Binding
from textual.containers import Vertical
from textual.screen import ModalScreen, Screen
from textual.widgets import DataTable, Footer, RichLog, Static

from drivecomm.cli.watch.words import ASIDE, WARNING, unit_of
from drivecomm.errors import DriveCommError, in_one_line, printable
from drivecomm.link import trace_line

if TYPE_CHECKING:
    from textual.app import ComposeResult
    from textual.binding import BindingType
    from textual.events import Resize

    from drivecomm.link import TraceEvent
    from drivecomm.plant.watching import Watcher
    from drivecomm.protocol import ParameterInfo

_CHROME = 4
"""Number of lines without a parameter (title, heads, message, keys), and of columns without a telegram."""


class ParametersScreen(Screen[None]):
    """Parameters of one drive; reads only parameters on the screen, and writes nothing."""

    CSS = """
    ParametersScreen #title { height: 1; background: $panel; padding: 0 1; text-style: bold; }
    ParametersScreen DataTable { height: 1fr; background: $surface; }
    ParametersScreen #message { height: 1; padding: 0 1; color: $text-muted; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,p,q", "app.pop_screen", "back", key_display="esc"),
        Binding("n,pagedown", "page(1)", "next page", key_display="n"),
        Binding("b,pageup", "page(-1)", "previous page", key_display="b"),
        Binding("r", "read_again", "read again"),
    ]

    def __init__(self, watcher: Watcher, drive: str) -> None:
        super().__init__()
        self._watcher = watcher
        self._drive = drive
        model = watcher.drive(drive).model
        self._title = model.title if model else "no model"
        self._parameters: list[ParameterInfo] = list(model.parameters.values()) if model else []
        self._values: dict[str, Text] = {}
        self._page = 0

    def compose(self) -> ComposeResult:
        """Lay out the table and the keys."""
        yield Static(id="title", markup=False)
        yield DataTable[Text](cursor_type="row", zebra_stripes=True)
        yield Static(id="message", markup=False)
        yield Footer()

    def on_mount(self) -> None:
        """Read the first page."""
        self.query_one(DataTable).focus()
        if not self._parameters:
            self.query_one("#title", Static).update(f"{self._drive}: no parameters are known")
            self._say("name a model in the drive's options, such as model=agile; its parameters are then shown here")

    def on_resize(self, _: Resize) -> None:
        """Read the parameters that have become visible."""
        if self._parameters:
            self._show_page()

    @property
    def _rows(self) -> int:
        return max(1, self.size.height - _CHROME)

    @property
    def _pages(self) -> int:
        return -(-len(self._parameters) // self._rows)

    @property
    def _shown(self) -> list[ParameterInfo]:
        return self._parameters[self._page * self._rows : (self._page + 1) * self._rows]

    def action_page(self, step: int) -> None:
        """Turn to the next or the previous page."""
        page = max(0, min(self._page + step, self._pages - 1))
        if page != self._page:
            self._page = page
            self._show_page()

    def action_read_again(self) -> None:
        """Read the page again."""
        for info in self._shown:
            self._values.pop(info.address, None)
        if self._parameters:
            self._show_page()

    def _show_page(self) -> None:
        self._page = min(self._page, self._pages - 1)
        what = f"{self._title}, {len(self._parameters)} parameters"
        self.query_one("#title", Static).update(f"{self._drive}: {what}, page {self._page + 1} of {self._pages}")
        table = self.query_one(DataTable)
        table.clear(columns=True)
        address = max(7, *(len(info.address) for info in self._shown))
        name = max(4, *(len(info.name) for info in self._shown))
        name = min(name, max(20, self.size.width - address - 40))
        value = max(12, self.size.width - address - name - 15)
        for head, width in (("address", address), ("name", name), ("value", value), ("access", 6)):
            table.add_column(head, key=head, width=width)
        for info in self._shown:
            held = self._values.get(info.address, Text("..." if "r" in info.access else "", style=ASIDE))
            table.add_row(Text(info.address), Text(info.name), held, Text(info.access, ASIDE), key=info.address)
        self.run_worker(self._read_page(), exclusive=True)

    async def _read_page(self) -> None:
        """Read the unread parameters of this page; all other requests on the line take precedence."""
        missing = [info for info in self._shown if "r" in info.access and info.address not in self._values]
        for number, info in enumerate(missing, start=1):
            self._say(f"reading {number} of {len(missing)}")
            self._values[info.address] = value = await self._value_of(info)
            if not self.is_attached:
                # The screen and its table have been closed meanwhile.
                return
            self.query_one(DataTable).update_cell(info.address, "value", value)
        self._say("")

    async def _value_of(self, info: ParameterInfo) -> Text:
        try:
            reading = await self._watcher.drive(self._drive).polled(info.address)
        except DriveCommError as error:
            return Text(in_one_line(error), style=WARNING)
        text = Text(printable(f"{reading.value} {unit_of(reading.unit)}".rstrip()))
        return text.append(printable(f"  {reading.text}"), style=ASIDE) if reading.text else text

    def _say(self, text: str) -> None:
        self.query_one("#message", Static).update(text)


REFRESH_S = 0.5
_INDENT = 18
_STYLES = {"damaged": "red", "noise": "red", "stray": "yellow", "note": "dim", "echo": "dim"}


class TraceScreen(Screen[None]):
    """Telegrams between the master and one drive; the space key pauses the display."""

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
        """Lay out the telegrams and the keys."""
        yield Static(self._title, id="title", markup=False)
        yield RichLog(markup=False, max_lines=2000)
        yield Footer()

    def on_mount(self) -> None:
        """Start the display."""
        self.show()
        self.set_interval(REFRESH_S, self.show)
        self.query_one(RichLog).focus()

    @property
    def _title(self) -> str:
        return f"telegrams with {self._drive}{', held still' if self._held else ''}"

    def show(self) -> None:
        """Add the telegrams that arrived since the last update."""
        if self._held or not self.is_attached:
            return
        log = self.query_one(RichLog)
        for event in self._new_events():
            for line in _lines_of(event, self.size.width - _CHROME):
                log.write(Text(printable(line), style=_STYLES.get(event.what, "")))
            self._latest = event

    def _new_events(self) -> list[TraceEvent]:
        events = list(self._watcher.telegrams(self._drive))
        for place in range(len(events) - 1, -1, -1):
            if events[place] is self._latest:
                return events[place + 1 :]
        return events

    def action_hold(self) -> None:
        """Pause or resume the display."""
        self._held = not self._held
        self.query_one("#title", Static).update(self._title)
        self.show()


def _lines_of(event: TraceEvent, width: int) -> list[str]:
    """Return an event as lines that fit, without the drive's name, which the title shows."""
    return textwrap.wrap(trace_line(replace(event, drive="")), max(width, 2 * _INDENT), subsequent_indent=" " * _INDENT)


class ConfirmationScreen(ModalScreen[bool]):
    """Confirmation dialogue; every key but y means no. text: the question. remark: advice for the answer."""

    CSS = """
    Question { align: center middle; background: $background 60%; }
    Question > Vertical {
        width: 62; max-width: 95%; height: auto; border: round $warning; padding: 1 2; background: $panel;
    }
    Question .remark { color: $text-muted; margin-top: 1; }
    Question .keys { margin-top: 1; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("y", "answer(True)", "yes"),
        Binding("n,escape,q,enter", "answer(False)", "no"),
    ]

    def __init__(self, text: str, remark: str = "") -> None:
        super().__init__()
        self._text = text
        self._remark = remark

    def compose(self) -> ComposeResult:
        """Lay out the question."""
        with Vertical():
            yield Static(self._text, markup=False)
            if self._remark:
                yield Static(self._remark, classes="remark", markup=False)
            yield Static("y yes   n no", classes="keys", markup=False)

    def action_answer(self, answer: bool) -> None:
        """Close the dialogue with the answer."""
        self.dismiss(answer)
