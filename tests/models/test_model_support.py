"""Sources and entries of its own that a packaged model needs, and the exceptions, which may only become fewer."""

from dataclasses import replace

import pytest

from drivecomm.models import check_model, packaged_models, read_model, support
from drivecomm.models.files import base_of, open_model_file
from drivecomm.protocol import installed

FILES = {
    f"{plugin.name}/{path.stem}": (plugin, path)
    for plugin in installed.working()
    for path in packaged_models(plugin.package)
}


def lacking(plugin, path):
    file = open_model_file(path)
    model = read_model(path, plugin.name, plugin.package)
    return {
        (each.kind, each.name)
        for each in support.lacks(file.content, model, base_of(file, plugin.name, plugin.package))
    }


def test_each_exception_names_a_packaged_model_and_a_reason():
    assert support.exceptions().keys() <= FILES.keys()
    for name, allowed in support.exceptions().items():
        assert len(allowed["reason"].split()) >= 5, name
        assert allowed.keys() <= {"reason", *support.KINDS}, name


@pytest.mark.parametrize("name", sorted(support.exceptions()))
def test_listed_exception_is_still_needed(name):
    allowed = support.exceptions()[name]
    listed = {(kind, each) for kind in support.KINDS for each in allowed.get(kind, ())}
    assert listed - lacking(*FILES[name]) == set(), "take these out of drivecomm/models/exceptions.toml"


@pytest.mark.parametrize("name", sorted(FILES))
def test_packaged_model_has_no_findings_beyond_its_exceptions(name):
    plugin, path = FILES[name]
    assert [str(each) for each in check_model(path, plugin)] == []


def test_number_of_exceptions_does_not_grow():
    each = [one for allowed in support.exceptions().values() for kind in support.KINDS for one in allowed.get(kind, ())]
    assert len(each) <= 28, "no new exception: leave the command or the common name out of a new model"


HEAD = 'format = 1\nprotocol = "modbus"\nname = "mill"\nsource = "manual p. 1"\n'
STATUS = '[[parameter]]\naddress = "3"\nname = "state"\ntype = "u16"\n'
ORDERS = '[control]\nstart = [["1", 1]]\nstop = [["1", 0]]\n[control.status]\nrunning = ["3", 1, 1]\n'
SOURCES = '[sources]\ncommands = ["manual p. 1", "program x"]\nstatus = ["manual p. 2", "program x"]\n'


def findings(text, folder, monkeypatch, name="mill"):
    """Check a file as if it were a packaged model."""
    path = folder / f"{name}.toml"
    path.write_text(text, encoding="utf-8")
    monkeypatch.setattr("drivecomm.models.check.packaged_models", lambda _: [path])
    return [str(each).partition(": ")[2] for each in check_model(path)]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (HEAD + ORDERS + SOURCES + STATUS, []),
        (HEAD + ORDERS + STATUS, ["commands = [...] under [sources]", "status = [...] under [sources]"]),
        (HEAD + ORDERS + SOURCES.replace(', "program x"', "", 1) + STATUS, ["commands = [...] under [sources]"]),
        (HEAD + ORDERS + SOURCES.replace("program x", "manual p. 1") + STATUS, ["commands = [...] under [sources]"]),
        (HEAD + ORDERS + SOURCES + STATUS + 'sure = "unconfirmed"\n', ["a command or the status rests on 3"]),
        (
            HEAD + '[quantities]\noutput_frequency = "7"\n' + STATUS.replace('"3"', '"7"') + 'unit = "Hz"\n'
            'sure = "unconfirmed"\n',
            ["output_frequency: rests on parameter 7, which is unconfirmed"],
        ),
    ],
    ids=["all there", "no sources", "one source", "one source twice", "unconfirmed status", "unconfirmed name"],
)
def test_packaged_model_is_refused_without_support(text, says, tmp_path, monkeypatch):
    found = findings(text, tmp_path, monkeypatch)
    assert len(found) == len(says)
    assert all(any(each in one for one in found) for each in says), found


def test_packaged_model_may_not_inherit_its_stop_and_plain_write(tmp_path, monkeypatch):
    base = HEAD.replace('"mill"', '"old"') + ORDERS.replace("start =", 'plain_write = "stored"\nstart =') + STATUS
    (tmp_path / "old.toml").write_text(base, encoding="utf-8")
    head = HEAD + 'extends = "old"\n'
    found = findings(head + SOURCES, tmp_path, monkeypatch)
    assert [each.split("inherits ")[1].split(";")[0] for each in found] == ["stop from old", "plain_write from old"]
    own = '[control]\nstop = [["1", 0]]\nplain_write = "volatile"\n'
    assert findings(head + own + SOURCES, tmp_path, monkeypatch) == []


def test_file_of_a_user_needs_no_second_source(tmp_path):
    path = tmp_path / "mill.toml"
    path.write_text(HEAD + ORDERS + STATUS, encoding="utf-8")
    assert check_model(path) == []


def test_inherited_watchdog_is_a_finding():
    plugin, path = FILES["danfoss-fc/fc300"]
    base = read_model(path, plugin.name, plugin.package)
    found = support.lacks({}, replace(base, name="x", quantities={}), base)
    assert [(each.kind, each.name) for each in found if each.kind == "taken_over"] == [("taken_over", "watchdog")]


def test_inherited_watchdog_is_no_finding_if_the_model_states_its_link_loss():
    plugin, path = FILES["danfoss-fc/fc300"]
    base = read_model(path, plugin.name, plugin.package)
    content = {"link_loss": "nothing"}
    assert [each for each in support.lacks(content, replace(base, name="x"), base) if each.name == "watchdog"] == []
