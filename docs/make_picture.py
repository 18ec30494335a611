"""Make pictures/demo.svg: what `drivecomm demo` prints in a terminal, from its beginning.

Run it again when the demo changes: `python docs/make_picture.py`. It runs in virtual time, so that the same program
gives the same picture.
"""

from __future__ import annotations

import io
import os
import re
import subprocess
import sys
from pathlib import Path

from rich._export_format import CONSOLE_SVG_FORMAT
from rich.console import Console
from rich.text import Text

PICTURE = Path(__file__).parent / "pictures" / "demo.svg"
LONGEST = 66
# The heading with which the part of the demo begins that is left out, if it comes before so many lines.
END = "Refusals"
# The picture must not load a font from elsewhere.
FORMAT = re.sub(r"@font-face \{\{.*?\}\}\s*", "", CONSOLE_SVG_FORMAT, flags=re.DOTALL)


def picture() -> str:
    """Run the demo, keep its first lines with their colours, and return them drawn, as SVG."""
    environment = {**os.environ, "FORCE_COLOR": "1", "COLORTERM": "truecolor", "TERM": "xterm-256color"}
    command = [sys.executable, "-m", "drivecomm", "demo"]
    shown = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)  # noqa: S603
    lines = Text.from_ansi(f"$ drivecomm demo\n{shown.stdout}").split("\n")
    for line in lines:
        line.rstrip()
    end = next((place for place, line in enumerate(lines) if line.plain.startswith(END)), LONGEST)
    console = Console(record=True, width=112, file=io.StringIO())
    for line in lines[: min(end, LONGEST)]:
        console.print(line)
    console.print("...")
    return console.export_svg(title="drivecomm demo", code_format=FORMAT)


def main() -> None:
    """Draw the picture."""
    PICTURE.write_text(picture(), encoding="utf-8")


if __name__ == "__main__":
    main()
