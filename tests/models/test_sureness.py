"""Number of unconfirmed facts in the packaged models: counted, reported, and never allowed to grow."""

import json

from drivecomm.cli import main
from drivecomm.models import packaged_models, read_model, sureness_of_facts
from drivecomm.models.sureness import HEARSAY
from drivecomm.protocol import installed

CEILING = 197
"""Highest number of unconfirmed facts. Lower it whenever one finds its page; a new model may add none.

Nine are commands of Lenze drives, nine of Unidrive Classic, and six of EI Bisynch, which are listed to be refused.
"""


def test_number_of_unconfirmed_facts_equals_the_ceiling():
    unconfirmed = sureness_of_facts()["unconfirmed"]
    assert unconfirmed <= CEILING, "no new unconfirmed fact: find its page or its program, or leave it out"
    assert unconfirmed == CEILING, "well done: lower the ceiling to what is left"


def test_unconfirmed_facts_are_less_than_eight_per_cent():
    marks = sureness_of_facts()
    assert marks["unconfirmed"] / marks.total() < 0.08


def test_all_parameters_and_panel_settings_except_hearsay_are_counted():
    models = {
        f"{plugin.name}/{path.stem}": read_model(path, plugin.name, plugin.package)
        for plugin in installed.working()
        for path in packaged_models(plugin.package)
    }
    assert models.keys() > HEARSAY
    counted = [model for name, model in models.items() if name not in HEARSAY]
    assert sureness_of_facts().total() == sum(len(model.parameters) + len(model.setup) for model in counted)
    for name in HEARSAY:
        assert {info.sure for info in models[name].parameters.values()} > {"unconfirmed"}


def test_models_check_reports_the_number_of_unconfirmed_facts(capsys):
    assert main(["models", "check"]) == 0
    marks = sureness_of_facts()
    assert capsys.readouterr().out.splitlines()[-1] == (
        f"{marks.total()} facts of packaged models (parameters and panel settings), "
        f"{marks['unconfirmed']} of them unconfirmed "
        f"({100 * marks['unconfirmed'] / marks.total():.1f} %)"
    )
    assert main(["models", "check", "--json"]) == 0
    last = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert last["facts"] == marks.total()
    assert {mark: last[mark] for mark in marks} == marks


def test_models_check_of_one_file_reports_that_file_only(capsys):
    path = packaged_models("drivecomm_vlt3500")[0]
    assert main(["models", "check", str(path)]) == 0
    assert capsys.readouterr().out == f"{path}: in order\n"
