"""Entry points are read as importlib.metadata reads them."""

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
def test_the_installed_ones(group):
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
def test_whatever_a_file_says(folder, text):
    put(folder, text)
    assert sorted(entry_points(GROUP)) == by_metadata(GROUP)


def test_a_line_that_is_no_entry_point_hides_no_other(folder):
    put(folder, f"[{GROUP}]\nwithout a value\none = a:b\n")
    assert EntryPoint("one", "a:b", "The.Stranger") in entry_points(GROUP)


@pytest.mark.parametrize(
    ("name", "about"), [("stranger.egg-info", "PKG-INFO"), ("the_stranger-1.0-py3.11.egg-info", "PKG-INFO")]
)
def test_an_older_kind_of_installation(folder, name, about):
    put(folder, f"[{GROUP}]\none = a:b\n", name, about)
    assert sorted(entry_points(GROUP)) == by_metadata(GROUP)
    assert EntryPoint("one", "a:b", "The.Stranger") in entry_points(GROUP)


def test_of_two_installations_of_one_distribution_the_first_counts(folder, tmp_path_factory, monkeypatch):
    put(folder, f"[{GROUP}]\none = a:b\n")
    before = tmp_path_factory.mktemp("before")
    put(before, f"[{GROUP}]\none = c:d\n", "Stranger-2.0.dist-info")
    monkeypatch.syspath_prepend(str(before))
    assert [entry.value for entry in entry_points(GROUP) if entry.name == "one"] == ["c:d"]
    assert sorted(entry_points(GROUP)) == by_metadata(GROUP)


def test_a_folder_that_is_not_there_and_one_that_is_no_distribution(folder, monkeypatch):
    monkeypatch.syspath_prepend(str(folder / "nowhere"))
    (folder / "empty-1.0.dist-info").mkdir()
    (folder / "file.egg-info").write_text("Name: file\n", encoding="utf-8")
    assert sorted(entry_points(GROUP)) == by_metadata(GROUP)


def test_a_zip_file_on_the_path(folder, monkeypatch):
    archive = folder / "packed.zip"
    with zipfile.ZipFile(archive, "w") as packed:
        packed.writestr("stranger-1.0.dist-info/METADATA", "Metadata-Version: 2.1\nName: stranger\nVersion: 1.0\n")
        packed.writestr("stranger-1.0.dist-info/entry_points.txt", f"[{GROUP}]\none = a:b\n")
    monkeypatch.syspath_prepend(str(archive))
    assert EntryPoint("one", "a:b", "stranger") in entry_points(GROUP)


def test_what_finds_modules_elsewhere_is_asked(monkeypatch):
    class Finder(metadata.DistributionFinder):
        def find_distributions(self, context=None):
            del context
            return []

        def find_spec(self, *_):
            return None

    monkeypatch.setattr(sys, "meta_path", [*sys.meta_path, Finder()])
    assert sorted(entry_points(GROUP)) == by_metadata(GROUP)


def test_loading():
    assert EntryPoint("one", "os.path:join", "x").load() is __import__("os").path.join
    assert EntryPoint("one", "os:path.join [extra]", "x").load() is __import__("os").path.join
    assert EntryPoint("one", "os", "x").load() is __import__("os")
    with pytest.raises(AttributeError):
        EntryPoint("one", "os:nothing", "x").load()
