"""Metrics for Prometheus: names and units by its rules, no stale values, and no reads on the line."""

import json
import shutil
import subprocess
import time
import urllib.request
from dataclasses import replace

import pytest
from fake_plant import Client, FakePlant, reading, served, value
from prometheus_client.openmetrics.parser import text_string_to_metric_families

from drivecomm.models import quantities
from drivecomm.server import CurrentValue, DriveDrift, SetChange
from drivecomm.server.http import HttpDoor
from drivecomm.server.http.metrics import names
from drivecomm.tomlfile import TomlTable

PROMTOOL, PROMETHEUS = shutil.which("promtool"), shutil.which("prometheus")


def samples(text):
    """Return the value of each sample, by its name with labels."""
    lines = [line for line in text.decode().splitlines() if line and line[0] != "#"]
    return {line.rpartition(" ")[0]: float(line.rpartition(" ")[2]) for line in lines}


def scraped(client):
    answer = client.get("/metrics")
    assert answer.status == 200
    return samples(answer.content)


def test_metrics_use_base_units(local, plant):
    plant.change(
        value("pump", "output_frequency", "49.98", "Hz"),
        value("pump", "torque_percent", "80", "%"),
        value("pump", "heat_sink_temperature", "41.5", "degC"),
        value("pump", "operating_hours", "2", "h"),
        value("pump", "output_power", "1.5", "kW"),
        value("pump", "switching_frequency", "4", "kHz"),
    )
    found = scraped(local)
    labels = '{drive="pump",line="main"}'
    assert found[f"drivecomm_output_frequency_hertz{labels}"] == 49.98
    assert found[f"drivecomm_torque_ratio{labels}"] == pytest.approx(0.8)
    assert found[f"drivecomm_heat_sink_temperature_celsius{labels}"] == 41.5
    assert found[f"drivecomm_operating_seconds_total{labels}"] == 7200
    assert found[f"drivecomm_output_power_watts{labels}"] == 1500
    assert found[f"drivecomm_switching_frequency_hertz{labels}"] == 4000


@pytest.mark.parametrize("quality", ["stale", "bad"])
def test_metrics_omit_stale_and_bad_values(local, plant, quality):
    plant.change(value("pump", quality=quality))
    found = scraped(local)
    assert 'drivecomm_output_frequency_hertz{drive="pump",line="main"}' not in found
    assert 'drivecomm_output_frequency_hertz{drive="fan",line="main"}' in found


def test_metrics_omit_expired_values(local, plant):
    old = reading(time_s=time.time() - 60)
    plant.change(
        CurrentValue(time_s=1.0, drive="pump", name="output_frequency", reading=old, quality="good", keeps_s=3.0)
    )
    assert 'drivecomm_output_frequency_hertz{drive="pump",line="main"}' not in scraped(local)


def test_metrics_omit_a_value_in_an_unexpected_unit(local, plant):
    plant.change(value("pump", "output_frequency", "1200", "rpm"))
    assert 'drivecomm_output_frequency_hertz{drive="pump",line="main"}' not in scraped(local)


def test_metrics_label_the_quality_of_every_value(local, plant):
    old = reading(time_s=time.time() - 60)
    plant.change(
        value("fan"),
        value("fan", "output_current", quality="bad"),
        CurrentValue(time_s=1.0, drive="pump", name="output_frequency", reading=old, quality="good", keeps_s=3.0),
    )
    found = {name for name, number in scraped(local).items() if name.startswith("drivecomm_sample_quality") and number}
    assert {
        'drivecomm_sample_quality{drive="fan",line="main",name="output_frequency",quality="good"}',
        'drivecomm_sample_quality{drive="fan",line="main",name="output_current",quality="bad"}',
        'drivecomm_sample_quality{drive="pump",line="main",name="output_frequency",quality="stale"}',
    } <= found


def test_metrics_label_the_model_note_of_a_good_value(local, plant):
    plant.change(value("fan", note="type and unit are derived"), value("pump"))
    found = scraped(local)
    notes = [name for name in found if name.startswith("drivecomm_sample_info")]
    note = 'name="output_frequency",note="type and unit are derived"'
    assert notes == [f'drivecomm_sample_info{{drive="fan",line="main",{note}}}']
    assert found['drivecomm_sample_quality{drive="fan",line="main",name="output_frequency",quality="good"}'] == 1


def test_metrics_show_the_read_time_of_a_value(local, plant):
    then = round(time.time() - 1, 3)
    plant.change(value("pump", time_s=then))
    found = scraped(local)
    assert found['drivecomm_sample_timestamp_seconds{drive="pump",line="main",name="output_frequency"}'] == then


def test_metrics_show_reachability_and_state_of_drives(local, plant):
    plant.states["fan"] = replace(plant.states["fan"], reachability="silent", status=None)
    found = scraped(local)
    assert found['drivecomm_drive_up{drive="pump",line="main"}'] == 1
    assert found['drivecomm_drive_up{drive="fan",line="main"}'] == 0
    state = 'drivecomm_drive_state{drive="pump",drivecomm_drive_state="%s",line="main"}'
    assert found[state % "running"] == 1
    assert found[state % "fault"] == 0
    assert not any(name.startswith('drivecomm_drive_state{drive="fan"') for name in found)
    assert found['drivecomm_framing_errors_total{drive="pump",line="main"}'] == 1
    info = next(name for name in found if name.startswith("drivecomm_drive_info{") and '"pump"' in name)
    assert 'protocol="vabus"' in info
    assert 'address="1"' in info


def test_metrics_count_changed_parameters_of_compared_drives_only(local, plant):
    change = SetChange(address="420", name="", unit="s", approved=5, now=7, since_s=60.0)
    drift = DriveDrift(state="replaced", changes=(change,), replaced="its serial number is another")
    plant.states["pump"] = replace(plant.states["pump"], drift=drift)
    found = scraped(local)
    assert found['drivecomm_drive_changed_parameters{drive="pump",line="main"}'] == 1
    assert found['drivecomm_drive_replaced{drive="pump",line="main"}'] == 1
    assert 'drivecomm_drive_changed_parameters{drive="fan",line="main"}' not in found


def test_metrics_show_lines_and_server(local):
    found = scraped(local)
    assert found['drivecomm_line_up{line="main",port="/dev/ttyUSB0"}'] == 1
    assert found['drivecomm_line_missed_polls_total{line="main"}'] == 2
    assert found["drivecomm_alarms"] == 1
    assert found["drivecomm_server_start_time_seconds"] == 1_700_000_000
    assert found['drivecomm_door_streams{door="local"}'] == 0


def test_metrics_of_a_door_omit_figures_it_does_not_have(local):
    found = scraped(local)
    assert found['drivecomm_door_up{door="http 127.0.0.1:8080"}'] == 1
    assert found['drivecomm_door_clients{door="http 127.0.0.1:8080"}'] == 3
    assert found['drivecomm_door_up{door="mqtt broker:8883"}'] == 0
    assert found['drivecomm_door_backlog_rows{door="mqtt broker:8883"}'] == 120
    assert not {'drivecomm_door_clients{door="mqtt broker:8883"}'} & set(found)


def test_parameter_without_a_common_name_is_a_labelled_metric(local, plant):
    plant.change(value("pump", "480", "7", "x"))
    assert scraped(local)['drivecomm_parameter{drive="pump",line="main",parameter="480",unit="x"}'] == 7


def test_metrics_support_the_openmetrics_format(local):
    answer = local.get("/metrics", Accept="application/openmetrics-text; version=1.0.0")
    assert answer.headers["Content-Type"].startswith("application/openmetrics-text")
    assert answer.content.endswith(b"# EOF\n")


def test_strict_parser_reads_metrics_with_their_types(local, plant):
    plant.change(*(value("pump", name, "1", quantity.unit) for name, quantity in quantities().items()))
    answer = local.get("/metrics", Accept="application/openmetrics-text; version=1.0.0")
    families = {family.name: family for family in text_string_to_metric_families(answer.content.decode())}
    assert families["drivecomm_door_clients"].type == "gauge"
    assert families["drivecomm_line_late_statuses"].type == "counter"
    seen = [(sample.name, *sorted(sample.labels.items())) for each in families.values() for sample in each.samples]
    assert len(seen) == len(set(seen))


def test_every_common_name_has_its_own_metric(local, plant):
    plant.change(*(value("pump", name, "1", quantity.unit) for name, quantity in quantities().items()))
    found = scraped(local)
    metrics = [f"{each.metric}{'_total' if each.counts else ''}" for each in names().values()]
    assert len(set(metrics)) == len(metrics) == len(quantities()) - 3
    assert all(f'{metric}{{drive="pump",line="main"}}' in found for metric in metrics)


@pytest.mark.skipif(not PROMTOOL, reason="promtool is not installed")
def test_promtool_accepts_the_metrics(local, plant):
    plant.change(*(value("pump", name, "1", quantity.unit) for name, quantity in quantities().items()))
    text = local.get("/metrics").content
    found = subprocess.run([PROMTOOL, "check", "metrics"], input=text, capture_output=True, check=False)
    assert (found.returncode, found.stdout, found.stderr) == (0, b"", b"")


@pytest.mark.soak
@pytest.mark.skipif(not PROMETHEUS, reason="prometheus is not installed")
def test_real_prometheus_scrapes_500_drives(tmp_path):
    polled = ("output_frequency", "output_current", "dc_link_voltage", "heat_sink_temperature")
    plant = FakePlant([f"drive-{number}" for number in range(500)], polled=polled)
    for key in plant.current:
        plant.current[key] = replace(value(*key, unit=quantities()[key[1]].unit), keeps_s=600.0)
    door = HttpDoor(TomlTable({"kind": "http", "listen": "127.0.0.1:0"}, "hall.toml"))
    with served(door, plant):
        assert len([name for name in scraped(Client(door)) if "_hertz{" in name]) == 500
        assert _found_by_prometheus(tmp_path, door.port) == {"500"}


def _found_by_prometheus(folder, port):
    settings = {
        "global": {"scrape_interval": "1s", "scrape_timeout": "1s"},
        "scrape_configs": [{"job_name": "plant", "static_configs": [{"targets": [f"127.0.0.1:{port}"]}]}],
    }
    (folder / "prometheus.yml").write_text(json.dumps(settings))
    own = _free_port()
    command = [
        PROMETHEUS, f"--config.file={folder / 'prometheus.yml'}", f"--storage.tsdb.path={folder / 'data'}",
        f"--web.listen-address=127.0.0.1:{own}", "--log.level=error",
    ]  # fmt: skip
    running = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        until = time.monotonic() + 60
        while time.monotonic() < until:
            time.sleep(0.5)
            try:
                query = f"http://127.0.0.1:{own}/api/v1/query?query=count(drivecomm_output_current_amperes)"
                with urllib.request.urlopen(query, timeout=5) as answer:
                    result = json.load(answer)["data"]["result"]
            except OSError:
                continue
            if result:
                return {each["value"][1] for each in result}
        return set()
    finally:
        running.kill()
        running.wait()


def _free_port():
    import socket

    with socket.create_server(("127.0.0.1", 0)) as found:
        return found.getsockname()[1]
