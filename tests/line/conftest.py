"""Virtual drives behind real ports, and a runtime folder per test; no test leaves processes or files behind."""

import pytest
from real_lines import example, examples, host_of, nothing_left_behind, serving

__all__ = ["example", "examples", "host_of", "nothing_left_behind", "serving"]


@pytest.fixture(autouse=True)
def _runtime_folder(tmp_path, monkeypatch):
    (tmp_path / "run").mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.delenv("RUNTIME_DIRECTORY", raising=False)
