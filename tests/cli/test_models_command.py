"""The models commands: list, show, check, names."""

import json

import pytest

from drivecomm.cli import main
from drivecomm.models import packaged_models, quantities

OWN = 'format = 1\nprotocol = "fuji"\nname = "dryer"\ntitle = "our dryer"\nsource = "a page"\nextends = "frenic"\n'


@pytest.fixture
def models(capsys):
    def run(*arguments):
        code = main(["models", *arguments])
        output = capsys.readouterr()
        return code, output.out, output.err

    return run


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("DRIVECOMM_MODELS", str(tmp_path))
    (tmp_path / "fuji").mkdir()
    return tmp_path / "fuji"


def objects(output):
    return [json.loads(line) for line in output.splitlines()]


def test_models_list_shows_all_models(models):
    code, out, _ = models("list")
    assert code == 0
    names = {line.split()[0] for line in out.splitlines()}
    assert {"vabus/act", "danfoss-fc/fc102", "vlt3500/vlt2000", "fuji/vg"} <= names


def test_models_list_of_a_protocol_shows_the_origin(models, folder):
    (folder / "dryer.toml").write_text(OWN, encoding="utf-8")
    (folder / "vg.toml").write_text(OWN.replace("dryer", "vg"), encoding="utf-8")
    code, out, _ = models("list", "fuji", "--json")
    found = {each["model"]: each for each in objects(out)}
    assert code == 0
    assert set(found) == {"dryer", "e11s", "family", "frenic", "g11s", "vg"}
    assert found["e11s"]["origin"] == "drivecomm_fuji"
    assert found["dryer"]["origin"] == str(folder / "dryer.toml")
    assert (found["vg"]["title"], found["vg"]["origin"]) == ("our vg", str(folder / "vg.toml"))
    assert found["dryer"]["parameters"] == found["frenic"]["parameters"] > 70
    _, out, _ = models("list", "fuji")
    assert any(line.split()[0] == "fuji/dryer" and line.endswith("dryer.toml") for line in out.splitlines())


def test_broken_model_file_does_not_hide_other_models(models, folder):
    (folder / "dryer.toml").write_text("format = 2", encoding="utf-8")
    code, out, err = models("list", "fuji")
    assert code == 2
    assert len(out.splitlines()) == 5
    assert err == f"drivecomm: {folder / 'dryer.toml'}, line 1: format: a model begins with format = 1\n"


def test_models_list_refuses_an_unknown_protocol(models):
    code, out, err = models("list", "profibus")
    assert (code, out) == (2, "")
    assert err.startswith("drivecomm: no installed protocol is named 'profibus'")


def test_models_show_prints_a_model(models):
    code, out, _ = models("show", "fuji/vg")
    assert code == 0
    assert out.startswith("fuji/vg  FRENIC-VG\n")
    assert "watchdog  time H38, action H32 (trip 0, hold 3), printed; 0 is a forced stop" in out
    assert "options   profile=vg" in out
    assert "texts     28 faults" in out
    lines = {line.split()[0]: line for line in out.splitlines()[7:]}
    assert lines["M09"].split()[1:6] == ["output_frequency", "Hz", "0.00", "to", "400.00"]
    assert "latest_alarm [fault_code]" in lines["M16"], "the common name, where the maker's is another"
    assert lines["H38"].split()[1:7] == ["silence_time", "[link_timeout]", "s", "0.0", "to", "60.0"]


def test_models_show_prints_that_no_watchdog_is_documented(models):
    _, out, _ = models("show", "vlt3500/vlt2000")
    head = out.partition("\n\n")[0].splitlines()
    assert not [line for line in head if line.split()[0] == "watchdog"]
    assert "no watchdog is documented in our sources" in " ".join(head)


def test_models_show_finds_a_model_by_each_of_its_names(models):
    _, wanted, _ = models("show", "fuji/vg")
    assert models("show", "vg") == (0, wanted, "")
    assert models("show", "vg", "--protocol", "fuji") == (0, wanted, "")
    [path] = [path for path in packaged_models("drivecomm_fuji") if path.stem == "vg"]
    assert models("show", str(path)) == (0, wanted, "")


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (["nothing"], "no protocol has a model 'nothing'; drivecomm models list shows them, or name a .toml file"),
        (["family"], "'family' is the name of several models: write fuji/family and vabus/family"),
        (["vabus/nothing"], "vabus has no model 'nothing'; it has "),
        (["vabus/act", "--protocol", "fuji"], "vabus/act is a model of vabus, and --protocol says fuji"),
        (["profibus/x"], "no installed protocol is named 'profibus'"),
        (["none.toml"], "none.toml: there is no such file"),
    ],
)
def test_models_show_refuses_unknown_and_ambiguous_names(models, arguments, what):
    code, out, err = models("show", *arguments)
    assert (code, out) == (2, "")
    assert err.startswith(f"drivecomm: {what}")
    assert err.count("\n") == 1


def test_models_show_refuses_a_file_without_a_protocol(models, tmp_path):
    path = tmp_path / "own.toml"
    path.write_text("format = 1", encoding="utf-8")
    code, _, err = models("show", str(path))
    assert code == 2
    assert err == f"drivecomm: {path} does not say which protocol it is for; name one with --protocol\n"


def test_models_show_prints_all_facts_of_named_parameters(models):
    code, out, _ = models("show", "fuji/vg", "link_timeout", "H32", "S02", "initialise")
    assert code == 0
    shown = dict(zip(("H38", "H32", "S02", "H03"), out.split("\n\n"), strict=True))
    assert all(text.startswith(f"{address}  ") for address, text in shown.items())
    assert "  source       FRENIC-VG option manual 5-11\n" in shown["H38"]
    assert "common name  link_timeout\n" in shown["H38"]
    assert "values   0 forced stop, 1 run for the timer, then stop, 2 stop only" in shown["H32"]
    assert "factor" not in shown["S02"]
    _, out, _ = models("show", "vlt3500/vlt2000", "502[1]", "--json")
    [found] = objects(out)
    assert (found["parameter"]["address"], found["parameter"]["unit"]) == ("502[1]", "Hz")
    _, out, _ = models("show", "vlt3500/vlt2000", "502[1]")
    assert "  note         unit not stated; Hz as in 201 and 202\n" in out
    code, out, err = models("show", "fuji/vg", "F03", "nothing")
    assert (code, out) == (2, "")
    assert err == "drivecomm: model vg has no parameter 'nothing'; drivecomm models show lists them\n"


def test_quantities_flag_lists_the_common_names_of_a_model(models):
    code, out, _ = models("show", "vlt2000", "--quantities")
    assert code == 0
    rows = {line.split()[0]: line.split()[1:] for line in out.splitlines()}
    assert rows["output_frequency"] == ["Hz", "502[1]", "output", "frequency", "field"]
    assert set(rows) <= set(quantities())


def test_models_show_prints_json(models):
    _, out, _ = models("show", "fuji/frenic", "--json")
    head, *parameters = objects(out)
    assert (head["model"], head["options"]) == ("frenic", {"profile": "frenic", "least_turnaround_s": 0.0})
    assert head["watchdog"]["actions"] == {"trip": 0, "hold": 3}
    assert head["quantities"]["link_timeout"] == "y08"
    ramp = next(each["parameter"] for each in parameters if each["parameter"]["address"] == "F07")
    assert (ramp["unit"], ramp["storage"], ramp["sure"]) == ("s", "stored", "derived")
    assert ramp["source"] == "AF-300 Ethernet manual p. 35 (G11S)"
    _, out, _ = models("show", "fuji/frenic", "--quantities", "--json")
    assert len(objects(out)) == 1


def test_models_show_prints_a_watchdog_with_a_single_action(models, tmp_path):
    path = tmp_path / "own.toml"
    path.write_text(
        OWN + '[watchdog]\ntime = "y08"\nactions = { coast = 0 }\n'
        '[warnings]\n1 = "hot"\n[identified_by]\n"type code" = "1.*"\n'
        '[[parameter]]\naddress = "F90"\nname = "least"\nminimum = "1"\n'
        '[[parameter]]\naddress = "F91"\nname = "most"\nmaximum = "9"\n',
        encoding="utf-8",
    )
    code, out, _ = models("show", str(path))
    assert code == 0
    assert "time y08, always coast, printed\n" in out
    assert "41 faults, 1 warning\n" in out
    assert "type code = 1.*" in out
    lines = {line.split()[0]: line.split() for line in out.splitlines() if line.strip()}
    assert lines["F90"] == ["F90", "least", "1", "rw", "printed", "least"]
    assert lines["F91"] == ["F91", "most", "to", "9", "rw", "printed", "most"]


def test_models_check_lists_all_findings(models, tmp_path):
    good, bad = tmp_path / "good.toml", tmp_path / "bad.toml"
    good.write_text(OWN, encoding="utf-8")
    bad.write_text(OWN + "colour = 1\n[options]\nprofil = 'vg'\n", encoding="utf-8")
    assert models("check", str(good)) == (0, f"{good}: in order\n", "")
    code, out, err = models("check", str(good), str(bad))
    assert (code, err) == (2, "")
    first, second, third = out.splitlines()
    assert first == f"{good}: in order"
    assert second.startswith(f"{bad}, line 7: colour: unknown key 'colour'; the keys are ")
    assert third == f"{bad}, line 9: profil: fuji drives have no such option; did you mean 'profile'?"


def test_models_check_prints_json(models, tmp_path):
    path = tmp_path / "own.toml"
    path.write_text(OWN + "[options]\nprofil = 'vg'\n", encoding="utf-8")
    code, out, err = models("check", str(path), "--json")
    assert (code, err) == (2, "")
    text = "fuji drives have no such option; did you mean 'profile'?"
    assert objects(out) == [
        {"file": str(path), "line": 8, "key": "profil", "text": text},
        {"file": str(path), "findings": 1},
    ]


def test_models_check_without_a_file_checks_all_models(models, folder):
    path = folder / "vg.toml"
    path.write_text(OWN + "colour = 1\n", encoding="utf-8")
    code, out, _ = models("check", "--json")
    assert code == 2
    counts = {each["file"]: each["findings"] for each in objects(out) if "findings" in each}
    assert counts[str(path)] == 1
    packaged = packaged_models("drivecomm_fuji") + packaged_models("drivecomm_vlt3500")
    assert [counts[str(path)] for path in packaged] == [0] * len(packaged)


def test_models_names_lists_the_common_names(models):
    code, out, _ = models("names")
    assert code == 0
    assert [line.split()[0] for line in out.splitlines()] == list(quantities())
    _, out, _ = models("names", "--json")
    assert objects(out)[0] == {
        "name": "output_frequency",
        "unit": "Hz",
        "meaning": "frequency of the voltage at the drive's output",
    }


GAUGE = 'format = 1\nprotocol = "modbus"\nname = "gauge"\ntitle = "Gauge drives"\nsource = "a page"\n'
GAUGE += '[control.status]\nrunning = ["1", 1, 1]\n[[parameter]]\naddress = "1"\nname = "state"\naccess = "r"\n'


def test_model_without_orders_is_shown_as_monitoring_only(models, folder):
    own = folder.parent / "modbus"
    own.mkdir()
    (own / "gauge.toml").write_text(GAUGE, encoding="utf-8")
    _, out, _ = models("list", "modbus")
    (line,) = [each for each in out.splitlines() if each.startswith("modbus/gauge")]
    assert "1 parameters, monitoring only" in line
    _, out, _ = models("list", "modbus", "--json")
    found = {each["model"]: each["monitoring_only"] for each in objects(out)}
    assert found["gauge"] is True
    assert found["danfoss-fc"] is False
    _, out, _ = models("show", "gauge")
    assert "monitoring only: it is read, and neither commanded nor stopped" in out
    _, out, _ = models("show", "gauge", "--json")
    assert objects(out)[0]["monitoring_only"] is True
    _, out, _ = models("show", "vabus/act")
    assert "monitoring only" not in out


def test_required_panel_settings_of_a_model_are_shown(models):
    _, out, _ = models("show", "schneider-atv")
    (line,) = [each for each in out.splitlines() if each.startswith("  keypad ")]
    assert "19200 8E1" in line
    assert "8413 Fr1 reference channel = 164 Modbus" in line
    _, out, _ = models("show", "modbus/schneider-atv", "--json")
    assert objects(out)[0]["needs"] == {"8413": [164]}
    _, out, _ = models("show", "vabus/act")
    assert any(each.split() == ["keypad", "19200", "7E1"] for each in out.splitlines())
