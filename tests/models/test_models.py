"""Reading model files: the values of a model, and the errors of a bad file."""

from dataclasses import replace
from decimal import Decimal
from pathlib import Path

import pytest

from drivecomm.errors import FileFormatError, UsageError
from drivecomm.models import CommonName, load_model, model_names, model_paths, packaged_models, parameter_at, read_model
from drivecomm.protocol import Model, installed

HEAD = 'format = 1\nprotocol = "vabus"\nname = "some"\n'
PARAMETER = '[[parameter]]\naddress = "481"\nname = "fixed_frequency"\n'


@pytest.fixture
def read(tmp_path):
    def from_text(text, name="some.toml"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return read_model(path, "vabus")

    return from_text


def test_fault_codes_are_read_in_decimal_and_hexadecimal(read):
    assert read(HEAD + '[faults]\n16 = "overload"\n0x1F = "short"\n').faults == {16: "overload", 31: "short"}


def test_model_with_every_key_is_read(read):
    model = read(
        HEAD
        + 'title = "Some"\nsource = "a page"\n[options]\nram_datasets = false\n[faults]\n5 = "overload"\n'
        + PARAMETER
        + 'title = "fixed frequency"\ntype = "long"\nunit = "Hz"\nfactor = "0.01"\naccess = "rw*"\n'
        'values = { 1 = "one" }\nminimum = "0.5"\nmaximum = 10\nstart = "2.5"\nsource = "p. 1"\nsure = "derived"\n'
        "datasets = 4\n"
    )
    assert (model.name, model.title, model.source) == ("some", "Some", "a page")
    assert model.options == {"ram_datasets": False}
    assert model.faults == {5: "overload"}
    info = model.parameters["481"]
    assert (info.type, info.unit, info.factor, info.access, info.sure) == (
        "long",
        "Hz",
        Decimal("0.01"),
        "rw*",
        "derived",
    )
    assert (info.minimum, info.maximum, info.start) == (Decimal("0.5"), Decimal(10), Decimal("2.5"))
    assert info.values == {1: "one"}
    assert info.extra == {"datasets": 4}


def test_parameter_with_only_address_and_name_gets_defaults(read):
    info = read(HEAD + PARAMETER).parameters["481"]
    assert (info.title, info.type, info.factor, info.access, info.start) == ("fixed_frequency", "", 1, "rw", None)


def test_start_value_of_a_string_parameter_stays_text(read):
    assert read(HEAD + PARAMETER + 'type = "string"\nstart = "007"').parameters["481"].start == "007"


def test_parameter_is_found_by_name_and_by_address(read):
    model = read(HEAD + PARAMETER)
    assert model.find("481") is model.find("fixed_frequency") is model.parameters["481"]
    assert model.find("fixed") is None


def test_extending_model_inherits_parameters_faults_and_options(read, tmp_path):
    (tmp_path / "base.toml").write_text(
        HEAD.replace("some", "base")
        + "[options]\nsys = 1\n[faults]\n1 = 'a'\n2 = 'b'\n"
        + PARAMETER
        + PARAMETER.replace("481", "482"),
        encoding="utf-8",
    )
    model = read(
        HEAD + 'extends = "base"\n[options]\nram_datasets = true\n[faults]\n2 = "c"\n' + PARAMETER + 'unit = "Hz"'
    )
    assert set(model.parameters) == {"481", "482"}
    assert model.parameters["481"].unit == "Hz"
    assert model.faults == {1: "a", 2: "c"}
    assert model.options == {"sys": 1, "ram_datasets": True}


WATCHDOG = "[watchdog]\ntime = '481'\nactions = { trip = 1 }\n"


@pytest.mark.parametrize(
    ("base", "own", "expected"),
    [
        (WATCHDOG, "", ("481", "")),
        (WATCHDOG, "link_loss = 'not known'\n", (None, "not known")),
        ("link_loss = 'not known'\n", "", (None, "not known")),
        ("link_loss = 'not known'\n", WATCHDOG, ("481", "")),
        ("link_loss = 'not known'\n", "link_loss = 'it trips'\n", (None, "it trips")),
    ],
)
def test_link_loss_or_watchdog_of_a_model_replaces_that_of_its_base(read, tmp_path, base, own, expected):
    timed = PARAMETER + "access = 'rw'\nunit = 's'\n"
    (tmp_path / "base.toml").write_text(HEAD.replace("some", "base") + base + timed, encoding="utf-8")
    model = read(HEAD + "extends = 'base'\n" + own)
    assert (model.watchdog and model.watchdog.time, model.link_loss) == expected


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("no toml", "cannot be read as a model"),
        ('format = 2\nprotocol = "vabus"', "begins with format = 1"),
        ('format = 1\nprotocol = "fuji"\nname = "x"', "is a model for 'fuji', not for 'vabus'"),
        ("format = 1", "is a model for None"),
        ('format = 1\nprotocol = "vabus"', "the key 'name' is missing"),
        (HEAD + "[[parameter]]\nname = 'x'", "the key 'address' is missing"),
        (HEAD + "[[parameter]]\naddress = 'x'", "the key 'name' is missing"),
        (HEAD + PARAMETER + 'factor = "much"', "some.toml"),
        (HEAD + PARAMETER + 'start = "much"', "some.toml"),
        (HEAD + PARAMETER + "values = 3", "some.toml"),
        (HEAD + PARAMETER + "values = { x = 'y' }", "some.toml"),
        (HEAD + "[faults]\nx = 'y'", "some.toml"),
        (HEAD + "faults = 3", "some.toml"),
        (HEAD + "parameter = 3", "some.toml"),
        (HEAD + "options = 3", "some.toml"),
        (HEAD + 'extends = "some"', "extends itself"),
        (HEAD + 'extends = "none"', "some.toml, line 4: extends: there is no model 'none' beside this one"),
    ],
)
def test_error_of_a_bad_file_names_the_mistake(read, text, what):
    with pytest.raises(FileFormatError) as caught:
        read(text)
    assert what in str(caught.value)


def test_models_that_extend_each_other_are_refused(read, tmp_path):
    (tmp_path / "other.toml").write_text(HEAD.replace("some", "other") + 'extends = "some"', encoding="utf-8")
    with pytest.raises(FileFormatError):
        read(HEAD + 'extends = "other"')


@pytest.mark.parametrize("line", ['access = "x"', 'sure = "perhaps"', "unit = 3", "type = 7"])
def test_invalid_value_of_a_parameter_key_is_refused(read, line):
    with pytest.raises(FileFormatError):
        read(HEAD + PARAMETER + line)


def test_load_model_takes_a_name_a_path_or_a_model(tmp_path):
    model = load_model("drivecomm_vabus", "vabus", "act")
    assert isinstance(model, Model)
    assert load_model("drivecomm_vabus", "vabus", model) is model
    path = tmp_path / "own.toml"
    path.write_text(HEAD, encoding="utf-8")
    assert load_model("drivecomm_vabus", "vabus", path).name == "some"
    assert load_model("drivecomm_vabus", "vabus", str(path)).name == "some"


def test_missing_model_is_refused_with_the_known_names():
    with pytest.raises(UsageError, match=r"vabus has no model 'none'; it has .*act.*, or name a \.toml file"):
        load_model("drivecomm_vabus", "vabus", "none")
    with pytest.raises(FileFormatError, match="there is no such file"):
        load_model("drivecomm_vabus", "vabus", Path("/nowhere/none.toml"))
    with pytest.raises(UsageError, match="it has none"):
        load_model("drivecomm.protocol.schema", "vabus", "none")


def test_package_without_models_has_no_model_names():
    assert model_names("drivecomm.protocol.schema", "vabus") == []


@pytest.mark.parametrize("plugin", list(installed.working()), ids=lambda plugin: plugin.name)
def test_every_packaged_model_can_be_read_and_uses_known_marks(plugin):
    names = model_names(plugin.package, plugin.name)
    assert plugin.default_model in names
    assert "unconfirmed" not in names, "a doubt is said of a parameter, and of no series"
    for name in names:
        model = load_model(plugin.package, plugin.name, name)
        assert model.protocol == plugin.name
        by_name = [info.name for info in model.parameters.values()]
        assert len(by_name) == len(set(by_name)), "a name means one parameter"
        assert all(info.sure in ("printed", "derived", "field", "unconfirmed") for info in model.parameters.values())
        assert all(info.access in ("r", "w", "rw", "rw*") for info in model.parameters.values())
        assert all(info.source for info in model.parameters.values() if info.sure == "printed")


def test_model_in_the_users_folder_hides_the_packaged_model(tmp_path, monkeypatch):
    monkeypatch.setenv("DRIVECOMM_MODELS", str(tmp_path))
    (tmp_path / "vabus").mkdir()
    for name in ("act", "own"):
        (tmp_path / "vabus" / f"{name}.toml").write_text(HEAD.replace("some", name), encoding="utf-8")
    paths = model_paths("drivecomm_vabus", "vabus")
    assert paths["act"] == tmp_path / "vabus" / "act.toml"
    assert paths["own"] == tmp_path / "vabus" / "own.toml"
    packaged = packaged_models("drivecomm_vabus")
    assert paths["agile"] in packaged
    assert paths["act"] not in packaged
    assert "act" in {path.stem for path in packaged}, "a hidden one is still there"


def test_factor_of_zero_is_refused_with_its_line(read):
    with pytest.raises(FileFormatError, match=r"some\.toml, line 7: factor: no value can be made from steps of 0"):
        read(HEAD + PARAMETER + 'factor = "0.00"')


def test_array_element_may_have_its_own_unit(read):
    model = read(
        HEAD + "[quantities]\nacceleration_time = '481[1]'\ndeceleration_time = '481[2]'\n" + PARAMETER
        + 'unit = "s"\n' + PARAMETER.replace("481", "481[1]").replace("fixed", "first") + 'unit = "ms"\n'
    )  # fmt: skip
    assert CommonName("acceleration_time", model).to_drive_unit(2) == 2000
    assert CommonName("deceleration_time", model).to_drive_unit(2) == 2
    assert parameter_at("481[2]", model) is model.parameters["481"]
    assert parameter_at("482", model) is None


def test_model_matches_only_if_all_identification_fields_match():
    model = replace(load_model("drivecomm_vabus", "vabus", "agile"), identified_by={"type": "A.*", "software": "5"})
    assert model.matches({"type": "ACU", "software": "5", "serial": "1"})
    assert not model.matches({"type": "ACU", "software": "50"})
    assert not model.matches({"type": "ACU"})
    assert not replace(model, identified_by={}).matches({"type": "ACU", "software": "5"})


def test_fault_log_is_inherited_or_replaced_as_a_whole(tmp_path):
    log = 'fault_log = ["481[1]", "481[2]"]\n'
    (tmp_path / "base.toml").write_text(HEAD.replace("some", "base") + log + PARAMETER)
    for name, own, expected in (("same", "", ("481[1]", "481[2]")), ("other", 'fault_log = ["481"]\n', ("481",))):
        path = tmp_path / f"{name}.toml"
        path.write_text(HEAD.replace("some", name) + 'extends = "base"\n' + own)
        assert read_model(path, "vabus").fault_log == expected
