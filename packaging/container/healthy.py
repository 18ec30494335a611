"""Health check of the servers in this container: exit code 0 if all servers are healthy, else 1.

Each server has a socket in $RUNTIME_DIRECTORY, which carries HTTP.
"""

import os
import socket
import sys
from http.client import HTTPException, HTTPResponse
from pathlib import Path


def is_well(server: Path) -> bool:
    """Return whether the server behind a socket answers /healthz with 200."""
    with socket.socket(socket.AF_UNIX) as asked:
        asked.settimeout(3)
        try:
            asked.connect(str(server))
            asked.sendall(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")
            response = HTTPResponse(asked)
            response.begin()
        except (OSError, HTTPException):
            return False
        return response.status == 200


servers = list(Path(os.environ.get("RUNTIME_DIRECTORY", "/run/drivecomm")).glob("*.sock"))
sys.exit(0 if servers and all(is_well(server) for server in servers) else 1)
