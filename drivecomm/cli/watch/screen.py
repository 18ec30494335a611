"""Main screen of `drivecomm watch`: a table of the drives of a plant, and below it the selected drive."""

from __future__ import annotations

import asyncio
from functools import partial
from typing import TYPE_CHECKING, ClassVar, Literal

from rich.text import Text
from textual.app import App
from textual.binding import Binding
from textual.containers import Container, VerticalScroll
from textual.widgets import DataTable, Footer, Static

from drivecomm.bus import keep_async
from drivecomm.cli.output import sentence
from drivecomm.cli.watch.panels import PADDING, columns_for, drive_panel, events_panel
from drivecomm.cli.watch.screens import ConfirmationScreen, ParametersScreen, TraceScreen
from drivecomm.cli.watch.words import ASIDE, HOLD, clock, summary_of, why_not
from drivecomm.errors import DriveCommError, in_one_line

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from textual.app import ComposeResult
    from textual.binding import BindingType
    from textual.events import Resize
    from textual.timer import Timer

    from drivecomm.bus import AsyncDrive
    from drivecomm.cli.watch.log_switch import LogSwitch
    from drivecomm.plant.watching import Board, DriveView, Watcher

REFRESH_S = 0.5
SAID_S = 8.0
"""Time in seconds for which a message stays above the keys."""


class WatchScreen(App[Exception | None]):
    """Screen that shows a watcher's drives, and sends only commands that the user requests.

    title: name of the watched plant or port. log: the log that the key `l` switches. armed: whether --arm was given.
    duration_s: how long to poll; the screen stays. The result is the error that ended the screen, None if the user
    closed it.
    """

    ENABLE_COMMAND_PALETTE = False
    CSS = """
    #title { height: 1; background: $panel; padding: 0 1; }
    #drives { height: auto; max-height: 60%; background: $surface; }
    #below { height: 1fr; layout: vertical; border-top: solid $panel-lighten-2; }
    .-wide #below { layout: horizontal; }
    #drive { height: auto; padding: 0 1; }
    .-wide #drive { width: 5fr; height: 1fr; }
    #happened { height: 1fr; padding: 0 1; border-top: solid $panel-lighten-2; scrollbar-size: 1 1; }
    .-wide #happened { width: 3fr; border-top: none; border-left: solid $panel-lighten-2; }
    #message { height: 1; padding: 0 1; }
    """
    HORIZONTAL_BREAKPOINTS = [(0, "-narrow"), (130, "-wide")]  # noqa: RUF012 - as the library declares it
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("p", "parameters", "params"),
        Binding("t", "trace", "trace"),
        Binding("v", "next_trend", "trend"),
        Binding("l", "log", "log"),
        Binding("s", "stop", "stop?"),
        Binding("S", "stop_at_once", "stop!", key_display="S"),
        Binding("r", "reset", "reset"),
        Binding("g", "start", "start"),
        Binding("q", "quit", "quit"),
        Binding("ctrl+c", "quit", "quit", show=False, priority=True),
    ]

    def __init__(
        self, watcher: Watcher, *, title: str, log: LogSwitch, armed: bool = False, duration_s: float | None = None
    ) -> None:
        super().__init__()
        self.watcher = watcher
        self.asked_all = asyncio.Event()
        """Set when the polling time has ended."""
        self._what = title
        self._value_log = log
        log.said = self.say
        self._armed = armed
        self._duration_s = duration_s
        self._watching: asyncio.Task[None] | None = None
        self._trend = watcher.names[0]
        self._columns: tuple[object, ...] = ()
        self._saying: Timer | None = None
        self._resting = ""
        """Text above the keys while there is no message."""

    def compose(self) -> ComposeResult:
        """Lay out the table, the panels below it, and the keys."""
        yield Static(id="title", markup=False)
        yield DataTable[Text](id="drives", cursor_type="row")
        with Container(id="below"):
            yield Static(id="drive", markup=False)
            with VerticalScroll(id="happened", can_focus=False):
                yield Static(id="events", markup=False)
        yield Static(id="message", markup=False)
        yield Footer()

    def on_mount(self) -> None:
        """Start watching."""
        self._watching = asyncio.create_task(self._watch())
        self.set_interval(REFRESH_S, self.show)
        self.query_one("#drives").focus()

    async def on_unmount(self) -> None:
        """Release the lines."""
        if self._watching is not None:
            self._watching.cancel()
            await asyncio.gather(self._watching, return_exceptions=True)

    async def _watch(self) -> None:
        try:
            async with self.watcher:
                await self.watcher.run(duration_s=self._duration_s)
                self.asked_all.set()
                self._resting = f"asked for {self._duration_s:g} s; q quits" if self._duration_s else ""
                self.say("")
                # The lines stay open, because the keys still send commands.
                await asyncio.Event().wait()
        except Exception as error:  # noqa: BLE001 - the command raises it after the screen is closed
            self.exit(error)

    def on_resize(self, _: Resize) -> None:
        """Redraw the screen for its new size."""
        self.call_after_refresh(self.show)

    def show(self) -> None:
        """Redraw the screen with the present values."""
        if len(self.screen_stack) > 1 or not self.is_running:
            return
        board = self.watcher.board()
        self._show_title(summary_of(board), clock(board.elapsed_s))
        self._show_table(board)
        panel = self.query_one("#drive", Static)
        width = panel.content_size.width or self.size.width - PADDING
        # Only a panel with a fixed height, independent of its content, has room for a chart.
        height = panel.content_size.height if self.screen.has_class("-wide") else 0
        panel.update(drive_panel(self._view, self.watcher, shown=self._trend, width=width, height=height))
        self.query_one("#events", Static).update(events_panel(board))

    def _show_title(self, summary: Text, time: str) -> None:
        right = Text(f"{self._value_log.words}  {time}")
        if len(right) > self.size.width // 2:
            right = Text(f"{'logging' if self._value_log.is_on else 'log off'}  {time}")
        room = max(0, self.size.width - PADDING - len(right) - 1)
        left = Text.assemble((self._what, "bold"), "  ", summary)
        name = Text("drivecomm watch ", style=ASIDE)
        if len(name) + len(left) <= room:
            left = Text.assemble(name, left)
        left.truncate(room, overflow="ellipsis", pad=True)
        self.query_one("#title", Static).update(Text.assemble(left, " ", right))

    def _show_table(self, board: Board) -> None:
        table = self.query_one("#drives", DataTable)
        columns = columns_for(self.watcher, board, self.size.width, self._trend)
        laid_out = tuple((column.key, column.head, column.width) for column in columns)
        if laid_out != self._columns:
            self._columns = laid_out
            row = table.cursor_row
            table.clear(columns=True)
            for column in columns:
                table.add_column(column.head, width=column.width, key=column.key)
            for view in board.drives:
                table.add_row(*(column.cell(view) for column in columns), key=view.name)
            table.move_cursor(row=row)
            return
        for view in board.drives:
            for column in columns:
                table.update_cell(view.name, column.key, column.cell(view))

    @property
    def _view(self) -> DriveView:
        """Selected drive."""
        drives = self.watcher.board().drives
        return drives[min(self.screen_stack[0].query_one("#drives", DataTable).cursor_row, len(drives) - 1)]

    def say(self, text: str) -> None:
        """Show a message above the keys, for some seconds."""
        if self._saying is not None:
            self._saying.stop()
        self._saying = self.set_timer(SAID_S, partial(self.say, "")) if text else None
        # The screen with the table may be below another screen.
        table = self.screen_stack[0]
        table.query_one("#message", Static).update(text or self._resting)
        if self.screen is not table and text:
            # Other screens have no line for messages.
            self.notify(text, markup=False)

    def on_data_table_row_highlighted(self) -> None:
        """Show the drive at the cursor."""
        self.show()

    def on_data_table_row_selected(self) -> None:
        """Show the parameters of a drive on Enter."""
        self.action_parameters()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Leave the keys to the top screen; only the immediate stop works on all screens, except in a question."""
        del parameters
        if len(self.screen_stack) <= 1:
            return True
        if action == "stop_at_once":
            return not isinstance(self.screen, ConfirmationScreen)
        return action not in {"parameters", "trace", "next_trend", "log", "stop", "reset", "start"}

    def action_parameters(self) -> None:
        """Show the parameters of the drive."""
        self.push_screen(ParametersScreen(self.watcher, self._view.name))

    def action_trace(self) -> None:
        """Show the telegrams of the drive."""
        self.push_screen(TraceScreen(self.watcher, self._view.name))

    def action_next_trend(self) -> None:
        """Show the trend of the next quantity that any of the drives has."""
        views = self.watcher.board().drives
        known = [name for name in self.watcher.names if any(name in view.values for view in views)]
        if known:
            place = known.index(self._trend) + 1 if self._trend in known else 0
            self._trend = known[place % len(known)]
            self.show()

    def action_log(self) -> None:
        """Switch the log on or off."""
        try:
            self.say(self._value_log.switch())
        except DriveCommError as error:
            self.say(sentence(error))
        self.show()

    def action_stop(self) -> None:
        """Stop the motor, after a confirmation."""
        name = self._view.name
        self._ask(f"Stop {name}?", "down its ramp; S stops without this question", partial(self._stop, name))

    def action_stop_at_once(self) -> None:
        """Stop the motor immediately."""
        self._stop(self._view.name)

    def action_start(self) -> None:
        """Start the motor, if the drive is armed, after a confirmation."""
        if self._is_refused("start"):
            return
        name = self._view.name
        drive = self.watcher.drive(name)
        remark = f"with its present reference; if its line falls silent: {drive.capabilities.link_loss}"
        self._ask(f"Start {name}?", remark, lambda: self._command(name, "started", _start(drive)))

    def action_reset(self) -> None:
        """Acknowledge a fault, if the drive is armed, after a confirmation."""
        if self._is_refused("reset"):
            return
        view = self._view
        remark = f"its fault: {view.fault}" if view.fault else "it has no fault now"
        reset = self.watcher.drive(view.name).reset
        self._ask(f"Reset {view.name}?", remark, lambda: self._command(view.name, "reset", reset()))

    def _is_refused(self, verb: Literal["start", "reset"]) -> bool:
        reason = why_not(verb, self._view.drive, armed=self._armed)
        if reason:
            self.say(reason)
        return bool(reason)

    def _stop(self, name: str) -> None:
        self._command(name, "stopped", self.watcher.drive(name).stop())

    def _ask(self, question: str, remark: str, then: Callable[[], None]) -> None:
        def answered(answer: bool | None) -> None:
            if answer:
                then()
            else:
                self.say("nothing was sent")

        self.push_screen(ConfirmationScreen(question, remark), answered)

    def _command(self, name: str, done: str, command: Awaitable[None]) -> None:
        self.run_worker(self._carry_out(name, done, command), exit_on_error=False)

    async def _carry_out(self, name: str, done: str, command: Awaitable[None]) -> None:
        self.say(f"{name} ...")
        try:
            await command
        except DriveCommError as error:
            self.say(f"not {done}: {sentence(error, where=name)}")
            self.watcher.note(name, f"not {done}: {in_one_line(error)}")
        else:
            self.say(f"{name} {done}")
            self.watcher.note(name, f"{done} from here")
        self.show()


async def _start(drive: AsyncDrive) -> None:
    """Start a motor that runs on without a master. Raises StateError if the drive's watchdog would stop it."""
    async with keep_async(drive, HOLD):
        await drive.start()
