"""Cached models: a file is read once for all drives, and again after the file or its base has changed."""

import os
from decimal import Decimal
from pathlib import Path
from types import MappingProxyType

import pytest

from drivecomm.errors import FileFormatError
from drivecomm.models import files, load_model, model_names, quantities, read_model
from drivecomm.protocol import Model, PanelSetting, ParameterInfo, Watchdog, installed

HEAD = 'format = 1\nprotocol = "vabus"\nname = "some"\n'
PARAMETER = '[[parameter]]\naddress = "481"\nname = "fixed_frequency"\nfactor = "{}"\n'
OTHER = '[[parameter]]\naddress = "482"\nname = "other_frequency"\n'

PLUGINS = list(installed.working())


@pytest.fixture
def opened(monkeypatch):
    """Return a list that collects the names of the files opened from now on."""
    names = []

    def noting(path):
        names.append(path.name)
        return open_model_file(path)

    open_model_file = files.open_model_file
    monkeypatch.setattr(files, "open_model_file", noting)
    return names


def write(path, text, *, age_s=60):
    """Write a file and date it back, as if it had not changed for a while."""
    path.write_text(text, encoding="utf-8")
    written = path.stat().st_mtime - age_s
    os.utime(path, (written, written))
    return path


def read(path, protocol="vabus"):
    return read_model(path, protocol)


def test_loaded_model_is_not_read_again(opened):
    first = load_model("drivecomm_vabus", "vabus", "act")
    del opened[:]
    assert load_model("drivecomm_vabus", "vabus", "act") is first
    assert opened == []


def test_edited_file_is_read_again(tmp_path):
    path = write(tmp_path / "some.toml", HEAD + PARAMETER.format("0.1"))
    first = read(path)
    assert read(path) is first
    write(path, HEAD + PARAMETER.format("0.2"))
    assert read(path).parameters["481"].factor == Decimal("0.2")
    assert first.parameters["481"].factor == Decimal("0.1")


def test_file_edited_with_the_same_size_and_time_is_read_again(tmp_path):
    path = write(tmp_path / "some.toml", HEAD + PARAMETER.format("0.1"))
    before = path.stat()
    read(path)
    path.write_text(HEAD + PARAMETER.format("0.2"), encoding="utf-8")
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert read(path).parameters["481"].factor == Decimal("0.2")


def test_file_written_a_moment_ago_is_not_cached(tmp_path, opened):
    path = write(tmp_path / "some.toml", HEAD, age_s=-0.001)
    os.utime(path)
    read(path)
    os.utime(path)
    read(path)
    assert opened == ["some.toml"] * 2


def test_model_is_read_again_when_its_base_changes(tmp_path):
    base = write(tmp_path / "whole.toml", HEAD.replace("some", "whole") + PARAMETER.format("0.1"))
    path = write(tmp_path / "some.toml", HEAD + 'extends = "whole"\n')
    first = read(path)
    assert read(path) is first
    write(base, HEAD.replace("some", "whole") + PARAMETER.format("0.5"))
    assert read(path).parameters["481"].factor == Decimal("0.5")


def test_base_in_the_users_folder_replaces_the_packaged_base(tmp_path, monkeypatch):
    monkeypatch.setenv("DRIVECOMM_MODELS", str(tmp_path / "own"))
    path = write(tmp_path / "some.toml", HEAD + 'extends = "family"\n')
    first = read_model(path, "vabus", "drivecomm_vabus")
    (tmp_path / "own" / "vabus").mkdir(parents=True)
    write(tmp_path / "own" / "vabus" / "family.toml", HEAD.replace("some", "family") + OTHER)
    assert list(read_model(path, "vabus", "drivecomm_vabus").parameters) == ["482"]
    assert list(first.parameters) != ["482"]


def test_removed_base_is_reported_with_the_line_of_extends(tmp_path):
    base = write(tmp_path / "whole.toml", HEAD.replace("some", "whole"))
    path = write(tmp_path / "some.toml", HEAD + 'extends = "whole"\n')
    read(path)
    base.unlink()
    with pytest.raises(FileFormatError, match=r"some\.toml, line 4: extends: there is no model 'whole'"):
        read(path)


def test_circular_extension_made_after_the_first_read_is_refused(tmp_path):
    base = write(tmp_path / "whole.toml", HEAD.replace("some", "whole"))
    path = write(tmp_path / "some.toml", HEAD + 'extends = "whole"\n')
    read(path)
    write(base, HEAD.replace("some", "whole") + 'extends = "some"\n')
    for _ in range(2):
        with pytest.raises(FileFormatError, match="extends itself, through some, whole"):
            read(path)


def test_cached_file_is_refused_for_another_protocol(tmp_path):
    path = write(tmp_path / "some.toml", HEAD)
    read(path)
    with pytest.raises(FileFormatError, match="is a model for 'vabus', not for 'fuji'"):
        read(path, "fuji")


def test_removed_file_is_reported_as_missing(tmp_path):
    path = write(tmp_path / "some.toml", HEAD)
    read(path)
    path.unlink()
    with pytest.raises(FileFormatError, match="there is no such file"):
        read(path)


def test_same_relative_path_in_another_folder_is_read_separately(tmp_path, monkeypatch):
    for folder, factor in (("a", "0.1"), ("b", "0.2")):
        (tmp_path / folder).mkdir()
        write(tmp_path / folder / "some.toml", HEAD + PARAMETER.format(factor))
        monkeypatch.chdir(tmp_path / folder)
        assert read(Path("some.toml")).parameters["481"].factor == Decimal(factor)


@pytest.mark.parametrize("plugin", PLUGINS, ids=lambda plugin: plugin.name)
def test_packaged_models_and_quantities_are_immutable(plugin):
    for name in model_names(plugin.package, plugin.name):
        must_be_unchangeable(load_model(plugin.package, plugin.name, name))
    must_be_unchangeable(quantities())


def test_all_values_of_a_read_model_are_immutable(tmp_path):
    path = write(
        tmp_path / "some.toml",
        HEAD
        + '[watchdog]\ntime = "481"\nactions = { trip = 1 }\n[options]\nlist = [{ a = [1] }]\n[faults]\n1 = "one"\n'
        + '[identified_by]\ntype = "A"\n'
        + PARAMETER.format("1")
        + 'values = { 1 = "one" }\nonly_with = { "482" = [1] }\nown = { deep = [[1], { b = 2 }] }\n'
        + OTHER,
    )
    model = read(path)
    must_be_unchangeable(model)
    assert model.parameters["481"].extra == {"own": {"deep": ((1,), {"b": 2})}}
    with pytest.raises(TypeError, match="does not support item assignment"):
        model.parameters["481"] = model.parameters["482"]


def must_be_unchangeable(value):
    if isinstance(value, MappingProxyType):
        for each in value.values():
            must_be_unchangeable(each)
    elif isinstance(value, tuple):
        for each in value:
            must_be_unchangeable(each)
    elif isinstance(value, Model | PanelSetting | ParameterInfo | Watchdog):
        for name in value.__dataclass_fields__:
            must_be_unchangeable(getattr(value, name))
    else:
        hash(value)
        assert not isinstance(value, dict | list | set)
