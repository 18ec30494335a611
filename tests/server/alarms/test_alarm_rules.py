"""Alarm rules of a plant file: defaults, all keys, and errors."""

from decimal import Decimal

import pytest

from drivecomm.errors import FileFormatError, UsageError
from drivecomm.protocol import DriveConfig, PollGroup
from drivecomm.server.alarms import AlarmLimit, AlarmRule, read_alarms, receivers_of
from drivecomm.tomlfile import read_toml

DRIVES = [
    DriveConfig(protocol="vabus", address=1, name="pump", poll=(PollGroup(parameters=("output_current", "481")),)),
    DriveConfig(protocol="vabus", address=2, name="fan", poll=(PollGroup(parameters=("output_current",)),)),
    DriveConfig(protocol="vabus", address=3, name="mixer"),
]


@pytest.fixture
def rules(tmp_path):
    def read(text):
        file = tmp_path / "plant.toml"
        file.write_text(text)
        return read_alarms(read_toml(file, "a plant").tables("alarm"), DRIVES, backed_up=("pump", "fan"))

    return read


def test_alarm_rule_has_defaults():
    (rule,) = read_alarms([], DRIVES) or [AlarmRule(name="fault", on="fault", drives=("pump",))]
    assert (rule.for_s, rule.over_s, rule.remind_s, rule.deliver) == (0.0, 60.0, None, ())


def test_alarm_rule_accepts_every_key(rules):
    assert rules(
        """
        [[alarm]]
        name = "pump tripped"
        drives = ["pump"]
        on = "fault"
        for_s = 5
        over_s = 30
        remind_s = 3600
        deliver = ["webhook:http://127.0.0.1:9000/hook", "command:/usr/local/bin/page-me --loud", "@mail"]

        [[alarm]]
        on = "silent"

        [[alarm]]
        on = "changed_since_baseline"

        [[alarm]]
        quantity = "output_current"
        above = 12.1
        hysteresis = 0.5

        [[alarm]]
        quantity = "481"
        below = -3
        """
    ) == (
        AlarmRule(
            name="pump tripped", on="fault", drives=("pump",), for_s=5.0, over_s=30.0, remind_s=3600.0,
            deliver=("webhook:http://127.0.0.1:9000/hook", "command:/usr/local/bin/page-me --loud", "@mail"),
        ),
        AlarmRule(name="silent", on="silent", drives=("pump", "fan", "mixer")),
        AlarmRule(name="changed_since_baseline", on="changed_since_baseline", drives=("pump", "fan")),
        AlarmRule(
            name="output_current above 12.1", on="limit", drives=("pump", "fan"),
            limit=AlarmLimit(quantity="output_current", side="above", at=Decimal("12.1"), hysteresis=Decimal("0.5")),
        ),
        AlarmRule(
            name="481 below -3", on="limit", drives=("pump",),
            limit=AlarmLimit(quantity="481", side="below", at=Decimal(-3)),
        ),
    )  # fmt: skip


def test_text_of_an_alarm_rule_names_drives_condition_and_delays(rules):
    fault, changed, current = rules(
        """
        [[alarm]]
        on = "fault"
        drives = ["pump", "fan"]
        [[alarm]]
        on = "changed_since_baseline"
        drives = ["pump"]
        [[alarm]]
        quantity = "output_current"
        above = 12.5
        hysteresis = 0.5
        for_s = 10
        over_s = 5
        remind_s = 600
        """
    )
    assert str(fault) == "alarm when pump or fan has a fault; cleared after 60 s without a fault"
    assert str(changed) == "alarm when pump is not set as its baseline; cleared after 60 s as approved"
    assert str(current) == (
        "alarm when output_current of pump or fan is above 12.5 A for 10 s; cleared after 5 s at 12.0 A or below; "
        "a reminder every 600 s"
    )


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ('onn = "fault"', "line 2: alarm 1: unknown key 'onn'; did you mean 'on'?"),
        ('on = "falt"', "line 2: alarm 1: unknown on = 'falt'; did you mean 'fault'?"),
        ('on = "limit"', "line 2: alarm 1: unknown on = 'limit'; use fault, warning, silent, changed_since_baseline"),
        ('on = "changed_since_baseline"\ndrives = ["pump", "mixer"]', "alarm 1: the server does not back mixer up"),
        ("for_s = 5", "alarm 1: an alarm needs on ="),
        ('on = "fault"\nfor_s = -1', "line 3: alarm 1: invalid for_s = -1; write 0 seconds or more"),
        ('on = "fault"\nfor_s = inf', "invalid for_s = inf"),
        ('on = "fault"\nover_s = 0.5', "line 3: alarm 1: invalid over_s = 0.5; write 1 seconds or more"),
        ('on = "fault"\nremind_s = 5', "line 3: alarm 1: invalid remind_s = 5; write 60 seconds or more"),
        ('on = "fault"\nabove = 3', "line 3: alarm 1: above needs a quantity"),
        ('on = "fault"\nquantity = "481"\nabove = 1', "line 2: alarm 1: on and quantity define two alarms"),
        ('quantity = "481"', "line 2: alarm 1: a quantity needs exactly one limit"),
        ('quantity = "481"\nabove = 1\nbelow = 2', "line 2: alarm 1: a quantity needs exactly one limit"),
        ('quantity = "481"\nabove = nan', "line 3: alarm 1: invalid above = nan; write a number"),
        ('quantity = "481"\nabove = 1\nhysteresis = -1', "line 4: alarm 1: invalid hysteresis = -1; write a number"),
        ('quantity = "output_curent"\nabove = 1', "not polled of pump; did you mean 'output_current'?"),
        ('quantity = "481"\ndrives = ["fan"]\nabove = 1', "481 is not polled of fan; polled are output_current"),
        ('on = "fault"\ndrives = ["pmp"]', "line 3: alarm 1: unknown drive 'pmp'; did you mean 'pump'?"),
        ('on = "fault"\ndrives = []', "line 3: alarm 1: invalid drives = []"),
        ('on = "fault"\ndeliver = [3]', "line 3: alarm 1: invalid deliver = [3]"),
        ('on = "fault"\ndeliver = ["webhok:http://x"]', "unknown receiver 'webhok:http://x'; did you mean 'webhook'?"),
        ('on = "fault"\ndeliver = ["webhook:example.com"]', "invalid URL of a webhook"),
        ('on = "fault"\ndeliver = ["webhook:http://x/a b"]', "invalid URL of a webhook"),
        ('on = "fault"\ndeliver = ["webhook:http://x:99999/"]', "invalid URL of a webhook"),
        ('on = "fault"\ndeliver = ["command:"]', "the command is missing"),
        ('on = "fault"\ndeliver = ["command:page \'me"]', "No closing quotation"),
        ('on = "fault"\ndeliver = ["@a b"]', "line 3: alarm 1: invalid name of a secret '@a b'"),
        ('on = "fault"\n[[alarm]]\non = "fault"', "line 3: alarm 2: two alarms are named 'fault'"),
    ],
)  # fmt: skip
def test_invalid_alarm_rule_is_refused_with_its_line(rules, line, said):
    with pytest.raises(FileFormatError) as caught:
        rules(f"[[alarm]]\n{line}\n")
    assert said in str(caught.value)
    assert "plant.toml, line " in str(caught.value)


class TestSecrets:
    def test_secret_is_read_from_the_credentials_folder_first(self, tmp_path):
        (tmp_path / "mail").write_text("mailto://ann:pass@example.com\n")
        environment = {"CREDENTIALS_DIRECTORY": str(tmp_path), "DRIVECOMM_ALARM_MAIL": "webhook:http://other"}
        found = receivers_of(["@mail"], environment)["@mail"]
        assert (found.label, found.url) == ("@mail", "mailto://ann:pass@example.com")

    def test_secret_is_read_from_the_environment(self, tmp_path):
        environment = {"CREDENTIALS_DIRECTORY": str(tmp_path), "DRIVECOMM_ALARM_ON_CALL": "webhook:https://x/secret"}
        found = receivers_of(["@on-call"], environment)["@on-call"]
        assert (found.label, found.url) == ("@on-call", "https://x/secret")

    def test_missing_secret_is_refused(self):
        with pytest.raises(UsageError, match=r"there is no secret @mail; put it into .*\$DRIVECOMM_ALARM_MAIL"):
            receivers_of(["@mail"], {})

    def test_labels_and_errors_show_no_secret(self):
        found = receivers_of(["webhook:https://u:p@example.com:8443/secret", "slack://secret/secret"], {})
        assert [each.label for each in found.values()] == ["webhook example.com:8443", "slack"]
        with pytest.raises(UsageError) as caught:
            receivers_of(["@mail"], {"DRIVECOMM_ALARM_MAIL": "secret"})
        assert "unknown receiver; write webhook:URL" in str(caught.value)
        assert "= secret" not in str(caught.value)
