"""What a door may say of its broker, and what is refused with a sentence."""

import os
import subprocess
import sys

import pytest

from drivecomm.errors import FileFormatError, UsageError
from drivecomm.server.broker import BROKER_KEYS, broker_settings
from drivecomm.server.mqtt import mqtt_door
from drivecomm.tomlfile import Table, read_toml


def settings(tmp_path, text, environment=None):
    file = tmp_path / "plant.toml"
    file.write_text(text)
    table = read_toml(file, "a plant")
    return broker_settings(table, table.take(BROKER_KEYS), environment or {})


def test_without_a_word_it_is_the_broker_of_this_machine(tmp_path):
    found = settings(tmp_path, "")
    assert (found.host, found.port, found.tls, found.version) == ("127.0.0.1", 1883, False, "5")
    assert found.password is None


@pytest.mark.parametrize(
    ("url", "host", "port", "tls"),
    [
        ("mqtt://localhost", "localhost", 1883, False),
        ("mqtt://[::1]:1884", "::1", 1884, False),
        ("mqtts://broker.example.com", "broker.example.com", 8883, True),
        ("mqtts://broker.example.com:443/", "broker.example.com", 443, True),
    ],
)
def test_addresses(tmp_path, url, host, port, tls):
    found = settings(tmp_path, f'broker = "{url}"')
    assert (found.host, found.port, found.tls) == (host, port, tls)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ('broker = "tcp://127.0.0.1"', "broker cannot be 'tcp://127.0.0.1'"),
        ('broker = "127.0.0.1:1883"', "broker cannot be"),
        ('broker = "mqtt://127.0.0.1:70000"', "broker cannot be"),
        ('broker = "mqtt://127.0.0.1:0"', "broker cannot be"),
        ('broker = "mqtt://me:word@127.0.0.1"', "apart from it"),
        ('broker = "mqtt://192.0.2.7"', "spell out insecure = true"),
        ('broker = "mqtt://broker.example.com"', "spell out insecure = true"),
        ('user = "hall"\npassword = "letmein"', "does not belong into a plant file"),
        ('password_file = "word"', "write user ="),
        ('user = "hall"\npassword = "@a"\npassword_file = "b"', "leave one of them out"),
        ('authority = "ca.pem"', "for brokers with TLS"),
        ('broker = "mqtts://b"\ncertificate = "a.pem"', "write both certificate = and key ="),
        ('version = "4"', "version cannot be '4'"),
        ("keep_alive_s = 1", "invalid keep_alive_s = 1"),
    ],
)
def test_what_cannot_be_is_refused_with_its_line(tmp_path, text, sentence):
    with pytest.raises(FileFormatError, match=r"plant\.toml, line") as refused:
        settings(tmp_path, text)
    assert sentence in str(refused.value)
    assert "letmein" not in str(refused.value)
    assert "word@" not in str(refused.value)


def test_an_unencrypted_broker_elsewhere_has_to_be_spelt_out(tmp_path):
    assert settings(tmp_path, 'broker = "mqtt://192.0.2.7"\ninsecure = true').host == "192.0.2.7"


def test_a_password_comes_from_a_file_that_only_its_owner_reads(tmp_path):
    word = tmp_path / "word"
    word.write_text("open sesame\n")
    word.chmod(0o600)
    found = settings(tmp_path, 'user = "hall"\npassword_file = "word"')
    assert found.password() == "open sesame"
    assert "sesame" not in repr(found)
    word.write_text("")
    with pytest.raises(UsageError, match="there is no password in it"):
        found.password()
    word.unlink()
    with pytest.raises(UsageError, match="cannot be read"):
        found.password()


@pytest.mark.skipif(os.name != "posix", reason="modes of files are POSIX's")
def test_a_password_that_others_can_read_is_refused(tmp_path):
    word = tmp_path / "word"
    word.write_text("open sesame\n")
    word.chmod(0o644)
    with pytest.raises(UsageError, match="others can read"):
        settings(tmp_path, 'user = "hall"\npassword_file = "word"').password()


def test_a_password_comes_from_the_service_manager_or_the_environment(tmp_path):
    text = 'user = "hall"\npassword = "@hall-2"'
    (tmp_path / "hall-2").write_text("from a file\n")
    assert settings(tmp_path, text, {"CREDENTIALS_DIRECTORY": str(tmp_path)}).password() == "from a file"
    assert settings(tmp_path, text, {"DRIVECOMM_BROKER_HALL_2": "from there"}).password() == "from there"
    with pytest.raises(UsageError, match="DRIVECOMM_BROKER_HALL_2"):
        settings(tmp_path, text).password()


@pytest.mark.soak
def test_nothing_of_it_is_loaded_by_a_server_without_such_a_door():
    look = "import sys; import drivecomm.server.serving; print([each for each in sys.modules if 'mqtt' in each])"
    found = subprocess.run([sys.executable, "-c", look], capture_output=True, text=True, check=True, timeout=60)
    assert found.stdout.strip() == "[]"


def test_a_door_without_its_packages_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "aiomqtt", None)
    with pytest.raises(UsageError, match=r"pip install \"drivecomm\[mqtt\]\""):
        mqtt_door(Table({}, "plant.toml"))
