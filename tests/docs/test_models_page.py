"""The page about drive models: its files are checked, simulated and read, and its tables are complete."""

import re

import pytest
from console import Console, in_process
from pages import ROOT, blocks_of

from drivecomm.models import PARAMETER_KEYS, TABLES, TEXTS, check_model
from drivecomm.protocol import PanelSetting, Watchdog

PAGE = ROOT / "docs" / "reference" / "models.md"


@pytest.fixture
def files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    for block in blocks_of(PAGE):
        if block.title:
            (tmp_path / block.title).write_text(block.code, encoding="utf-8")
    return tmp_path


def test_example_model_is_valid_and_uses_every_key(files):
    path = files / "dryer.toml"
    assert check_model(path) == []
    text = path.read_text(encoding="utf-8")
    used = set(re.findall(r"^(\w+) = ", text, re.MULTILINE)) | set(re.findall(r"^\[(\w+)\]", text, re.MULTILINE))
    assert {*PARAMETER_KEYS, *TEXTS, *TABLES, *Watchdog.__dataclass_fields__} - used <= {
        "warnings",
        "kind",
        "control",
        "proofs",
    }


@pytest.mark.usefixtures("files")
def test_console_blocks_of_the_models_page_run():
    with Console(in_process) as console:
        for block in blocks_of(PAGE):
            if block.language == "console" and block.remark.startswith("not run"):
                console.play(block)


@pytest.mark.parametrize(
    "keys",
    [PARAMETER_KEYS, {*TEXTS, *(f"[{name}]" for name in TABLES)}, {"[[setup]]", *PanelSetting.__dataclass_fields__}],
    ids=["parameter", "top", "setup"],
)
def test_models_page_explains_every_key(keys):
    text = PAGE.read_text(encoding="utf-8")
    explained = set(re.findall(r"`([\[\]\w]+)`", "\n".join(re.findall(r"^\|([^|]*)\|", text, re.MULTILINE))))
    assert keys - explained == set()


def test_rules_for_common_names_match_the_registry():
    registry = (ROOT / "drivecomm" / "models" / "quantities.toml").read_text(encoding="utf-8")
    rules = re.findall(r"^# (\d\. .*)$", registry, re.MULTILINE)
    assert len(rules) == 5
    page = (ROOT / "docs" / "development" / "write-a-protocol.md").read_text(encoding="utf-8")
    assert all(rule in page for rule in rules)
