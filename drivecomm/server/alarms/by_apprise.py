"""A process that delivers one message by apprise: reads {"url": ..., "message": ...} from standard input.

Without a message it only checks the URL. The reason for a failure is the last line of standard error.
"""

from __future__ import annotations

import json
import logging
import sys


def main() -> int:
    """Deliver the message; return the exit status."""
    given = json.load(sys.stdin)
    try:
        import apprise
    except ImportError:
        return _failed("apprise is not installed; install drivecomm[server]")
    said: list[str] = []
    handler = logging.Handler(logging.WARNING)
    handler.emit = lambda record: said.append(record.getMessage())  # type: ignore[method-assign]
    logging.getLogger("apprise").addHandler(handler)
    service = apprise.Apprise.instantiate(given["url"])
    if service is None:
        # The log output of apprise contains the URL, which may hold a secret.
        return _failed("apprise does not support its URL; see https://github.com/caronc/apprise/wiki")
    message = given["message"]
    if message and not service.notify(title=message["title"], body=message["text"]):
        return _failed(f"apprise could not deliver it: {'; '.join(said) or 'it gave no reason'}")
    return 0


def _failed(why: str) -> int:
    sys.stderr.write(" ".join(why.split()) + "\n")
    return 1


if __name__ == "__main__":
    raise SystemExit(main())
