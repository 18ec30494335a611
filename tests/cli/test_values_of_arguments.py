"""Numbers, references and choices as arguments: read as intended, or refused with a helpful sentence."""

import socket

import pytest
from serving_threads import served_in_thread

from drivecomm.plant import read_plant
from drivecomm.virtual import PlantServer, VirtualPlant


@pytest.mark.parametrize("number", ["1_0", "\N{ARABIC-INDIC DIGIT ONE}", "1\N{FULLWIDTH DIGIT TWO}"])
def test_number_that_only_python_accepts_is_refused(shell, number):
    line = shell.line()
    sent = []
    line.monitors.append(sent.append)
    for words in (["write", "vabus:1", "481", number, "-m", "agile"], ["reference", "vabus:1", f"{number}%"]):
        assert shell(*words) == 2
        assert f"'{number}' for parameter" in shell.err
        assert "is not a number" in shell.err
    for words in (["read", "vabus:1", "481", "--timeout", number], ["read", "vabus:1", "481", "--attempts", number]):
        assert shell(*words) == 2
        assert f" '{number}'; write a" in shell.err
    assert shell("read", f"vabus:1,baudrate={number}", "481") == 2
    assert shell("scan", "-a", f"1-{number}") == 2
    assert not sent


@pytest.mark.parametrize(
    ("value", "sentence"),
    [
        ("10Hx", "'10Hx' is not a reference in %, Hz or rpm; write 10%, 10Hz or 10rpm"),
        ("-10.5", "'-10.5' is not a reference in %, Hz or rpm; write -10.5%, -10.5Hz or -10.5rpm"),
        ("fast", "'fast' is not a reference; write a number and its unit, such as 50%, 25Hz or 1450rpm"),
        ("nanHz", "'nan' for parameter reference is not a number"),
    ],
)
def test_invalid_reference_is_refused(shell, value, sentence):
    shell.line()
    assert shell("reference", "vabus:1", value) == 2
    assert sentence in shell.err


def test_unknown_choice_is_refused(shell):
    assert shell("decode", "04", "--direction", "rep", port=None) == 2
    assert shell.err.startswith("drivecomm: invalid --direction / -d 'rep'; write request or reply")


@pytest.mark.parametrize("bits", ["0", "-5", "x", "1.5"])
def test_invalid_and_too_small_numbers_are_refused_alike(shell, bits):
    assert shell("cohabit", "-d", "vabus:1", "-d", "vabus:2", "--bits", bits, port=None) == 2
    assert shell.err.startswith(f"drivecomm: invalid --bits '{bits}'; write a whole number, 1 or more (see ")


def test_negative_value_is_not_taken_for_an_option(shell, plant_server):
    assert shell("plant", "set", "pump", "481", "-5", "--control", plant_server, port=None) == 0
    assert shell.out == "pump 481 is FFFFFFFB\n"


@pytest.fixture
def plant_server(tmp_path):
    """Serve a virtual plant in a thread; yield the address of its control socket."""
    file = tmp_path / "plant.toml"
    line = '[[line]]\nname = "hall"\nlisten = "tcp:127.0.0.1:0"\n'
    file.write_text(f'format = 1\n{line}[[drive]]\nname = "pump"\ndrive = "vabus:1"\n', encoding="utf-8")
    with served_in_thread(PlantServer(VirtualPlant(read_plant(file)), control="127.0.0.1:0")) as server:
        yield str(server.control)


def test_simulate_refuses_a_network_port_in_use(shell):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        place = f"127.0.0.1:{taken.getsockname()[1]}"
        assert shell("simulate", "-d", "vabus:1", "-l", f"tcp:{place}", port=None) == 3
    assert shell.err == (
        f"drivecomm: cannot listen at {place} (Address already in use); choose another port number, or 0 for any free "
        "one, and an address of this machine\n"
    )


def test_plant_file_in_another_encoding_is_refused(shell, tmp_path):
    file = tmp_path / "plant.toml"
    file.write_bytes('format = 1\n# Pumpe für Wasser\n[[line]]\nname = "hall"\n'.encode("latin-1"))
    assert shell("status", "--plant", str(file), port=None) == 2
    assert shell.err == (
        f"drivecomm: {file}, line 2: cannot be read as a plant: it is not in UTF-8; save the file in UTF-8\n"
    )
