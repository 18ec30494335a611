"""The ser2net configuration of the page about serial servers, run by ser2net itself."""

import shutil
import socket
import subprocess
import time

import pytest
from console import Console, in_process
from pages import ROOT, blocks_of

PAGE = ROOT / "docs" / "how-to" / "serial-server.md"
SER2NET = shutil.which("ser2net", path="/usr/sbin:/usr/bin:/usr/local/sbin:/usr/local/bin")


@pytest.mark.soak
@pytest.mark.skipif(SER2NET is None, reason="ser2net is not installed")
def test_drive_is_read_through_the_ser2net_configuration_of_the_page(tmp_path):
    port = _free_port()
    content = next(block.code for block in blocks_of(PAGE) if block.language == "yaml")
    assert "/dev/ttyUSB0" in content
    assert "4001" in content
    configuration = tmp_path / "ser2net.yaml"
    configuration.write_text(content.replace("/dev/ttyUSB0", f"{tmp_path}/line").replace("4001", str(port)))
    with Console(in_process) as console:
        console.simulate(["simulate", "--drive", "vabus:1", "--listen", f"pty:{tmp_path}/line"])
        command = [SER2NET, "-n", "-u", "-c", str(configuration), "-P", str(tmp_path / "pid")]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as server:
            try:
                _wait_for(port)
                url = f"rfc2217://127.0.0.1:{port}"
                code, output = in_process(["read", "vabus:1", "481", "--model", "agile", "--port", url])
            finally:
                server.terminate()
    assert code == 0, output
    assert "10.00 Hz" in output


def _free_port():
    with socket.create_server(("127.0.0.1", 0)) as door:
        return door.getsockname()[1]


def _wait_for(port):
    for _ in range(100):
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.05)
    pytest.fail("ser2net does not listen")
