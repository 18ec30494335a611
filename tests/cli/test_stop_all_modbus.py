"""stop --all on lines with Modbus drives: what stops one series can start another, and is told to all only if alike."""

import pytest

from drivecomm.protocol import one_stop_fits_all
from drivecomm.virtual import virtual_drive

LINE = '[[line]]\nname = "hall"\nport = "hall"\n'


@pytest.fixture
def hall(shell, tmp_path):
    """Let drives of some series stand on a line; gives the plant file, the line and the drives."""

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


def test_a_delta_is_stopped_without_starting_an_invt_beside_it(shell, hall):
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


def test_drives_of_one_series_are_told_all_at_once(shell, hall):
    path, line, drives = hall("delta", "delta")
    for number in (1, 2):
        assert shell("start", f"modbus:{number},model=delta", "--link-loss", "hold", port="hall") == 0
    assert shell("stop", "--all", "--plant", str(path), port=None) == 0
    assert "hall: modbus:*  stop (ramp) sent to all" in shell.out
    line.advance(60)
    for drive in drives:
        drive.follow(line.time)
        assert not drive.motor.running


def test_without_a_plant_it_says_how_modbus_drives_are_stopped(shell, hall):
    _, _, _ = hall("delta")
    assert shell("stop", "--all", port="hall") == 5
    assert "modbus: not stopped, because that needs the models of its drives" in shell.out
    assert "drivecomm stop modbus:ADDRESS,model=MODEL --port hall" in shell.out


def test_one_stop_fits_all_of_a_protocol_only_if_their_models_are_alike():
    assert one_stop_fits_all("vabus", [{"model": "act"}, {"model": "agile"}])
    assert not one_stop_fits_all("modbus", [{"model": "delta"}, {}])
