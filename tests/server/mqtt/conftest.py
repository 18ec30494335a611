"""The doors' state folder, separate for each test."""

import pytest


@pytest.fixture(autouse=True)
def own_state(tmp_path, monkeypatch):
    folder = tmp_path / "state of doors"
    folder.mkdir(exist_ok=True)
    monkeypatch.setenv("STATE_DIRECTORY", str(folder))
