"""Line flags of all commands: each takes effect or is refused, whatever the plant file says about a drive."""

from dataclasses import fields

import pytest
from extents import every

import drivecomm.bus.bus
import drivecomm.bus.opening
import drivecomm.cli.replay
from drivecomm.cli.app import app
from drivecomm.cli.line_options import WITHOUT_EFFECT, LineArguments
from drivecomm.plant import read_plant
from drivecomm.traffic.replay import ReplayMaster
from drivecomm.virtual import VirtualPlant

PLANT = """
format = 1

[[line]]
name = "hall"
port = "HALL"
baudrate = 9600
parity = "E"

[[drive]]
name = "fan"
drive = "danfoss-fc:3"
options = { model = "fc300", baudrate = 9600, bytesize = 8, parity = "E", stopbits = 1, attempts = 2 }
poll = [{ parameters = ["3-41"] }]
"""

FACTS = {"baudrate": "19200", "bytesize": "7", "parity": "o", "stopbits": "2", "timeout": "0.2", "attempts": "1"}
VALUES = {
    **FACTS,
    "port": "OTHER",
    "echo": "auto",
    "rs485": None,
    "low_latency": None,
    "trace": None,
    "record": "heard.jsonl",
    "plant": "other.toml",
    "arm": None,
}
COMMANDS = [
    ("read", "fan", "3-41"),
    ("status", "fan"),
    ("status",),
    ("write", "fan", "3-41", "5"),
    ("reset", "fan"),
    ("reference", "fan", "10%"),
    ("call", "fan", "jog"),
    ("wait", "fan", "ready", "--seconds", "0"),
    ("start", "fan", "--link-loss", "hold"),
    ("stop", "fan"),
    ("stats", "fan", "--for", "0.1"),
    ("poll", "fan", "3-41", "--cycles", "1"),
    ("poll", "--cycles", "1"),
    ("poll", "--plan", "plant.toml", "--cycles", "1"),
    ("forecast", "fan", "3-41"),
    ("forecast", "--plan", "plant.toml"),
    ("scan", "--protocol", "danfoss-fc", "--addresses", "3"),
    ("doctor", "--protocol", "danfoss-fc", "--addresses", "3"),
    ("tune", "fan", "--exchanges", "20"),
    ("prove", "fan", "--write", "proof.toml", "--force"),
    ("models", "grow", "fan", "--write", "grown.toml"),
    ("replay", "capture.jsonl"),
    ("stop", "--all"),
    ("restore", "fan", "kept.toml", "--dry-run"),
    ("backup", "fan", "fan.toml"),
    ("compare", "fan", "factory"),
    ("replace", "fan", "kept.toml", "--yes"),
    ("report", "fan"),
    ("baseline", "accept", "fan"),
    ("drift", "fan"),
    ("drift",),
]
# Commands whose output also shows the effect of a flag; on virtual lines it is the same in each run.
WITH_VISIBLE_EFFECT = ("doctor", "forecast")


@pytest.fixture
def heard(shell, tmp_path, monkeypatch):
    """Return a function that runs a command and gives its exit code and the lines, scans and drives that it opened."""
    monkeypatch.delenv("DRIVECOMM_PLANT", raising=False)
    monkeypatch.chdir(tmp_path)
    for name in ("plant.toml", "other.toml"):
        (tmp_path / name).write_text(
            PLANT
            if name == "plant.toml"
            else PLANT.replace('"fan"', '"mill"').replace("fc:3", "fc:4").replace("HALL", "OTHER")
        )
    seen = []
    opened, drive = drivecomm.bus.bus.open_bus, drivecomm.bus.bus.Bus.drive

    def open_bus(port, **opening):
        seen.append((port, sorted((key, str(value)) for key, value in opening.items() if key != "trace")))
        seen.append(opening.get("trace") is not None)
        return opened(port, **opening)

    def made(bus, *place, **options):
        found = drive(bus, *place, **options)
        seen.append((found, place))
        return found

    scan, opener = drivecomm.bus.bus.Bus.scan, drivecomm.bus.opening.port_opener

    def scanned(bus, *which, **how):
        seen.append((which, sorted((key, str(value)) for key, value in how.items() if not callable(value))))
        return scan(bus, *which, **how)

    def port_opener(port, **how):
        seen.append((str(port), sorted((key, str(value)) for key, value in how.items())))
        return opener(port, **how)

    def asking(found, plugins, **how):
        seen.append(sorted((key, str(value)) for key, value in how.items()))
        return ReplayMaster(found, plugins, **how)

    monkeypatch.setattr(drivecomm.cli.replay, "ReplayMaster", asking)
    monkeypatch.setattr(drivecomm.bus.bus.Bus, "scan", scanned)
    for place in (drivecomm.bus, drivecomm.bus.opening):
        monkeypatch.setattr(place, "port_opener", port_opener)
    for place in (drivecomm.bus, drivecomm.bus.bus):
        monkeypatch.setattr(place, "open_bus", open_bus)
    monkeypatch.setattr(drivecomm.bus.bus.Bus, "drive", made)

    def run(*call):
        seen.clear()
        line = VirtualPlant(read_plant(tmp_path / "plant.toml")).line("hall")
        shell.lines.update({"HALL": line, "OTHER": line})
        if "capture.jsonl" in call and not (tmp_path / "capture.jsonl").exists():
            shell("read", "fan", "3-41", "--record", "capture.jsonl", port=None)
        if "kept.toml" in call and not (tmp_path / "kept.toml").exists():
            shell("backup", "fan", "kept.toml", port=None)
        if call[0] == "drift" and not (tmp_path / "baselines").exists():
            shell("baseline", "accept", "fan", port=None)
        seen.clear()
        code = shell(*call, port=None)
        told = [
            (each[0].facts, each[0].read_only_reason, each[1]) if isinstance(each[0], drivecomm.bus.Drive) else each
            for each in (each if isinstance(each, tuple) else (each,) for each in seen)
        ]
        return code, [*told, shell.out, shell.err] if call[0] in WITH_VISIBLE_EFFECT else told

    return run


def test_table_of_values_has_every_line_flag():
    assert {field.name for field in fields(LineArguments)} - {"json", "given", "stops"} == set(VALUES)


def test_table_of_commands_has_every_command_with_line_options():
    with_line = {
        " ".join(words)
        for words, command in commands_of(app)
        if {"rs485", "attempts"} <= {option.name for option in command.loaded.params}
    }
    tried = {" ".join(call[: 2 if call[0] in ("models", "baseline") else 1]) for call in COMMANDS}
    # demo plays for minutes and watch needs a terminal; their own tests try their flags.
    assert with_line - {"demo", "watch"} == tried


def commands_of(group, *words):
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands_of(command, *words, name)
        else:
            yield (*words, name), command


@pytest.mark.parametrize("flag", VALUES)
@pytest.mark.parametrize("command", every(6, COMMANDS), ids=" ".join)
def test_line_flag_takes_effect_or_is_refused(heard, shell, command, flag):
    _, plain = heard(*command)
    value = [] if VALUES[flag] is None else [VALUES[flag]]
    code, changed = heard(*command, f"--{flag.replace('_', '-')}", *value)
    if changed == plain and command[0] != "stop":
        assert code == 2
        assert shell.err.count("\n") == 1
        refused = ("has no effect", "leave --port OTHER out", "no drive 'fan' in this plant", "this plant has several")
        assert any(words in shell.err for words in refused), shell.err


@pytest.mark.parametrize(
    "command", [("read", "fan", "3-41"), ("status",), ("poll", "--cycles", "1"), ("stop", "--all")]
)
@pytest.mark.parametrize(("flag", "value", "fact"), [("baudrate", "19200", 19200), ("stopbits", "2", 2)])
def test_command_line_overrides_the_plant_file(heard, command, flag, value, fact):
    _, seen = heard(*command, f"--{flag}", value)
    facts = [each[0] for each in seen if isinstance(each, tuple) and hasattr(each[0], "settings")]
    assert facts
    assert all(getattr(each.settings, flag) == fact for each in facts)


@pytest.mark.parametrize(
    ("said", "sentence"),
    [
        ("--baudrate=0", "a baud rate of 0 is not between 50 and 4000000"),
        ("--parity=X", "parity 'X' is not one of N, E, O, M, S"),
        ("--stopbits=3", "3.0 stop bits are not possible"),
        ("--bytesize=9", "9 data bits are not possible"),
        ("--timeout=0", "--timeout of 0 leaves no time for a reply"),
        ("--timeout=nan", "invalid --timeout = nan"),
        ("--attempts=0", "--attempts of 0 would never send anything"),
    ],
)
@pytest.mark.parametrize("command", [("read", "fan", "3-41"), ("read", "danfoss-fc:9", "3-41", "--port", "OTHER")])
def test_invalid_flag_value_is_refused(heard, shell, command, said, sentence):
    assert heard(*command, said)[0] == 2
    assert sentence in shell.err
    assert shell.err.count("\n") == 1


def test_setting_given_twice_is_refused(heard, shell):
    assert heard("read", "fan,baudrate=9600", "3-41", "--baudrate", "19200")[0] == 2
    assert "exclude each other" in shell.err
    assert heard("reference", "fan", "10%", "--percent", "20", "--arm")[0] == 2
    assert "exclude each other" in shell.err


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (("status", "--model", "fc300"), "--model is for one drive"),
        (("poll", "--period", "2", "--cycles", "1"), "--period has no effect"),
        (("poll", "--plan", "plant.toml", "--plant", "other.toml"), "--plant has no effect"),
        (("demo", "--baudrate", "9600"), "--baudrate has no effect"),
        (("demo", "--allow-motion"), "--allow-motion has no effect"),
        (("replay", "capture.jsonl", "--arm"), "without --commands nothing is commanded, so --arm has no effect"),
        (("forecast", "--trace"), "forecast opens no port, so --trace has no effect"),
        (("read", "fan", "3-41", "--arm"), "read does not command a drive, so --arm has no effect"),
        (("write", "danfoss-fc:9", "3-41", "5", "--port", "OTHER", "--arm"), "--arm has no effect"),
        (("compare", "plant.toml", "other.toml", "--port", "OTHER"), "no drive is read, so --port has no effect"),
        (("demo", "--port", "HALL", "--allow-motion"), "fan is read-only in plant.toml"),
    ],
)
def test_flag_without_effect_is_refused(heard, shell, call, sentence):
    assert heard(*call)[0] == 2
    assert sentence in shell.err
    assert shell.err.count("\n") == 1


@pytest.mark.soak
def test_help_hides_the_arm_flag_where_it_has_no_effect(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    for command in WITHOUT_EFFECT:
        drivecomm.cli.main(["models", "grow", "--help"] if command == "grow" else [command, "--help"])
        assert "--arm" not in capsys.readouterr().out or command == "replay"


def test_help_wraps_lines_at_the_terminal_width(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    drivecomm.cli.main(["scan", "--help"])
    assert "or with several values for a setting" in " ".join(capsys.readouterr().out.split())
    drivecomm.cli.main(["simulate", "--help"])
    shown = capsys.readouterr().out.splitlines()
    assert not any(line.strip() and len(line.rstrip()) < 30 and not line.startswith("Usage") and
                   not line.rstrip().endswith((".", ":")) for line in shown)  # fmt: skip
