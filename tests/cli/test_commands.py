"""The commands protocols, decode, encode, scan, vectors and demo, and the command line itself."""

import errno
import json
import re
import subprocess
import sys

import pytest

import drivecomm
from drivecomm.cli import main
from drivecomm.cli.app import COMMANDS, app
from drivecomm.cli.demo import served, sites
from drivecomm.plant import read_plant
from drivecomm.protocol import installed
from drivecomm.virtual import VirtualLine, virtual_drive

ALL = {"danfoss-fc", "fuji", "vabus", "vlt3500"}


def test_protocols_lists_installed_packages(shell):
    assert shell("protocols", port=None) == 0
    assert "Bonfiglioli VABus" in shell.out
    assert shell("protocols", "--json", port=None) == 0
    assert {one["protocol"] for one in shell.objects} >= ALL


@pytest.mark.parametrize(
    "spelling",
    [
        ["04 41 30 30 34 38 31 05"],
        ["0441303034383105"],
        ["04", "41", "30", "30", "34", "38", "31", "05"],
        ["0x04 0x41 0x30 0x30 0x34 0x38 0x31 0x05"],
        ["04:41:30:30:34:38:31:05"],
        [r"\x04\x41\x30\x30\x34\x38\x31\x05"],
    ],
)
def test_decode_in_any_spacing_tries_all_protocols(shell, spelling):
    assert shell("decode", *spelling, port=None) == 0
    assert shell.out == "vabus request: enquiry address=1 sys=0 dataset=0 parameter=481\n"


def test_decode_prints_json(shell):
    assert shell("decode", "04 41 30 30 34 38 31 05", "--protocol", "vabus", "-d", "request", "--json", port=None) == 0
    assert shell.objects == [
        {
            "protocol": "vabus",
            "direction": "request",
            "valid": True,
            "data": "04 41 30 30 34 38 31 05",
            "fields": {"kind": "enquiry", "address": 1, "sys": 0, "dataset": 0, "parameter": 481},
        }
    ]


def test_decode_finds_a_telegram_among_noise(shell):
    assert shell("decode", "00 2e 03 02 04 80 6e e2 00", "--protocol", "modbus", port=None) == 0
    assert shell.out.splitlines() == [
        "       noise: 00",
        "modbus reply: read_registers address=46 function=3 values=[1152]",
        "       noise: 00",
    ]


def test_decode_names_the_likely_damage(shell):
    assert shell("decode", "01 03 02 6D 60 FC 94", "--protocol", "modbus", "-d", "reply", "--json", port=None) == 4
    assert shell.objects[0]["damage"] == "its two check bytes are in the wrong order"


def test_decode_exits_with_4_for_bytes_that_are_not_a_telegram(shell):
    assert shell("decode", "00 11 22", port=None) == 4
    assert "vabus request: refused (framing)" in shell.out
    assert shell("decode", "00 11 22", "--json", port=None) == 4
    assert shell.objects[0]["valid"] is False


def test_decode_refuses_text_that_is_not_hexadecimal(shell):
    assert shell("decode", "hello", port=None) == 2
    assert "is not hexadecimal" in shell.err


def test_encode_prints_the_telegram(shell):
    assert shell("encode", "vabus", "kind=enquiry", "address=1", "parameter=481", port=None) == 0
    assert shell.out == "04 41 30 30 34 38 31 05\n"


def test_encode_keeps_digits_of_a_text_field_as_text(shell):
    assert shell("encode", "vabus", "kind=select", "address=1", "parameter=410", "data=1234", "--json", port=None) == 0
    assert shell.objects[0]["data"].startswith("04 41 02 30 30 34 31 30 30 34 31 32 33 34 03")


@pytest.mark.parametrize(
    ("fields", "code"),
    [
        (["kind=enquiry", "address=31", "parameter=1"], 4),
        (["kind=enquiry", "parameter=1"], 4),
        (["kind"], 2),
        (["kind=nonsense"], 4),
        (["kind=enquiry", "address=[1,2]", "parameter=true"], 4),
    ],
)
def test_encode_refuses_invalid_fields_in_one_sentence(shell, fields, code):
    assert shell("encode", "vabus", *fields, port=None) == code
    assert shell.err.count("\n") == 1


def test_scan_lists_drives_of_all_protocols_and_starts_no_motor(shell):
    line = shell.line(*(virtual_drive(protocol, address) for address, protocol in enumerate(sorted(ALL), 3)))
    assert shell("scan", "--addresses", "1-8") == 0
    assert all(f"{protocol}:{address}" in shell.out for address, protocol in enumerate(sorted(ALL), 3))
    assert "4 drives found" in shell.out
    assert not any(drive.motor.running for drive in line.drives)


def test_scan_does_not_count_a_damaged_answer_as_a_drive(shell):
    shell.line(virtual_drive("modbus", 11, model="delta"))
    assert shell("scan", "--protocol", "huanyang", "--protocol", "modbus", "-a", "11") == 0
    assert "huanyang:11  answers, but damaged" in shell.out
    assert "1 drive found, 1 answer with damage only" in shell.out


def test_scan_of_one_protocol_prints_json(shell):
    shell.line()
    assert shell("scan", "--protocol", "vabus", "-a", "1,3-4", "--json") == 0
    assert [one["drive"] for one in shell.objects] == ["vabus:1"]


def test_scan_writes_two_ports_to_one_plant_file_and_adds_to_it(shell, tmp_path):
    shell.line(virtual_drive("vabus", 1))
    shell.lines["yard"] = VirtualLine([virtual_drive("vabus", 1), virtual_drive("fuji", 2)])
    path = tmp_path / "plant.toml"
    few = ("--protocol", "vabus", "-a", "1")
    assert shell("scan", "line", "yard", *few, "--write", str(path), port=None) == 0
    assert shell.out.splitlines()[-2:] == ["2 drives found", f"written to {path}"]
    assert [each.name for each in read_plant(path).drives] == ["line-vabus-1", "yard-vabus-1"]
    assert shell("scan", "yard", "--protocol", "fuji", "-a", "2", "--add", str(path), port=None) == 0
    assert shell.out.splitlines()[-1] == f"1 drive added to {path}: yard-fuji-2"
    assert len(read_plant(path).drives) == 3
    assert shell("scan", "yard", "--add", str(tmp_path / "none.toml"), port=None) == 2
    assert shell("scan", "yard", "--add", str(path), "--write", str(path), port=None) == 2


def test_scan_of_a_missing_port_prints_no_drive_count(shell):
    assert shell("scan", port="nowhere") == 3
    assert shell.out == ""


def test_scan_exits_with_1_if_no_drive_answers(shell):
    shell.line()
    assert shell("scan", "--protocol", "vabus", "-a", "7") == 1
    assert "0 drives found" in shell.out
    assert shell("scan", "-a", "seven") == 2


@pytest.mark.soak
def test_vectors_check_passes_for_an_installed_protocol(shell, monkeypatch):
    # Other tests check the vectors of the other protocols one by one.
    monkeypatch.setattr(type(installed), "working", lambda self: [self["vabus"]])
    assert shell("vectors", "check", port=None) == 0
    assert "vabus: " in shell.out


def test_vectors_check_takes_a_file_of_the_user(shell, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(
        'format = 2\nprotocol = "vabus"\n[[vector]]\nid = "mine"\nsource = "me"\nprinted = false\n'
        'direction = "reply"\nhex = "41 06"\nvalid = true\n[vector.fields]\nkind = "ack"\naddress = 1\n'
    )
    assert shell("vectors", "check", str(path), port=None) == 0
    path.write_text(path.read_text().replace("address = 1", "address = 2"))
    assert shell("vectors", "check", str(path), port=None) == 1
    assert "FAILED" in shell.out
    assert shell("vectors", "check", str(path), "--json", port=None) == 1
    path.write_text("format = 9")
    assert shell("vectors", "check", str(path), port=None) == 2
    assert str(path) in shell.err


class TestDemo:
    def toured(self, capsys, *flags):
        """Run the tour; return its exit code and its output.

        Nothing is replaced: the lines of the tour are virtual anyway, and its served plant listens at real sockets.
        """
        code = main(["demo", *flags])
        return code, capsys.readouterr().out

    @pytest.mark.soak
    def test_tour_works_and_ends_with_a_served_plant(self, capsys):
        code, printed = self.toured(capsys)
        assert code == 0
        assert "failed" not in printed
        assert re.search(r"\n(\d+) of \1 steps worked", printed)
        end = printed.partition("drivecomm serve\n")[2]
        assert re.search(r"GET /api/v1/drives/fan\n +dc_link_voltage \d+ V, ", end)
        assert re.search(r"GET /api/v1/events\n +fan: fault: 14 earth fault\n", end)

    @pytest.mark.soak
    def test_tour_leaves_the_served_plant_out_without_the_server_extra(self, capsys, monkeypatch):
        monkeypatch.setattr(served, "find_spec", lambda _: None)
        code, printed = self.toured(capsys)
        assert code == 0
        assert "left out without fastapi and uvicorn; install drivecomm[server]" in printed
        assert re.search(r"\n(\d+) of \1 steps worked", printed)

    @pytest.mark.soak
    def test_tour_prints_json(self, capsys):
        code, printed = self.toured(capsys, "--json")
        assert code == 0
        steps = [json.loads(line) for line in printed.splitlines()]
        assert all(step["ok"] for step in steps)
        assert len(steps) > 20

    @pytest.mark.soak
    def test_failed_step_fails_the_tour(self, capsys, monkeypatch):
        def deaf(protocol, address):
            drive = virtual_drive(protocol, address)
            drive.hear = lambda *_: None
            return drive

        monkeypatch.setattr(sites, "virtual_drive", deaf)
        code, printed = self.toured(capsys)
        assert code == 1
        assert "failed" in printed

    def test_demo_only_reads_on_a_given_line(self, shell):
        line = shell.line(virtual_drive("vabus", 2))
        sent = []
        transmit = line.transmit
        line.transmit = lambda data: (sent.append(data), transmit(data))
        assert shell("demo") == 0
        assert not any(data[2:3] == b"\x02" for data in sent if data[:1] == b"\x04"), "nothing is written"

    def test_demo_starts_the_motor_with_allow_motion(self, shell, monkeypatch):
        line = shell.line(virtual_drive("vabus", 2))
        monkeypatch.setattr(sites.time, "sleep", line.advance)
        assert shell("demo", "--allow-motion") == 0
        assert "forwards" in shell.out


class TestCommandLine:
    def test_version_flag_prints_the_version(self, shell):
        assert shell("--version", port=None) == 0
        assert shell.out == f"drivecomm {drivecomm.__version__}\n"

    def test_help_flag_lists_the_commands(self, shell):
        assert shell("--help", port=None) == 0
        assert "simulate" in shell.out

    def test_package_runs_as_a_module(self):
        done = subprocess.run(
            [sys.executable, "-m", "drivecomm", "--version"], capture_output=True, text=True, check=True
        )
        assert done.stdout == f"drivecomm {drivecomm.__version__}\n"

    def test_interrupted_command_exits_with_130(self, shell, monkeypatch):
        def interrupt(*_):
            raise KeyboardInterrupt

        shell.line()
        monkeypatch.setattr(VirtualLine, "receive", interrupt)
        assert shell("status", "vabus:1") == 130
        assert shell.err == "drivecomm: interrupted\n"

    def test_broken_pipe_is_not_an_error(self, shell, monkeypatch):
        def gone(*_):
            raise BrokenPipeError

        shell.line()
        monkeypatch.setattr(VirtualLine, "receive", gone)
        assert shell("status", "vabus:1") == 0

    @pytest.mark.parametrize("group", [(), ("models",), ("plant",), ("users",), ("vectors",)])
    def test_command_group_without_a_command_prints_only_its_usage(self, shell, group):
        assert shell(*group, port=None) == 2
        assert f"Usage: {' '.join(('drivecomm', *group))} [OPTIONS] COMMAND" in shell.out
        assert shell.err == ""

    @pytest.mark.parametrize(
        ("arguments", "sentence"),
        [
            (
                ["plant", "trip", "exhaust", "OC1"],
                "invalid CODE 'OC1'; write a whole number (see drivecomm plant trip",
            ),
            (["read", "vabus:1", "481", "--baudrate", "fast"], "invalid --baudrate 'fast'; write a whole number"),
            (["poll", "vabus:1", "481", "--for", "ever"], "invalid --for 'ever'; write a number"),
        ],
    )
    def test_argument_that_is_not_a_number_is_refused_in_words(self, shell, arguments, sentence):
        assert shell(*arguments, "--json", port=None) == 2
        assert sentence in shell.err
        assert shell.objects[0]["exit_code"] == 2

    def test_operating_system_error_is_printed_as_one_sentence(self, shell, monkeypatch):
        def full(*_):
            raise OSError(errno.ENOSPC, "No space left on device", "values.csv")

        shell.line()
        monkeypatch.setattr(VirtualLine, "receive", full)
        assert shell("status", "vabus:1") == 1
        assert shell.err == "drivecomm: values.csv: No space left on device\n"

    def test_programming_error_is_not_hidden(self, shell, monkeypatch):
        def broken(*_):
            raise ZeroDivisionError

        shell.line()
        monkeypatch.setattr(VirtualLine, "receive", broken)
        with pytest.raises(ZeroDivisionError):
            main(["status", "vabus:1", "--port", "line"])


def test_every_listed_command_loads_and_has_the_listed_help():
    for name, command in app.commands.items():
        for each in getattr(command, "commands", {name: command}).values():
            assert each.help.endswith(".")
            assert each.loaded.callback is not None
            assert each.loaded.help.startswith(each.help.removesuffix(".")), "what the list says, the help says, too"


@pytest.mark.parametrize("call", [["--help"], []])
def test_list_of_commands_shows_whole_sentences_in_80_columns(capsys, monkeypatch, call):
    monkeypatch.setenv("COLUMNS", "80")
    assert main(call) == (0 if call else 2)
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    text = " ".join(" ".join(lines).split())
    for name, (_, what) in COMMANDS.items():
        assert " " in name or f" {name} {what}" in text


@pytest.mark.parametrize("variable", ["XDG_STATE_HOME", "XDG_RUNTIME_DIR"])
def test_serve_exits_with_2_if_its_folder_cannot_be_used(shell, tmp_path, monkeypatch, variable):
    (tmp_path / "drivecomm").write_text("a file where a folder should be", encoding="utf-8")
    plant = tmp_path / "plant.toml"
    plant.write_text('format = 1\n[[line]]\nname = "hall"\nport = "hall"\n[[drive]]\ndrive = "vabus:1"\n', "utf-8")
    monkeypatch.setenv(variable, str(tmp_path))
    assert shell("serve", str(plant), port=None) == 2
    assert f"{tmp_path / 'drivecomm'}" in shell.err
    assert shell.err.splitlines()[-1].endswith(
        ("cannot be used: Not a directory; make it usable for this user, or name another place",
         "cannot be used: File exists; make it usable for this user, or name another place")
    )  # fmt: skip
