"""The console script. It first imports nothing but the standard library, so that Ctrl-C always prints one sentence."""

import os
import sys


def main() -> int:
    """Run the command line and return its exit code."""
    try:
        import signal

        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) != signal.SIG_IGN:
                signal.signal(number, _go_on if sys.argv[1:2] == ["stop"] else _end)
    except KeyboardInterrupt:
        _end(2, None)
    from drivecomm.cli import main as run

    return run()


def _end(number: int, _: object) -> None:
    # No exception here: it may get lost while modules are imported.
    try:
        os.write(2, b"drivecomm: interrupted\n")
    finally:
        os._exit(128 + number)


def _go_on(number: int, _: object) -> None:
    """Ignore the signal, so that a stop is completed."""
