"""The page about vector files: its example is valid, and its tables have every key that the reader knows."""

from dataclasses import fields

import pytest
from console import in_process
from pages import ROOT, blocks_of

from drivecomm.testing import CATEGORIES, Refuse, Stream, Vector

PAGE = ROOT / "docs" / "development" / "vectors.md"
TEXT = PAGE.read_text(encoding="utf-8")


def test_example_vector_file_passes_every_check(tmp_path):
    content = next(block.code for block in blocks_of(PAGE) if block.language == "toml")
    path = tmp_path / "example.toml"
    path.write_text(content, encoding="utf-8")
    code, output = in_process(["vectors", "check", str(path)])
    assert code == 0, output


@pytest.mark.parametrize("kind", [Vector, Stream, Refuse], ids=lambda kind: kind.__name__.lower())
def test_vectors_page_explains_every_key(kind):
    section = TEXT.partition(f"## `[[{kind.__name__.lower()}]]`")[2].partition("\n## ")[0]
    for field in fields(kind):
        key = {"data": "hex"}.get(field.name, field.name)
        assert f"`{key}`" in section, key


def test_vectors_page_names_every_category():
    assert all(f"`{category}`" in TEXT for category in CATEGORIES)
