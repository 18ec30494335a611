"""The name that an adapter keeps when it is pulled out and put back.

/dev/ttyUSB0 may be another adapter after that; the links in /dev/serial/by-id, which udev makes, follow the adapter.
"""

from __future__ import annotations

from pathlib import Path

_BY_ID = Path("/dev/serial/by-id")


def stable_name(url: str, by_id: Path = _BY_ID) -> str:
    """Return the link in this folder that leads to the port; the name itself where there is none.

    A name that is a link already, and a URL, stay as they are: they were chosen.
    """
    if "://" in url:
        return url
    try:
        if Path(url).is_symlink():
            return url
        port = Path(url).resolve(strict=True)
        # A link of an adapter that has gone leads to a name that nothing has, and so to no port.
        return min((str(link) for link in by_id.iterdir() if link.resolve() == port), default=url)
    except (OSError, ValueError):
        # No such folder, or no such port.
        return url
