"""Plant file of many equal lines with equal drives, for `drivecomm simulate` and `drivecomm serve`."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence


def equal_lines(
    head: str, ports: Sequence[str] | int, *, drives: int, poll: str, line: str = "baudrate = 57600"
) -> str:
    """Return the text of the plant file.

    Line 0 has the drives d0-1, d0-2 and so on, at the addresses 1, 2 and so on. head: text before the lines. ports: the
    port of each line, or a number of lines whose drives are simulated at separate ports. poll: settings of each drive's
    polling, such as its parameters. line: settings of each line.
    """
    places = [f'port = "{port}"' for port in ports] if not isinstance(ports, int) else [_PLAYED] * ports
    parts = [f"format = 1\n{head}"]
    for number, place in enumerate(places):
        parts.append(f'[[line]]\nname = "{number}"\n{place}\n{line}')
        parts += [
            f'[[drive]]\nname = "d{number}-{address}"\ndrive = "danfoss-fc:{address}"\nline = "{number}"\n'
            f'options = {{ model = "fc302" }}\npoll = [{{ {poll} }}]'
            for address in range(1, drives + 1)
        ]
    return "\n".join(parts) + "\n"


_PLAYED = 'listen = "tcp:127.0.0.1:0"'
