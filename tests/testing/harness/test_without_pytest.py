"""Lines and drives for other test frameworks: a unittest in a separate process that never loads pytest."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from drivecomm.testing import LineMaker

STRANGER = """
import sys, time, unittest
import serial
from drivecomm.testing import clock_of, serial_url
from drivecomm.virtual import VirtualLine, virtual_drive

class Test(unittest.TestCase):
    def test_ten_minutes(self):
        line = VirtualLine([virtual_drive("vabus", 1)])
        with serial.serial_for_url(serial_url(line), 19200, bytesize=7, parity="E", timeout=1) as port, clock_of(line):
            until = time.monotonic() + 600
            while time.monotonic() < until:
                port.write(b"\\x04A00481\\x05")
                self.assertEqual(len(port.read(19)), 19)
                time.sleep(10)
        self.assertGreater(line.time, 600)
        self.assertNotIn("pytest", sys.modules)
"""


def test_foreign_unittest_uses_a_line_by_its_url(tmp_path):
    (tmp_path / "test_stranger.py").write_text(STRANGER, encoding="utf-8")
    command = [sys.executable, "-m", "unittest", "test_stranger"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert "Ran 1 test" in done.stderr


@pytest.mark.skipif(os.name != "posix", reason="a pseudo-terminal")
def test_line_maker_works_without_a_test_folder():
    with LineMaker() as lines:
        port = Path(lines.drive("vabus:1", listen="pty").port)
        assert port.exists()
    assert not port.parent.exists()
