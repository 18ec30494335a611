"""Broker settings of a door, and the errors for invalid ones."""

import os
import subprocess
import sys

import pytest

from drivecomm.errors import FileFormatError, UsageError
from drivecomm.server.broker import BROKER_KEYS, broker_settings
from drivecomm.server.mqtt import mqtt_door
from drivecomm.tomlfile import TomlTable, read_toml


def settings(tmp_path, text, environment=None):
    file = tmp_path / "plant.toml"
    file.write_text(text)
    table = read_toml(file, "a plant")
    return broker_settings(table, table.take(BROKER_KEYS), environment or {})


def test_default_broker_is_on_this_machine(tmp_path):
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
def test_broker_url_gives_host_port_and_tls(tmp_path, url, host, port, tls):
    found = settings(tmp_path, f'broker = "{url}"')
    assert (found.host, found.port, found.tls) == (host, port, tls)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ('broker = "tcp://127.0.0.1"', "invalid broker = 'tcp://127.0.0.1'"),
        ('broker = "127.0.0.1:1883"', "invalid broker = "),
        ('broker = "mqtt://127.0.0.1:70000"', "invalid broker = "),
        ('broker = "mqtt://127.0.0.1:0"', "invalid broker = "),
        ('broker = "mqtt://me:word@127.0.0.1"', "apart from it"),
        ('broker = "mqtt://192.0.2.7"', "set insecure = true"),
        ('broker = "mqtt://broker.example.com"', "set insecure = true"),
        ('user = "hall"\npassword = "letmein"', "does not belong in a plant file"),
        ('password_file = "word"', "write user ="),
        ('user = "hall"\npassword = "@a"\npassword_file = "b"', "leave one of them out"),
        ('authority = "ca.pem"', "for brokers with TLS"),
        ('broker = "mqtts://b"\ncertificate = "a.pem"', "write both certificate = and key ="),
        ('version = "4"', "invalid version = '4'"),
        ("keep_alive_s = 1", "invalid keep_alive_s = 1"),
    ],
)
def test_invalid_broker_setting_is_refused_with_its_line(tmp_path, text, sentence):
    with pytest.raises(FileFormatError, match=r"plant\.toml, line") as refused:
        settings(tmp_path, text)
    assert sentence in str(refused.value)
    assert "letmein" not in str(refused.value)
    assert "word@" not in str(refused.value)


def test_unencrypted_remote_broker_needs_insecure_true(tmp_path):
    assert settings(tmp_path, 'broker = "mqtt://192.0.2.7"\ninsecure = true').host == "192.0.2.7"


def test_password_is_read_from_a_private_file(tmp_path):
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
def test_password_file_readable_by_others_is_refused(tmp_path):
    word = tmp_path / "word"
    word.write_text("open sesame\n")
    word.chmod(0o644)
    with pytest.raises(UsageError, match="others can read"):
        settings(tmp_path, 'user = "hall"\npassword_file = "word"').password()


def test_password_is_read_from_credentials_folder_or_environment(tmp_path):
    text = 'user = "hall"\npassword = "@hall-2"'
    (tmp_path / "hall-2").write_text("from a file\n")
    assert settings(tmp_path, text, {"CREDENTIALS_DIRECTORY": str(tmp_path)}).password() == "from a file"
    assert settings(tmp_path, text, {"DRIVECOMM_BROKER_HALL_2": "from there"}).password() == "from there"
    with pytest.raises(UsageError, match="DRIVECOMM_BROKER_HALL_2"):
        settings(tmp_path, text).password()


@pytest.mark.soak
def test_server_without_a_broker_door_imports_no_mqtt_module():
    look = "import sys; import drivecomm.server.serving; print([each for each in sys.modules if 'mqtt' in each])"
    found = subprocess.run([sys.executable, "-c", look], capture_output=True, text=True, check=True, timeout=60)
    assert found.stdout.strip() == "[]"


def test_missing_package_is_reported_with_its_install_command(monkeypatch):
    monkeypatch.setitem(sys.modules, "aiomqtt", None)
    with pytest.raises(UsageError, match=r"pip install \"drivecomm\[mqtt\]\""):
        mqtt_door(TomlTable({}, "plant.toml"))
