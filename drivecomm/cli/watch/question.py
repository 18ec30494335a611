"""A question to be answered with y or n."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from textual.binding import Binding
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.widgets import Static

if TYPE_CHECKING:
    from textual.app import ComposeResult
    from textual.binding import BindingType


class Question(ModalScreen[bool]):
    """Asks; everything but y is no. text: the question. remark: what is to be known before it is answered."""

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
        """Show the question."""
        with Vertical():
            yield Static(self._text, markup=False)
            if self._remark:
                yield Static(self._remark, classes="remark", markup=False)
            yield Static("y yes   n no", classes="keys", markup=False)

    def action_answer(self, answer: bool) -> None:
        """Close with the answer."""
        self.dismiss(answer)
