"""Damaged files: the importer names the error or makes a valid model."""

import random

import pytest
from imported_files import CASES, FILES

from drivecomm.commissioning.importing import drives_of, imported_model, read_foreign
from drivecomm.errors import DriveCommError
from drivecomm.models import check_model, model_text

PUT_IN = (
    b"-1",
    b"null",
    b"[]",
    b"{}",
    b"true",
    b"9" * 30,
    b"0x",
    b",",
    b";",
    b'"',
    b"1e99",
    b".5",
    b"nan",
    b"\xc2\xb2",
)


def damaged(data, chance):
    """Return data with up to three places cut, changed or repeated."""
    for _ in range(chance.randint(1, 3)):
        at = chance.randrange(len(data))
        data = chance.choice(
            (
                data[:at] + bytes([chance.randrange(256)]) + data[at + 1 :],
                data[:at] + data[at + chance.randint(1, 20) :],
                data[:at] + chance.choice(PUT_IN) + data[at:],
                data[:at] + data[max(0, at - 40) : at] + data[at:],
            )
        )
    return data


@pytest.mark.parametrize("name", CASES)
def test_damaged_file_is_refused_or_makes_a_valid_model(name, tmp_path):
    chance = random.Random(name)
    path, model = tmp_path / name, tmp_path / "model.toml"
    for _ in range(8):
        path.write_bytes(damaged((FILES / name).read_bytes(), chance))
        try:
            found = read_foreign(path)
            drives = drives_of(found)
            made = imported_model(found, name="model", file=name, drive=drives[0] if drives else None)
        except DriveCommError:
            continue
        model.write_text(model_text(made), encoding="utf-8")
        assert check_model(model) == []


@pytest.mark.parametrize(
    ("name", "text", "left"),
    [
        ("a.conf", '[[inputs.modbus]]\ncoils = [5, {name = "x", address = [1]}]\n', "not an entry with keys"),
        ("b.conf", '[[inputs.modbus]]\nbaud_rate = 8\ncoils = [{name = "x", address = [1]}]\n', "not a line setting"),
        ("c.csv", f"Address;Name;Factor\n1;a;{'9' * 40}\n2;b;1\n", "not an exact factor"),
        ("d.txt", f"$464={'9' * 5000}\n$462=5\n", "the register with the speed is not given"),
        ("e.json", '{"device": {"channels": [7, {"reg_type": "coil", "address": 1}]}}', "not an entry with keys"),
    ],
)
def test_impossible_values_are_listed_as_left_out(tmp_path, name, text, left):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    assert any(left in each.reason for each in read_foreign(path).left)
