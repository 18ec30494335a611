"""All parameters that a drive's model knows, read page by page as they are looked at."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from rich.text import Text
from textual.binding import Binding
from textual.screen import Screen
from textual.widgets import DataTable, Footer, Static

from drivecomm.cli.watch.words import ASIDE, WARNING, unit_of
from drivecomm.errors import DriveCommError

if TYPE_CHECKING:
    from textual.app import ComposeResult
    from textual.binding import BindingType
    from textual.events import Resize

    from drivecomm.plant.watching import Watcher
    from drivecomm.protocol import ParameterInfo

_CHROME = 4
"""Lines that hold no parameter: title, heads, message, keys."""


class ParametersScreen(Screen[None]):
    """Shows the parameters of one drive; nothing is read that is not on the screen, and nothing is written."""

    CSS = """
    ParametersScreen #title { height: 1; background: $panel; padding: 0 1; text-style: bold; }
    ParametersScreen DataTable { height: 1fr; background: $surface; }
    ParametersScreen #message { height: 1; padding: 0 1; color: $text-muted; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,p,q", "app.pop_screen", "back", key_display="esc"),
        Binding("n,pagedown", "page(1)", "next page", key_display="n"),
        Binding("b,pageup", "page(-1)", "page before", key_display="b"),
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
        """Show a table and the keys."""
        yield Static(id="title", markup=False)
        table: DataTable[Text] = DataTable(cursor_type="row", zebra_stripes=True)
        yield table
        yield Static(id="message", markup=False)
        yield Footer()

    def on_mount(self) -> None:
        """Read the first page."""
        self.query_one(DataTable).focus()
        if not self._parameters:
            self.query_one("#title", Static).update(f"{self._drive}: no parameters are known")
            self._say("name a model in the drive's options, such as model=agile; its parameters are then shown here")

    def on_resize(self, _: Resize) -> None:
        """Read what has come into sight."""
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
        """Go a page on or back."""
        page = max(0, min(self._page + step, self._pages - 1))
        if page != self._page:
            self._page = page
            self._show_page()

    def action_read_again(self) -> None:
        """Read the page once more."""
        for info in self._shown:
            self._values.pop(info.address, None)
        if self._parameters:
            self._show_page()

    def _show_page(self) -> None:
        self._page = min(self._page, self._pages - 1)
        title = (
            f"{self._drive}: {self._title}, {len(self._parameters)} parameters, page {self._page + 1} of {self._pages}"
        )
        self.query_one("#title", Static).update(title)
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
        """Read what is on this page and has not been read; everything else on the line goes first."""
        missing = [info for info in self._shown if "r" in info.access and info.address not in self._values]
        for number, info in enumerate(missing, start=1):
            self._say(f"reading {number} of {len(missing)}")
            self._values[info.address] = value = await self._value_of(info)
            self.query_one(DataTable).update_cell(info.address, "value", value)
        self._say("")

    async def _value_of(self, info: ParameterInfo) -> Text:
        try:
            reading = await self._watcher.drive(self._drive).polled(info.address)
        except DriveCommError as error:
            return Text(" ".join(str(error).split()), style=WARNING)
        text = Text(f"{reading.value} {unit_of(reading.unit)}".rstrip())
        return text.append(f"  {reading.text}", style=ASIDE) if reading.text else text

    def _say(self, text: str) -> None:
        self.query_one("#message", Static).update(text)
