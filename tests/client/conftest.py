"""Runtime folders of a test's own."""

import pytest


@pytest.fixture(autouse=True)
def runtime_folder(tmp_path, monkeypatch):
    """Let servers and their clients meet in a folder of this test."""
    (tmp_path / "run").mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    monkeypatch.delenv("RUNTIME_DIRECTORY", raising=False)
    return tmp_path / "run" / "drivecomm"
