"""Texts of codes, read from a file in the folder of a module."""

from pathlib import Path

from drivecomm.protocol import code_texts


def test_code_texts_are_read_once_from_the_folder_of_a_module(tmp_path):
    file = tmp_path / "errors.toml"
    file.write_text('0 = "no error"\n11 = "unknown parameter"\n', encoding="utf-8")
    module = str(Path(tmp_path) / "some.py")
    assert code_texts(module, "errors.toml") == {0: "no error", 11: "unknown parameter"}
    file.unlink()
    assert code_texts(module, "errors.toml")[11] == "unknown parameter"
