"""Stops by the model of another series: sent immediately, and the mismatch is found and reported afterwards."""

from drivecomm.virtual import virtual_drive


def test_stop_by_the_model_of_another_series_is_reported(shell):
    line = shell.line(virtual_drive("modbus", 1, model="invt"))
    sent = []
    line.monitors.append(lambda piece: sent.append(piece.data) if piece.sender is None else None)
    assert shell("stop", "modbus:1,model=delta") == 5
    assert shell.out == "modbus:1  stop (ramp) commanded\n"
    assert "modbus:1 was sent the stop of model delta, and is not a drive of that model" in shell.err
    assert "look whether its motor stands" in shell.err
    assert sent[0][1] == 6, "the stop goes out before anything is asked"


def test_stop_all_reports_a_drive_of_another_series(shell, tmp_path):
    shell.line(virtual_drive("modbus", 1, model="invt"), name="hall")
    plant = tmp_path / "plant.toml"
    plant.write_text(
        'format = 1\n[[line]]\nname = "hall"\nport = "hall"\n'
        '[[drive]]\nname = "fan"\ndrive = "modbus:1"\nline = "hall"\noptions = { model = "delta" }\n'
    )
    assert shell("stop", "--all", "--plant", str(plant), port=None) == 5
    assert "is not a drive of that model" in shell.err


def test_stop_by_the_right_model_prints_no_warning(shell):
    shell.line(virtual_drive("modbus", 1, model="invt"))
    assert shell("stop", "modbus:1,model=invt") == 0
    assert (shell.out, shell.err) == ("modbus:1  stop (ramp) commanded\n", "")
