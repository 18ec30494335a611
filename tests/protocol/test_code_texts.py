"""Texts of codes, from a file beside the modules of a package."""

from pathlib import Path

from drivecomm.protocol import code_texts


def test_they_are_read_from_beside_a_module_and_once(tmp_path):
    file = tmp_path / "errors.toml"
    file.write_text('0 = "no error"\n11 = "unknown parameter"\n', encoding="utf-8")
    module = str(Path(tmp_path) / "some.py")
    assert code_texts(module, "errors.toml") == {0: "no error", 11: "unknown parameter"}
    file.unlink()
    assert code_texts(module, "errors.toml")[11] == "unknown parameter"
