"""The page about tags: its files are exported and imported as the page shows."""

import tomllib

from console import Console, in_process
from pages import ROOT, blocks_of

PAGE = ROOT / "docs" / "how-to" / "tags.md"
BY_US = "a test of its own runs it beside the file"


def test_tags_are_exported_and_imported_as_on_the_page(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    blocks = list(blocks_of(PAGE))
    for block in blocks:
        if block.title:
            (tmp_path / block.title).write_text(block.code)
    with Console(in_process) as console:
        played = [block for block in blocks if BY_US in block.remark]
        assert [block.language for block in played] == ["console", "console"]
        for block in played:
            console.play(block)
    (shown,) = [block for block in blocks if block.remark == "not run: part of a file"]
    tags = tomllib.loads((tmp_path / "plant.toml").read_text())["drive"][0]["tags"]
    assert tags == tomllib.loads(shown.code)["drive"]["tags"]
