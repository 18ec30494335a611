"""An edge node on a real broker, graded by a listener: each scenario, and all assertions that they exercise."""

import asyncio

import pytest
from mosquitto import mosquitto, needs_mosquitto
from sparkplug_grader import CHECKS, Report, graded
from sparkplug_scenarios import ALONE, SHOWN, two_brokers

pytestmark = needs_mosquitto


def played(tmp_path, scenario):
    with mosquitto(tmp_path / "broker") as broker:
        report = graded(asyncio.run(scenario(tmp_path, broker)))
    for name in SHOWN.get(scenario.__name__, ()):
        report.held[f"tck-id-{name}"] += 1
    assert not report.wrong, report.wrong[:10]
    return report


def played_with_two(tmp_path):
    with mosquitto(tmp_path / "broker") as broker, mosquitto(tmp_path / "other") as other:
        report = graded(asyncio.run(two_brokers(tmp_path, broker, other)))
    for name in SHOWN["two_brokers"]:
        report.held[f"tck-id-{name}"] += 1
    assert not report.wrong, report.wrong[:10]
    return report


@pytest.mark.soak
def test_start_values_and_shutdown_satisfy_the_assertions(tmp_path):
    report = played(tmp_path, ALONE[0])
    assert len(report.passed) > 90


@pytest.mark.soak
def test_all_observable_assertions_for_edge_nodes_hold(tmp_path, record_property):
    total = Report()
    for scenario in ALONE:
        folder = tmp_path / scenario.__name__
        folder.mkdir()
        total.add(played(folder, scenario))
    folder = tmp_path / "two_brokers"
    folder.mkdir()
    total.add(played_with_two(folder))
    known = {*CHECKS, *(f"tck-id-{name}" for names in SHOWN.values() for name in names)}
    # An assertion passes only if a scenario exercised it.
    assert total.passed == known
    record_property("assertions", len(known))
    assert len(known) == 162
