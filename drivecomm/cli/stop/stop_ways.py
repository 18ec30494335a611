"""Ways by which a stop reaches the drives at a port, in the order of the attempts.

Servers whose plant has the port come first, then other programs of this user that have it open, then the port itself. A
program that does not respond soon, or no longer has the port, is skipped.
"""

from __future__ import annotations

import time
from contextlib import ExitStack, contextmanager, suppress
from typing import TYPE_CHECKING, Any

from drivecomm.client import holders_of_port, servers_of_port, unusable_reason
from drivecomm.errors import LinkError, PortError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from contextlib import AbstractContextManager

    from drivecomm.bus import Bus
    from drivecomm.cli.stop.safe_lookups import SafeLookups
    from drivecomm.client import Registration
    from drivecomm.protocol import Stop

# A program that releases its port for a stop closes it within this time.
_MAKES_WAY_S = 3.0
_TRY_AGAIN_S = 0.05


class StopWays:
    """Ways to the drives at one port. programs: programs that may have it, with their names of the line."""

    def __init__(self, port: str | None, spite: SafeLookups) -> None:
        self.spite = spite
        self.programs: list[tuple[Registration, str]] = []
        if not port:
            return
        if why := spite.of(unusable_reason, "", "this user's runtime folder cannot be read"):
            spite.note(f"programs that have the port cannot be found, because {why}; trying the port directly")
        found: list[tuple[Registration, str]] = []
        found += spite.of(lambda: list(servers_of_port(port)), [], "servers cannot be found")
        found += spite.of(lambda: list(holders_of_port(port)), [], "the program that has the port cannot be found")
        self.programs = [(program, line) for program, line in found if program.pid not in spite.lost]

    def stopped_by(
        self, whom: str, how: Stop, options_for: Callable[[Registration], Mapping[str, Any]]
    ) -> Registration | None:
        """Stop a drive, PROTOCOL:ADDRESS, or all of a protocol through another program.

        Returns that program, None if there is no such program. Raises the error of the drive.
        """
        for program, line in self.programs:
            # Imported late, because only a port of another program needs it.
            from drivecomm.client import place_on_line, request_stop

            try:
                request_stop(program, place_on_line(line, whom), how, options_for(program))
            except LinkError as error:
                self.spite.note(f"{error}; trying another way")
            else:
                return program
        return None

    @contextmanager
    def itself(self, *openings: Callable[[], AbstractContextManager[Bus]]) -> Iterator[Bus]:
        """Open the port directly for the time of the block, by the first opening that works.

        Waits for another of our programs that may be closing the port. An error on closing the port is only noted.
        Raises LinkError.
        """
        stack = ExitStack()
        bus = self._opened(stack, list(openings))
        try:
            yield bus
        except BaseException as error:
            # Errors raised while leaving the stack get the name of the port.
            with suppress(Exception):
                stack.__exit__(type(error), error, error.__traceback__)
            raise
        self.spite.of(stack.close, None, "closing what the stop has used")

    def _opened(self, stack: ExitStack, openings: list[Callable[[], AbstractContextManager[Bus]]]) -> Bus:
        until = time.monotonic() + (_MAKES_WAY_S if self.programs else 0.0)
        while True:
            try:
                return stack.enter_context(openings[0]())
            except PortError:
                if time.monotonic() >= until:
                    raise
                time.sleep(_TRY_AGAIN_S)
            except LinkError:
                raise
            except Exception as error:
                if len(openings) == 1:
                    raise
                self.spite.note(error)
                del openings[0]
