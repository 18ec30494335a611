"""Server messages in the journal or a file; a failing destination blocks no caller, and the loss is reported."""

import errno
import logging
import os
import re
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from drivecomm.errors import UsageError
from drivecomm.server import Event, logs
from drivecomm.server.event_log import EventLog
from drivecomm.server.logs import Repetitions, RotatingFile, WaitingHandler, for_journal, for_people, logging_to

LOGGER = logging.getLogger("drivecomm.server")


def record(text, *, level=logging.WARNING, name="drivecomm.server"):
    return logging.LogRecord(name, level, "", 0, text, None, None)


def texts(records):
    return [each.msg for each in records]


class TestLogLines:
    def test_line_of_a_log_file_has_time_level_and_text(self):
        made = record("hall: the port is gone")
        made.created = 0
        assert re.fullmatch(
            r"19(70|69)-\d\d-\d\d \d\d:\d\d:00\.000[+-]\d\d:\d\d warning hall: .* gone\n", for_people(made)
        )

    @pytest.mark.parametrize(
        ("level", "priority"), [("DEBUG", 7), ("INFO", 6), ("WARNING", 4), ("ERROR", 3), ("CRITICAL", 2)]
    )
    def test_line_for_the_journal_has_a_priority(self, level, priority):
        made = record("hall: the port is gone", level=logging.getLevelNamesMapping()[level])
        assert for_journal(made) == f"<{priority}>hall: the port is gone\n"

    def test_message_of_a_library_has_its_name(self):
        assert for_journal(record("too late", name="uvicorn.error")) == "<4>uvicorn.error: too late\n"

    def test_line_break_in_a_text_forges_no_second_message(self, tmp_path):
        with logging_to(tmp_path / "log", "info"):
            LOGGER.warning("unknown user %s", "x\n2026-01-01 00:00:00.000+00:00 info    pump was stopped")
        assert len((tmp_path / "log").read_text().splitlines()) == 1

    def test_traceback_is_indented_after_its_message(self, tmp_path):
        with logging_to(tmp_path / "log", "info"):
            try:
                {}["pump"]
            except KeyError:
                LOGGER.exception("a door has failed")
        first, *rest = (tmp_path / "log").read_text().splitlines()
        assert first.endswith("error   a door has failed")
        assert rest[0] == "    Traceback (most recent call last):"
        assert rest[-1] == "    KeyError: 'pump'"
        assert all(line.startswith("    ") for line in rest)


class TestRepetitions:
    def test_first_message_is_written_and_repetitions_are_counted(self):
        seen = Repetitions()
        assert texts(seen.take(record("lost"), 0)) == ["lost"]
        for second in range(1, 58):
            assert seen.take(record("lost"), second) == []
        assert texts(seen.due(60)) == ["lost (57 more times in the last 60 s)"]

    def test_repetitions_are_counted_each_minute_until_they_stop(self):
        seen = Repetitions()
        seen.take(record("lost"), 0)
        seen.take(record("lost"), 1)
        assert texts(seen.due(60)) == ["lost (1 more time in the last 60 s)"]
        assert seen.take(record("lost"), 61) == []
        assert texts(seen.due(120)) == ["lost (1 more time in the last 60 s)"]
        assert seen.due(180) == []
        assert texts(seen.take(record("lost"), 181)) == ["lost"]

    @pytest.mark.parametrize(
        "other", [record("late"), record("lost", level=logging.ERROR), record("lost", name="uvicorn")]
    )
    def test_message_with_another_text_level_or_logger_is_not_a_repetition(self, other):
        seen = Repetitions()
        seen.take(record("lost"), 0)
        assert seen.take(other, 1) == [other]

    def test_count_of_a_past_minute_is_written_before_the_next_message(self):
        seen = Repetitions()
        seen.take(record("lost"), 0)
        seen.take(record("lost"), 1)
        assert texts(seen.take(record("late"), 70)) == ["lost (1 more time in the last 70 s)", "late"]

    def test_counts_are_written_at_the_end(self):
        seen = Repetitions()
        for second in range(3):
            seen.take(record("lost"), second)
        assert texts(seen.rest(10)) == ["lost (2 more times in the last 10 s)"]

    def test_number_of_remembered_messages_is_limited(self):
        seen = Repetitions()
        seen.take(record("first"), 0)
        seen.take(record("first"), 1)
        told = [each for number in range(1500) for each in texts(seen.take(record(str(number)), 2))]
        assert told.count("first (1 more time in the last 2 s)") == 1
        assert len(seen.rest(3)) == 0


class TestLogDestinations:
    def test_stderr_without_a_journal_has_times(self):
        done = _logging_program("")
        assert re.fullmatch(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d\.\d{3}\S+ info    ready\n", done.stderr)

    @pytest.mark.skipif(sys.platform != "linux", reason="the journal is systemd's")
    def test_stderr_connected_to_the_journal_has_priorities(self):
        # systemd connects stderr to the journal, and names its device and inode in the environment.
        done = _logging_program("found = os.fstat(2); os.environ['JOURNAL_STREAM'] = f'{found.st_dev}:{found.st_ino}'")
        assert done.stderr == "<6>ready\n"

    @pytest.mark.skipif(sys.platform != "linux", reason="the journal is systemd's")
    def test_redirected_stderr_has_no_priorities(self):
        done = _logging_program("os.environ['JOURNAL_STREAM'] = '8:1'")
        assert not done.stderr.startswith("<")

    def test_messages_below_the_level_are_not_logged(self, tmp_path):
        with logging_to(tmp_path / "log", "warning"):
            LOGGER.info("not this")
            LOGGER.warning("this")
        assert [line.split()[-1] for line in (tmp_path / "log").read_text().splitlines()] == ["this"]

    def test_debug_messages_of_libraries_are_not_logged(self, tmp_path):
        with logging_to(tmp_path / "log", "debug"):
            LOGGER.debug("own")
            logging.getLogger("asyncio").debug("another's")
            logging.getLogger("asyncio").warning("important")
        written = (tmp_path / "log").read_text()
        assert "own" in written
        assert "asyncio: important" in written
        assert "another's" not in written

    def test_logging_settings_are_restored_afterwards(self, tmp_path):
        before = logging.getLogger().level, list(logging.getLogger().handlers), logging.getLogger("drivecomm").level
        with logging_to(tmp_path / "log", "debug"):
            pass
        after = logging.getLogger().level, list(logging.getLogger().handlers), logging.getLogger("drivecomm").level
        assert after == before

    def test_invalid_log_file_is_refused_at_the_start(self, tmp_path):
        (tmp_path / "file").touch()
        file = tmp_path / "file" / "log"
        with pytest.raises(UsageError, match="file/log: cannot be written"), logging_to(file, "info"):
            pass


class TestRotation:
    def test_large_log_file_is_rotated_and_five_older_ones_are_kept(self, tmp_path):
        file = RotatingFile(tmp_path / "log", largest=200)
        for number in range(40):
            file.write(record(f"message {number:02} {'.' * 20}"))
        file.close()
        assert sorted(each.name for each in tmp_path.iterdir()) == ["log", *(f"log.{n}" for n in range(1, 6))]
        assert all(each.stat().st_size <= 200 for each in tmp_path.iterdir())
        kept = "".join((tmp_path / name).read_text() for name in ["log.5", "log.4", "log.3", "log.2", "log.1", "log"])
        numbers = [int(number) for number in re.findall(r"message (\d\d)", kept)]
        assert numbers == list(range(numbers[0], 40))
        assert len(numbers) > 10

    @pytest.mark.skipif(os.name != "posix", reason="Windows has no such permissions")
    def test_new_log_file_is_accessible_to_its_owner_only(self, tmp_path):
        mask = os.umask(0o022)
        try:
            RotatingFile(tmp_path / "log").close()
        finally:
            os.umask(mask)
        assert (tmp_path / "log").stat().st_mode & 0o777 == 0o600

    def test_existing_log_file_is_appended_to(self, tmp_path):
        (tmp_path / "log").write_text("of yesterday\n")
        file = RotatingFile(tmp_path / "log")
        file.write(record("of today"))
        file.close()
        assert (tmp_path / "log").read_text().startswith("of yesterday\n")
        assert (tmp_path / "log").read_text().endswith("of today\n")

    def test_message_larger_than_the_size_limit_is_written(self, tmp_path):
        file = RotatingFile(tmp_path / "log", largest=100)
        file.write(record("x" * 500))
        file.write(record("y"))
        file.close()
        assert "x" * 500 in (tmp_path / "log.1").read_text()


class FullDisk:
    """Simulated full disk that lets a file grow up to a size."""

    def __init__(self, monkeypatch):
        self.is_full = True
        add = logs.GrowingFile.add

        def added(file, piece):
            if self.is_full:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            add(file, piece)

        monkeypatch.setattr(logs.GrowingFile, "add", added)


class TestFullDisk:
    def test_number_of_missing_messages_is_logged_after_a_full_disk(self, tmp_path, monkeypatch, capsys):
        now = [1000.0]
        file = RotatingFile(tmp_path / "log", now=lambda: now[0])
        disk = FullDisk(monkeypatch)
        for _ in range(3):
            file.write(record("lost"))
        assert "no space left on the device; messages are not logged" in capsys.readouterr().err
        disk.is_full = False
        now[0] += 10
        file.write(record("kept"))
        file.close()
        first, second = (tmp_path / "log").read_text().splitlines()
        assert first.endswith("kept")
        assert re.search(r"log: messages are logged again from .* on; 3 are missing$", second)
        assert "3 are missing" in capsys.readouterr().err

    @pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
    def test_real_full_disk_does_not_end_the_program(self):
        done = _logging_program("", place="Path('/dev/full')")
        assert done.returncode == 0
        assert "no space left on the device" in done.stderr

    def test_failed_rotation_is_reported_on_stderr(self, tmp_path, capsys):
        file = RotatingFile(tmp_path / "log", largest=100)
        (tmp_path / "log.1").mkdir()
        (tmp_path / "log.1" / "in the way").touch()
        (tmp_path / "log.2").mkdir()
        (tmp_path / "log.2" / "in the way").touch()
        for number in range(5):
            file.write(record(f"{number} {'.' * 60}"))
        file.close()
        assert "messages are not logged" in capsys.readouterr().err


class TestNonBlockingLog:
    def test_hanging_destination_does_not_block_and_lost_messages_are_counted(self, monkeypatch):
        monkeypatch.setattr(logs, "_WAITING", 10)
        hanging = Hanging()
        handler = WaitingHandler(hanging)
        began = time.monotonic()
        for number in range(1000):
            handler.emit(record(str(number)))
        assert time.monotonic() - began < 1
        hanging.go_on.set()
        handler.close()
        written = texts(hanging.written)
        assert any(
            re.fullmatch(r"9\d\d messages were lost, because they arrived faster than they were written", text)
            for text in written
        )

    def test_close_waits_for_a_hanging_destination_only_briefly(self, monkeypatch):
        monkeypatch.setattr(logs, "_PATIENCE_S", 0.1)
        hanging = Hanging()
        handler = WaitingHandler(hanging)
        handler.emit(record("never written"))
        began = time.monotonic()
        handler.close()
        assert time.monotonic() - began < 1
        hanging.go_on.set()

    def test_message_is_formatted_with_its_arguments_at_the_time_of_the_call(self, tmp_path):
        drives = ["pump"]
        with logging_to(tmp_path / "log", "info"):
            LOGGER.info("stopping %s", drives)
            drives.clear()
        assert "stopping ['pump']" in (tmp_path / "log").read_text()

    @pytest.mark.soak
    def test_count_of_repetitions_is_written_without_another_message(self, monkeypatch):
        monkeypatch.setattr(logs, "_REPEATED_S", 0.2)
        written = Written()
        handler = WaitingHandler(written)
        for _ in range(4):
            handler.emit(record("lost"))
        until = time.monotonic() + 5
        while len(written.written) < 2 and time.monotonic() < until:
            time.sleep(0.05)
        assert re.fullmatch(r"lost \(3 more times in the last \d s\)", written.written[1].msg)
        handler.close()


class Written:
    def __init__(self):
        self.written = []

    def write(self, record):
        self.written.append(record)

    def close(self):
        pass


class Hanging(Written):
    def __init__(self):
        super().__init__()
        self.go_on = threading.Event()

    def write(self, record):
        self.go_on.wait(10)
        super().write(record)


def _logging_program(first, *, place="None"):
    program = f"""
import logging, os
from pathlib import Path
{first}
from drivecomm.server.logs import logging_to
with logging_to({place}, "info"):
    logging.getLogger("drivecomm.server").info("ready")
"""
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=30, check=False)


class TestEventsOfALostLine:
    @pytest.fixture
    def logged(self, caplog):
        caplog.set_level(logging.INFO, "drivecomm.server")
        up = {"hall": True, "yard": True}
        log = EventLog(up.get)

        def log_all(*events):
            caplog.clear()
            log.take([], [Event(number=1, time_s=0.0, text="...", **each) for each in events])
            return [f"{each.levelname} {each.message}" for each in caplog.records]

        return up, log_all

    def test_silence_of_drives_on_a_lost_line_is_not_logged(self, logged):
        up, log_all = logged
        up["hall"] = False
        lost = [
            {"kind": "line", "line": "hall"},
            {"kind": "silent", "line": "hall", "drive": "pump"},
            {"kind": "silent", "line": "hall", "drive": "mixer"},
            {"kind": "silent", "line": "yard", "drive": "fan"},
        ]
        assert log_all(*lost) == ["WARNING hall: line: ...", "WARNING yard fan: silent: ..."]
        up["hall"] = True
        back = [
            {"kind": "line", "line": "hall"},
            {"kind": "answers", "line": "hall", "drive": "pump"},
            {"kind": "silent", "line": "hall", "drive": "mixer"},
            {"kind": "answers", "line": "yard", "drive": "fan"},
        ]
        assert log_all(*back) == [
            "WARNING hall: line: ...", "WARNING hall mixer: silent: ...", "INFO yard fan: answers: ..."
        ]  # fmt: skip
        later = [{"kind": "answers", "line": "hall", "drive": name} for name in ("pump", "mixer")]
        assert log_all(*later) == ["INFO hall pump: answers: ...", "INFO hall mixer: answers: ..."]

    def test_command_is_logged_with_its_caller(self, logged):
        assert logged[1]({"kind": "command", "line": "hall", "drive": "pump", "who": "eva (local)"}) == [
            "INFO hall pump: command: ..., by eva (local)"
        ]
