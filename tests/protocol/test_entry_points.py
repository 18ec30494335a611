"""Reading entry points with the same result as `importlib.metadata`."""

import sys
import zipfile
from importlib import metadata

import pytest

from drivecomm.protocol.entry_points import EntryPoint, entry_points

GROUP = "drivecomm.protocols"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


def put(folder, text, name="stranger-1.0.dist-info", about="METADATA"):
    (folder / name).mkdir()
    (folder / name / "entry_points.txt").write_text(text, encoding="utf-8")
    (folder / name / about).write_text("Metadata-Version: 2.1\nName: The.Stranger\nVersion: 1.0\n", encoding="utf-8")


def by_metadata(group):
    return sorted((entry.name, entry.value, entry.dist.name) for entry in metadata.entry_points(group=group))


@pytest.mark.parametrize("group", [GROUP, "console_scripts", "pytest11", "nobody.has.this"])
def test_installed_entry_points_are_those_of_importlib_metadata(group):
    assert sorted(entry_points(group)) == by_metadata(group)


@pytest.mark.parametrize(
    "text",
    [
        f"[{GROUP}]\none = a:b\n",
        f"[{GROUP}]\none=a:b.c\ntwo = d\n\n[other]\nthree = e:f\n",
        f"[other]\none = a:b\n[{GROUP}]\n# two = c:d\n  three = e:f [extra]  \n",
        f"[ {GROUP} ]\none = a:b\n",
        f"[other.{GROUP}]\none = a:b\n",
        f"[{GROUP}]\r\none = a:b\r\n",
        f"one = a:b\n[{GROUP}]\n",
        "",
    ],
)
def test_entry_points_file_is_parsed_as_by_importlib_metadata(folder, text):
    put(folder, text)
    assert sorted(entry_points(GROUP)) == by_metadata(GROUP)


def test_malformed_line_does_not_hide_other_entry_points(folder):
    put(folder, f"[{GROUP}]\nwithout a value\none = a:b\n")
    assert EntryPoint("one", "a:b", "The.Stranger") in entry_points(GROUP)


@pytest.mark.parametrize(
    ("name", "about"), [("stranger.egg-info", "PKG-INFO"), ("the_stranger-1.0-py3.11.egg-info", "PKG-INFO")]
)
def test_egg_info_folder_is_read(folder, name, about):
    put(folder, f"[{GROUP}]\none = a:b\n", name, about)
    assert sorted(entry_points(GROUP)) == by_metadata(GROUP)
    assert EntryPoint("one", "a:b", "The.Stranger") in entry_points(GROUP)


def test_first_of_two_installations_of_a_distribution_counts(folder, tmp_path_factory, monkeypatch):
    put(folder, f"[{GROUP}]\none = a:b\n")
    before = tmp_path_factory.mktemp("before")
    put(before, f"[{GROUP}]\none = c:d\n", "Stranger-2.0.dist-info")
    monkeypatch.syspath_prepend(str(before))
    assert [entry.value for entry in entry_points(GROUP) if entry.name == "one"] == ["c:d"]
    assert sorted(entry_points(GROUP)) == by_metadata(GROUP)


def test_missing_folder_and_empty_distribution_are_ignored(folder, monkeypatch):
    monkeypatch.syspath_prepend(str(folder / "nowhere"))
    (folder / "empty-1.0.dist-info").mkdir()
    (folder / "file.egg-info").write_text("Name: file\n", encoding="utf-8")
    assert sorted(entry_points(GROUP)) == by_metadata(GROUP)


def test_entry_points_are_found_in_a_zip_file_on_the_path(folder, monkeypatch):
    archive = folder / "packed.zip"
    with zipfile.ZipFile(archive, "w") as packed:
        packed.writestr("stranger-1.0.dist-info/METADATA", "Metadata-Version: 2.1\nName: stranger\nVersion: 1.0\n")
        packed.writestr("stranger-1.0.dist-info/entry_points.txt", f"[{GROUP}]\none = a:b\n")
    monkeypatch.syspath_prepend(str(archive))
    assert EntryPoint("one", "a:b", "stranger") in entry_points(GROUP)


def test_foreign_distribution_finder_does_not_change_the_result(monkeypatch):
    class Finder(metadata.DistributionFinder):
        def find_distributions(self, context=None):
            del context
            return []

        def find_spec(self, *_):
            return None

    monkeypatch.setattr(sys, "meta_path", [*sys.meta_path, Finder()])
    assert sorted(entry_points(GROUP)) == by_metadata(GROUP)


def test_load_imports_the_object_of_an_entry_point():
    assert EntryPoint("one", "os.path:join", "x").load() is __import__("os").path.join
    assert EntryPoint("one", "os:path.join [extra]", "x").load() is __import__("os").path.join
    assert EntryPoint("one", "os", "x").load() is __import__("os")
    with pytest.raises(AttributeError):
        EntryPoint("one", "os:nothing", "x").load()
