"""TLS to a broker: accepted with the authority that signed its certificate, refused with any other."""

import asyncio
import gc
import shutil
import subprocess

import pytest
from mosquitto import mosquitto, needs_mosquitto

from drivecomm.errors import PortError
from drivecomm.server.broker import BROKER_KEYS, BrokerMessage, broker_settings
from drivecomm.server.broker.connection import connect_to_broker
from drivecomm.tomlfile import TomlTable

pytestmark = [
    needs_mosquitto,
    pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl, which makes the certificates, is missing"),
]


def certificate(folder, name):
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", "2",
         "-keyout", f"{name}.key", "-out", f"{name}.pem", "-subj", "/CN=localhost",
         "-addext", "subjectAltName=DNS:localhost"],
        cwd=folder, check=True, capture_output=True, timeout=60,
    )  # fmt: skip


async def publish(broker, **said):
    table = TomlTable({"broker": f"mqtts://localhost:{broker.port}", **said}, "x.toml")
    async with connect_to_broker(broker_settings(table, table.take(BROKER_KEYS)), "client", print) as connection:
        await connection.publish(BrokerMessage(topic="a", payload="1"))


# The library leaves a socket after a failed handshake to the garbage collector, which then warns.
@pytest.mark.soak
@pytest.mark.filterwarnings("ignore:.*unclosed <ssl.SSLSocket:pytest.PytestUnraisableExceptionWarning")
@pytest.mark.filterwarnings("ignore:unclosed <ssl.SSLSocket:ResourceWarning")
def test_broker_certificate_is_checked_against_its_authority(tmp_path):
    folder = tmp_path / "broker"
    folder.mkdir()
    for name in ("broker", "stranger"):
        certificate(folder, name)
    lines = [f"certfile {folder / 'broker.pem'}", f"keyfile {folder / 'broker.key'}"]
    with mosquitto(folder, *lines) as broker:
        asyncio.run(publish(broker, authority=str(folder / "broker.pem")))
        for said in ({"authority": str(folder / "stranger.pem")}, {}):
            with pytest.raises(PortError, match=r"cannot be reached.*certificate verify failed"):
                asyncio.run(publish(broker, **said))
        gc.collect()
