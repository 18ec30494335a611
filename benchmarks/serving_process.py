"""Virtual drives served over pseudo-terminals, one thread per line, until standard input ends.

Usage: python serving_process.py PROTOCOL COUNT FOLDER
"""

from __future__ import annotations

import json
import sys
import threading
from pathlib import Path

from drivecomm.virtual import Server, parse_listen, virtual_drive


def main(protocol: str, count: int, folder: Path) -> None:
    """Serve drives that answer without delay."""
    stop = threading.Event()
    drives = [virtual_drive(protocol, 1, reply_delay_s=0.0) for _ in range(count)]
    servers = [Server([drive], parse_listen(f"pty:{folder / str(number)}")) for number, drive in enumerate(drives)]
    for server in servers:
        server.__enter__()
    threads = [threading.Thread(target=server.run, args=(stop,)) for server in servers]
    for thread in threads:
        thread.start()
    print(json.dumps([server.address for server in servers]), flush=True)
    sys.stdin.read()
    stop.set()
    for thread in threads:
        thread.join()
    for server in servers:
        server.__exit__(None, None, None)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), Path(sys.argv[3]))
