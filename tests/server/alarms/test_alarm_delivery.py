"""Delivery of alarm messages to receivers that hang, refuse or fail; a bad receiver does not delay the others."""

import contextlib
import json
import os
import socket
import sys
import threading
import time
from importlib.util import find_spec
from pathlib import Path

import pytest
from alarm_receivers import Hook

from drivecomm.server.alarms import AlarmDelivery, receivers_of
from drivecomm.server.alarms.delivery import MOST, DeliveryTiming, UndeliveredAlarm

QUICK = DeliveryTiming(within_s=0.5, first_s=0.02, longest_s=0.05, give_up_s=60, gather_s=0.02)


class Delivering:
    def __init__(self, *entries, pace=QUICK):
        self.said = []
        self.receivers = receivers_of(entries, {})
        self.delivery = AlarmDelivery(self.receivers, plant="hall 2", say=self.said.append, pace=pace)
        self.delivery.start()

    def put(self, what="raised", to=None, number=1):
        entry = {"message": f"run-1.{number}", "what": what, "title": f"tripped: pump ({what})", "text": f"pump {what}"}
        self.delivery.put([UndeliveredAlarm(to=each, entry=entry) for each in to or self.receivers])


@pytest.fixture
def delivering():
    with contextlib.ExitStack() as stack:

        def make(*entries, pace=QUICK):
            found = Delivering(*entries, pace=pace)
            stack.callback(found.delivery.close, 0.1)
            return found

        yield make


def test_webhook_receives_one_message_per_alarm(hook, delivering, eventually):
    out = delivering(f"webhook:{hook.url}")
    out.put()
    eventually(lambda: hook.got)
    assert hook.got == [
        {
            "plant": "hall 2",
            "title": "hall 2: tripped: pump (raised)",
            "text": "pump raised",
            "alarms": [
                {"message": "run-1.1", "what": "raised", "title": "tripped: pump (raised)", "text": "pump raised"}
            ],
        }
    ]
    assert hook.headers.startswith("POST /hook?token=secret HTTP/1.1\r\n")
    assert "Content-Type: application/json\r\n" in hook.headers
    eventually(lambda: not out.delivery.waiting())
    assert out.said == []
    time.sleep(0.1)
    assert len(hook.got) == 1


def test_simultaneous_alarms_are_delivered_in_one_message(hook, delivering, eventually):
    out = delivering(f"webhook:{hook.url}", pace=DeliveryTiming(gather_s=0.3))
    for number in range(50):
        out.put(number=number)
    eventually(lambda: hook.got)
    assert [each["message"] for each in hook.got[0]["alarms"]] == [f"run-1.{number}" for number in range(50)]
    assert hook.got[0]["title"] == "hall 2: 50 alarms"


@pytest.mark.soak
@pytest.mark.parametrize(
    ("does", "reason"),
    [
        ("hang", "no answer within 0.5 s"),
        ("drip", "no answer within 0.5 s"),
        ("reset", "Connection reset by peer"),
        (500, "it answered 500 Internal Server Error"),
        (301, "it answered 301 Moved Permanently"),
        (404, "it answered 404 Not Found"),
    ],
)
def test_failed_delivery_is_retried(hook, delivering, eventually, does, reason):
    hook.does = does
    out = delivering(f"webhook:{hook.url}")
    out.put()
    eventually(lambda: hook.begun >= 3)
    out.put("over", number=2)
    hook.does = 200
    eventually(lambda: not out.delivery.waiting())
    # The messages arrive in order, and the failure is reported once.
    assert hook.told == ["raised", "over"]
    label = f"webhook {hook.url.split('/')[2]}"
    assert out.said[0] == f"an alarm could not be delivered to {label}, and will be retried: {reason}"
    assert out.said[1].startswith(f"alarms were delivered to {label}, after ")
    assert len(out.said) == 2
    assert "secret" not in "".join(out.said)


def test_refused_connection_is_reported(delivering, eventually):
    with socket.create_server(("127.0.0.1", 0)) as listening:
        port = listening.getsockname()[1]
    out = delivering(f"webhook:http://127.0.0.1:{port}/")
    out.put()
    assert eventually(lambda: out.said)[0].endswith("will be retried: Connection refused")


@pytest.mark.soak
def test_pause_between_retries_grows(hook, delivering, eventually):
    hook.does = 500
    out = delivering(f"webhook:{hook.url}", pace=DeliveryTiming(within_s=1, first_s=0.2, longest_s=10, gather_s=0))
    began = time.monotonic()
    out.put()
    eventually(lambda: hook.begun == 4)
    assert 1.4 <= time.monotonic() - began < 3.1


def test_delivery_is_given_up_after_its_deadline(hook, delivering, eventually):
    hook.does = 500
    out = delivering(
        f"webhook:{hook.url}", pace=DeliveryTiming(within_s=1, first_s=0.05, longest_s=0.05, give_up_s=0.3, gather_s=0)
    )
    out.put()
    eventually(lambda: not out.delivery.waiting())
    assert out.said[-1].endswith("and is discarded: it answered 500 Internal Server Error")
    assert hook.begun >= 2


def test_hanging_receiver_does_not_delay_another(hook, delivering, eventually):
    hook.does = "hang"
    with Hook() as other:
        out = delivering(f"webhook:{hook.url}", f"webhook:{other.url}", pace=DeliveryTiming(within_s=60, gather_s=0))
        began = time.monotonic()
        out.put()
        eventually(lambda: other.got)
        out.put("over", number=2)
        eventually(lambda: len(other.got) == 2)
        assert time.monotonic() - began < 10
        # A delivered message leaves the list a moment after its arrival.
        eventually(lambda: {each.to for each in out.delivery.waiting()} == {f"webhook:{hook.url}"})


def test_oldest_messages_are_dropped_from_a_full_queue(hook, delivering):
    hook.does = "hang"
    out = delivering(f"webhook:{hook.url}", pace=DeliveryTiming(within_s=60, gather_s=60))
    for number in range(MOST + 2):
        out.put(number=number)
    waiting = out.delivery.waiting()
    assert len(waiting) == MOST
    assert waiting[-1].entry["message"] == f"run-1.{MOST + 1}"
    assert [each.startswith(f"more than {MOST} alarms wait for webhook") for each in out.said] == [True]


@pytest.mark.soak
def test_close_returns_within_its_time_limit(hook, delivering, eventually):
    hook.does = "hang"
    out = delivering(f"webhook:{hook.url}", pace=DeliveryTiming(within_s=60, gather_s=0))
    out.put()
    eventually(lambda: hook.begun)
    began = time.monotonic()
    out.delivery.close(0.5)
    assert 0.4 < time.monotonic() - began < 1.5
    assert len(out.delivery.waiting()) == 1


def test_close_delivers_waiting_messages_immediately(hook, delivering):
    out = delivering(f"webhook:{hook.url}", pace=DeliveryTiming(gather_s=60))
    out.put()
    out.delivery.close(5)
    assert hook.told == ["raised"]
    assert out.delivery.waiting() == []


def test_close_retries_a_failed_message(hook, delivering, eventually):
    hook.does = 500
    out = delivering(f"webhook:{hook.url}", pace=DeliveryTiming(first_s=60, gather_s=0))
    out.put()
    eventually(lambda: out.said)
    hook.does = 200
    out.delivery.close(5)
    assert hook.told == ["raised"]


def test_webhook_sends_user_and_password_of_the_url(hook, delivering, eventually):
    out = delivering(f"webhook:{hook.url.replace('http://', 'http://ann:p%40ss@')}")
    out.put()
    eventually(lambda: hook.got)
    assert "Authorization: Basic YW5uOnBAc3M=\r\n" in hook.headers


class TestCommand:
    @pytest.fixture
    def command(self, tmp_path):
        def write(text):
            file = tmp_path / "page me.py"
            file.write_text(text)
            return f"command:{sys.executable} '{file}' '$HOME; true'"

        return write

    def test_command_receives_the_message_on_stdin_without_a_shell(self, command, tmp_path, delivering, eventually):
        got = tmp_path / "got.json"
        out = delivering(
            command(f"import sys, json; json.dump([sys.argv[1:], json.load(sys.stdin)], open({str(got)!r}, 'w'))"),
            pace=DeliveryTiming(gather_s=0),
        )
        out.put()
        eventually(lambda: not out.delivery.waiting())
        arguments, message = json.loads(got.read_text())
        assert arguments == ["$HOME; true"]
        assert message["alarms"][0]["what"] == "raised"
        assert out.said == []

    @pytest.mark.soak
    def test_error_output_of_the_command_is_reported(self, command, delivering, eventually):
        out = delivering(
            command("import sys; print('no', file=sys.stderr); sys.exit('modem is off')"), pace=DeliveryTiming()
        )
        out.put()
        assert eventually(lambda: out.said)[0].endswith("it ended with exit status 1: modem is off")

    @pytest.mark.soak
    @pytest.mark.skipif(not hasattr(os, "killpg"), reason="process groups")
    def test_hanging_command_is_killed_with_its_child_processes(self, command, tmp_path, delivering, eventually):
        pids = tmp_path / "pids"
        out = delivering(
            command(
                "import os, subprocess, sys, time\n"
                "child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)'])\n"
                f"open({str(pids)!r}, 'a').write(f'{{os.getpid()}} {{child.pid}}\\n')\n"
                "time.sleep(60)\n"
            ),
            pace=DeliveryTiming(within_s=3, first_s=60, gather_s=0),
        )
        out.put()
        assert eventually(lambda: out.said)[0].endswith("it did not end within 3 s and was killed")
        for pid in map(int, pids.read_text().split()):
            eventually(lambda pid=pid: not alive(pid))

    def test_missing_command_is_reported(self, delivering, eventually):
        out = delivering("command:/no/such/program")
        assert eventually(lambda: out.said) == [
            "no alarm can be delivered to command program: program /no/such/program not found"
        ]
        out.put()
        eventually(lambda: len(out.said) > 1)
        assert out.said[1].endswith("No such file or directory")


def alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


class MailServer:
    """SMTP server that accepts any mail."""

    def __init__(self):
        self.listening = socket.create_server(("127.0.0.1", 0))
        self.port = self.listening.getsockname()[1]
        self.mails = []
        threading.Thread(target=self.accept, daemon=True).start()

    def accept(self):
        while True:
            try:
                connection, _ = self.listening.accept()
            except OSError:
                return
            with connection, connection.makefile("rwb") as stream:
                stream.write(b"220 here\r\n")
                stream.flush()
                for line in stream:
                    if line.upper().startswith(b"DATA"):
                        stream.write(b"354 go on\r\n")
                        stream.flush()
                        self.mails.append(b"".join(iter(stream.readline, b".\r\n")).decode())
                    stream.write(b"221 bye\r\n" if line.upper().startswith(b"QUIT") else b"250 ok\r\n")
                    stream.flush()


@pytest.mark.skipif(find_spec("apprise") is None, reason="the extra server")
class TestApprise:
    @pytest.mark.soak
    def test_apprise_sends_a_mail(self, delivering, eventually):
        server = MailServer()
        out = delivering(
            f"mailto://localhost:{server.port}/you@example.com?from=hall2@example.com", pace=DeliveryTiming()
        )
        out.put()
        eventually(lambda: not out.delivery.waiting(), 60)
        server.listening.close()
        (mail,) = server.mails
        assert "Subject: hall 2: tripped: pump (raised)" in mail
        assert "pump raised" in mail
        assert out.said == []

    @pytest.mark.soak
    def test_invalid_apprise_url_is_reported_before_the_first_alarm(self, delivering, eventually):
        out = delivering("nonsense://secret")
        (said,) = eventually(lambda: out.said, 60)
        assert said.startswith("no alarm can be delivered to nonsense: it ended with exit status 1: apprise does not")
        assert "secret" not in said

    def test_apprise_is_not_imported_into_the_server_process(self):
        assert "apprise" not in sys.modules
