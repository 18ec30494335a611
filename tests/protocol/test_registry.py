"""The registry of protocols: installed, registered and broken ones, and names claimed twice."""

import sys
from dataclasses import replace

import pytest

from drivecomm.errors import ProtocolLoadError, UnknownProtocolError
from drivecomm.protocol import Protocol, Protocols, installed, protocols


@pytest.fixture
def fresh(tmp_path, monkeypatch):
    """Yield a registry that has loaded nothing; distributions put into `tmp_path` are found by it."""
    monkeypatch.syspath_prepend(str(tmp_path))
    before = set(sys.modules)
    yield Protocols()
    for name in set(sys.modules) - before:
        if name.startswith("stranger"):
            del sys.modules[name]


def put(folder, distribution, entry, code=None):
    """Install a distribution with one entry point, as pip would: a dist-info folder and a module."""
    info = folder / f"{distribution.replace('-', '_')}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {distribution}\nVersion: 1.0\n", encoding="utf-8")
    (info / "entry_points.txt").write_text(f"[drivecomm.protocols]\n{entry}\n", encoding="utf-8")
    if code is not None:
        module = entry.partition("=")[2].partition(":")[0].strip()
        (folder / f"{module}.py").write_text(code, encoding="utf-8")


RENAMED = (
    "from dataclasses import replace\n"
    "from drivecomm.protocol.registry import installed\n"
    "protocol = replace(installed['vabus'], name='stranger')\n"
)


def test_packaged_protocols_are_installed():
    assert {"danfoss-fc", "fuji", "vabus", "vlt3500"} <= set(installed)
    assert protocols() is installed


def test_installed_protocol_is_loaded_once():
    assert isinstance(installed["vabus"], Protocol)
    assert installed["vabus"] is installed["vabus"]
    assert "vabus" in installed
    assert len(installed) == len(list(installed))


def test_no_installed_protocol_is_broken():
    assert installed.broken() == {}
    assert [plugin.name for plugin in installed.working()] == list(installed)


def test_unknown_protocol_name_is_refused_with_the_installed_names():
    with pytest.raises(UnknownProtocolError, match=r"no installed protocol is named 'profibus'; installed are .*vabus"):
        installed["profibus"]
    assert "profibus" not in installed
    assert 3 not in installed
    assert installed.get("vabus") is installed["vabus"]


def test_protocol_of_a_foreign_distribution_is_loaded(fresh, tmp_path):
    put(tmp_path, "stranger-dist", "stranger = stranger_good:protocol", RENAMED)
    assert "stranger" in fresh
    assert fresh["stranger"].name == "stranger"


def test_protocol_name_is_known_before_its_package_is_imported(fresh, tmp_path):
    put(tmp_path, "stranger-dist", "stranger = stranger_lazy:protocol", RENAMED)
    assert "stranger" in fresh
    assert "stranger_lazy" not in sys.modules
    assert fresh["stranger"]
    assert "stranger_lazy" in sys.modules


@pytest.mark.parametrize(
    ("code", "what"),
    [
        ("raise RuntimeError('out of order')", r"cannot be loaded \(RuntimeError: out of order\)"),
        ("import no_such_module_anywhere", r"cannot be loaded \(ModuleNotFoundError: No module named"),
        ("def (", r"cannot be loaded \(SyntaxError"),
        ("other = 1", r"cannot be loaded \(AttributeError"),
        (None, r"cannot be loaded \(ModuleNotFoundError"),
        ("protocol = 'vabus'", "is not a drivecomm.protocol.Protocol"),
        (RENAMED.replace("'stranger'", "'other'"), "provides a protocol named 'other'"),
    ],
)
def test_broken_plug_in_breaks_only_itself(fresh, tmp_path, code, what):
    put(tmp_path, "stranger-dist", "stranger = stranger_bad:protocol", code)
    with pytest.raises(ProtocolLoadError, match=what) as caught:
        fresh["stranger"]
    assert "'stranger'" in str(caught.value)
    assert "stranger-dist" in str(caught.value)
    assert "stranger" in fresh
    assert fresh["vabus"].name == "vabus"
    assert "stranger" not in [plugin.name for plugin in fresh.working()]
    assert "vabus" in [plugin.name for plugin in fresh.working()]
    assert set(fresh.broken()) == {"stranger"}


def test_repaired_plug_in_loads_without_a_restart(fresh, tmp_path):
    put(tmp_path, "stranger-dist", "stranger = stranger_mended:protocol", "raise RuntimeError")
    with pytest.raises(ProtocolLoadError):
        fresh["stranger"]
    (tmp_path / "stranger_mended.py").write_text(RENAMED + "# mended, and longer\n", encoding="utf-8")
    assert fresh["stranger"].name == "stranger"


def test_plug_in_that_raises_system_exit_is_broken(fresh, tmp_path):
    put(tmp_path, "stranger-dist", "stranger = stranger_exit:protocol", "raise SystemExit(3)")
    with pytest.raises(ProtocolLoadError):
        fresh["stranger"]


def test_name_claimed_by_two_distributions_is_refused(fresh, tmp_path):
    put(tmp_path, "stranger-one", "stranger = stranger_one:protocol", RENAMED)
    put(tmp_path, "stranger-two", "stranger = stranger_two:protocol", RENAMED)
    with pytest.raises(
        ProtocolLoadError, match="'stranger' is claimed by stranger-one and stranger-two; uninstall one"
    ):
        fresh["stranger"]
    assert fresh["vabus"].name == "vabus"
    assert list(fresh).count("stranger") == 1


def test_packaged_name_claimed_by_a_foreign_distribution_is_refused(fresh, tmp_path):
    put(tmp_path, "stranger-one", "vabus = stranger_vabus:protocol", RENAMED)
    with pytest.raises(ProtocolLoadError, match="'vabus' is claimed by drivecomm and stranger-one"):
        fresh["vabus"]
    assert set(fresh.broken()) == {"vabus"}


def test_distribution_found_twice_on_the_path_counts_once(fresh, tmp_path):
    # An editable installation may be found on the path and again in its own folder.
    for folder in (tmp_path / "a", tmp_path / "b"):
        folder.mkdir()
        sys.path.insert(0, str(folder))
        put(folder, "stranger-dist", "stranger = stranger_same:protocol", RENAMED)
    try:
        assert fresh["stranger"].name == "stranger"
    finally:
        del sys.path[:2]


def test_register_returns_a_function_that_removes_the_protocol():
    own = replace(installed["vabus"], name="own")
    take_away = installed.register(own)
    try:
        assert installed["own"] is own
        assert "own" in installed
        with pytest.raises(ProtocolLoadError, match="the protocol name 'own' is taken"):
            installed.register(own)
        with pytest.raises(ProtocolLoadError, match="'vabus' is taken"):
            installed.register(installed["vabus"])
    finally:
        take_away()
    assert "own" not in installed
    take_away()
    with pytest.raises(UnknownProtocolError):
        installed["own"]
