"""TOML files that users write: one error text for a missing file, and any byte order mark or line ending."""

from importlib import resources
from pathlib import Path

import pytest

from drivecomm.commissioning.parameter_sets import read_set
from drivecomm.errors import FileFormatError
from drivecomm.models import read_model
from drivecomm.plant import read_plant
from drivecomm.testing import load_vectors

PLANT = 'format = 1\n[[line]]\nname = "hall"\n[[drive]]\nname = "pump"\ndrive = "vabus:1"\ntitle = "Förderpumpe"\n'
MODEL = 'format = 1\nprotocol = "vabus"\nname = "own"\ntitle = "größer"\n'
VECTORS = resources.files("drivecomm_vabus").joinpath("vectors.toml").read_text(encoding="utf-8")

READERS = {
    "plant": (read_plant, PLANT),
    "model": (lambda path: read_model(path, "vabus"), MODEL),
    "vectors": (load_vectors, VECTORS),
}


@pytest.mark.parametrize("kind", [*READERS, "set"])
def test_missing_file_gives_the_same_error_for_every_kind(kind, tmp_path):
    read = read_set if kind == "set" else READERS[kind][0]
    path = tmp_path / "none.toml"
    with pytest.raises(FileFormatError) as caught:
        read(path)
    assert str(caught.value) == f"{path}: there is no such file"


@pytest.mark.parametrize("kind", READERS)
@pytest.mark.parametrize("ends", ["\n", "\r\n"])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_byte_order_mark_and_line_endings_are_accepted(kind, ends, mark, tmp_path):
    read, text = READERS[kind]
    plain, other = tmp_path / "plain.toml", tmp_path / "other.toml"
    plain.write_bytes(text.encode())
    other.write_bytes((mark + text.replace("\n", ends)).encode())
    assert _content(read(other)) == _content(read(plain))


@pytest.mark.parametrize("kind", READERS)
def test_folder_or_binary_file_is_refused(kind, tmp_path):
    read, _ = READERS[kind]
    path = tmp_path / "wrong.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FileFormatError, match="cannot be read as a"):
        read(path)
    with pytest.raises(FileFormatError, match=r"cannot be read as a .*: Is a directory"):
        read(Path(tmp_path))


def _content(found):
    return str(found).replace("other", "plain")
