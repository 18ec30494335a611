"""stop --all on Modbus lines: broadcast only if all drives are of one series, because it may start another series."""

import pytest

from drivecomm.protocol import one_stop_fits_all
from drivecomm.virtual import virtual_drive

LINE = '[[line]]\nname = "hall"\nport = "hall"\n'


@pytest.fixture
def hall(shell, tmp_path):
    """Return a function that puts drives of the named series on a line; it returns plant file, line and drives."""

    def stand(*series):
        drives = [virtual_drive("modbus", number, model=name) for number, name in enumerate(series, 1)]
        line = shell.line(*drives, name="hall")
        path = tmp_path / "plant.toml"
        path.write_text(
            f"format = 1\n{LINE}"
            + "".join(
                f'[[drive]]\nname = "{name}-{number}"\ndrive = "modbus:{number}"\nline = "hall"\n'
                f'options = {{ model = "{name}" }}\n'
                for number, name in enumerate(series, 1)
            )
        )
        return path, line, drives

    return stand


def test_stop_of_a_delta_does_not_start_an_invt_on_its_line(shell, hall):
    path, line, (delta, invt) = hall("delta", "invt")
    invt.poke("0x2001", 5000)
    assert shell("start", "modbus:1,model=delta", "--link-loss", "hold", port="hall") == 0
    line.advance(5)
    ever = []
    line.monitors.append(lambda _: ever.append(invt.motor.running))
    assert shell("stop", "--all", "--plant", str(path), port=None) == 0
    assert sorted(shell.out.splitlines()) == [
        "hall: delta-1  stop (ramp) confirmed",
        "hall: invt-2  stop (ramp) confirmed",
    ]
    line.advance(60)
    delta.follow(line.time)
    assert not delta.motor.running
    assert True not in ever


def test_drives_of_one_series_are_stopped_by_a_broadcast(shell, hall):
    path, line, drives = hall("delta", "delta")
    for number in (1, 2):
        assert shell("start", f"modbus:{number},model=delta", "--link-loss", "hold", port="hall") == 0
    assert shell("stop", "--all", "--plant", str(path), port=None) == 0
    assert "hall: modbus:*  stop (ramp) sent to all" in shell.out
    line.advance(60)
    for drive in drives:
        drive.follow(line.time)
        assert not drive.motor.running


def test_stop_all_without_a_plant_explains_how_to_stop_modbus_drives(shell, hall):
    _, _, _ = hall("delta")
    assert shell("stop", "--all", port="hall") == 5
    assert "modbus: not stopped, because that needs the models of its drives" in shell.out
    assert "drivecomm stop modbus:ADDRESS,model=MODEL --port hall" in shell.out


def test_one_stop_fits_all_drives_only_if_their_models_are_alike():
    assert one_stop_fits_all("vabus", [{"model": "act"}, {"model": "agile"}])
    assert not one_stop_fits_all("modbus", [{"model": "delta"}, {}])
