"""Random scripts of command lines with their times and disturbances; the same seed gives the same script."""

from simulated_plant import DRIVES, LINES, REACHED, WRITABLE

SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGKILL")
STOPPING = ("SIGINT", "SIGTERM", "SIGHUP")
# Keepers feed the watchdog several times in this time, even on a busy machine.
WATCHDOG_S = 1.5
POLICIES = {"vabus": ("trip",), "danfoss-fc": ("ramp", "trip"), "fuji": ("trip",), "vlt3500": ()}
_IN_PEACE = {"stdout": "file", "signals": [], "spawned": False, "largest": None}
KINDS = {
    "start": 7,
    "keep": 5,
    "stop": 7,
    "stop protocol": 1,
    "stop all": 2,
    "status": 1,
    "read": 1,
    "write": 3,
    "reference": 3,
    "reset": 2,
    "poll": 2,
    "watch": 1,
    "sniff": 1,
    "scan": 1,
    "backup": 2,
    "restore": 2,
    "doctor": 1,
    "wait": 1,
    "coast": 1,
}


def script(chance, ports):
    """Return the events of a script in order, as (pause, what, how); what: `command`, or a disturbance.

    A command with `waits` starts when the previous one has ended or keeps its drive; others start immediately. The end
    of a disturbance is part of it: `later`, after so many seconds.
    """
    line = chance.choice(list(LINES))
    focus = chance.sample(list(LINES[line]), chance.choice((1, 1, 2)))
    happens = []
    commands = 0
    patient = chance.choice((0.2, 0.5, 0.8, 1.0))
    if chance.random() < 0.15:
        saved = _command(chance, "backup", focus[0], ports) | _IN_PEACE
        happens.append((0, "command", {**saved, "waits": False}))
    while commands < chance.choice((4, 5, 6, 7, 8)):
        pause = chance.choice((0.0, 0.02, 0.1, 0.3, 0.5, 0.8))
        if chance.random() < 0.16:
            happens.append((pause, *_disturbance(chance, line, focus)))
            continue
        drive = chance.choice(focus) if chance.random() < 0.85 else chance.choice(list(DRIVES))
        kind = chance.choices(list(KINDS), list(KINDS.values()))[0]
        # Programs run concurrently, or one after the other.
        waits = chance.random() < patient
        happens.append((pause, "command", {**_command(chance, kind, drive, ports), "waits": waits}))
        commands += 1
    return happens


def _disturbance(chance, line, focus):
    what = chance.choice(("vanish", "vanish", "silence", "trip", "power", "fault"))
    later = chance.choice((0.05, 0.3, 1.0))
    if what == "vanish":
        return what, {"line": line, "later": (later, "come_back", {"line": line})}
    if what == "silence":
        return what, {"later": (later, "wake", {})}
    drive = chance.choice(focus)
    if what == "trip":
        return what, {"drive": drive, "code": 5}
    if what == "power":
        return what, {"drive": drive, "state": "off", "later": (later, what, {"drive": drive, "state": "on"})}
    kind = chance.choice(("drop", "corrupt", "duplicate", "delay"))
    text = f"line = '{line}'\nkind = '{kind}'\nrate = 0.3\nseed = {chance.randrange(1000)}\n"
    return what, {"text": text + ("delay_s = 0.2\n" if kind == "delay" else ""), "lasts": 3}


def _command(chance, kind, drive, ports):
    line, at, _ = DRIVES[drive]
    protocol = at.partition(":")[0]
    plant = ("--plant", "plant.toml")
    told = {"kind": kind, "drive": drive}
    if kind == "keep" and not POLICIES[protocol]:
        told["kind"] = kind = "start"
    number = chance.randrange(100)
    if kind in {"start", "keep"}:
        told["percent"] = chance.randrange(20, 100, 10)
        told["policy"] = "hold" if kind == "start" else chance.choice(POLICIES[protocol])
        words = ["start", drive, *plant, "--link-loss", told["policy"], "--percent", str(told["percent"])]
        words += ["--watchdog", str(_watchdog(protocol))] if kind == "keep" else []
        words += ["--reverse"] if chance.random() < 0.2 else []
    elif kind == "write":
        parameter, how, _ = WRITABLE[protocol]
        told["value"] = chance.randrange(5, 40)
        words = ["write", drive, parameter, str(told["value"]), *how, *plant]
        words += ["--read-back"] if chance.random() < 0.3 else []
    elif kind == "reference":
        told["percent"] = chance.randrange(20, 100, 10)
        words = ["reference", drive, "--percent", str(told["percent"]), *plant]
    elif kind == "poll":
        words = ["poll", drive, WRITABLE[protocol][0], "--period", "0.05", "--for", "1.5", *plant]
        words += ["--log", f"log-{number}.csv"] if chance.random() < 0.5 else []
        words += ["--record", f"record-{number}.jsonl"] if chance.random() < 0.3 else []
    else:
        words = {
            "stop": ["stop", drive, *plant],
            "coast": ["stop", drive, "--how", "coast", *plant],
            "stop protocol": ["stop", f"{protocol}:*", "--port", ports[line]],
            "stop all": ["stop", "--all", *plant],
            "status": ["status", *plant, *([drive] if chance.random() < 0.5 else [])],
            "read": ["read", drive, WRITABLE[protocol][0], *plant],
            "reset": ["reset", drive, *plant],
            "watch": ["watch", "plant.toml", "--for", "1"],
            "sniff": ["sniff", ports[line], "--for", "1"],
            "scan": ["scan", "--port", ports[line], "-a", "1-9", "--protocol", protocol, "--write", f"s{number}.toml"],
            "backup": ["backup", drive, f"{drive}.toml", *plant],
            "restore": ["restore", drive, f"{drive}.toml", *plant, *(["--volatile"] if protocol != "fuji" else [])],
            "doctor": ["doctor", ports[line], "--quick", "--protocol", protocol],
            "wait": ["wait", drive, chance.choice(("ready", "running")), "--seconds", "1", *plant],
        }[kind]
    told["kind"] = "stop" if kind == "coast" else kind
    return {**told, "words": words, **_disturbed(chance, kind)}


def _watchdog(protocol):
    return 2 if protocol in {"vabus", "fuji"} else WATCHDOG_S


def _disturbed(chance, kind):
    """Return the disturbance of a command by signals, its output or the disk; most commands get none."""
    told = {"stdout": "file", "signals": [], "spawned": chance.random() < 0.1}
    if chance.random() < 0.3:
        first = chance.choice((0.0, 0.02, 0.1, 0.3, 0.8)) * chance.random() * 2
        told["signals"].append((first, chance.choice(SIGNALS)))
        if chance.random() < 0.2:
            told["signals"].append((first + chance.random(), chance.choice(SIGNALS)))
    if chance.random() < 0.2:
        told["stdout"] = chance.choice(("gone", "leaves", "full", "closed"))
        told["reads_s"] = chance.random()
    if chance.random() < (0.4 if kind in {"poll", "backup", "scan", "watch"} else 0.05):
        told["largest"] = chance.choice((0, 100, 700, 3000))
    return told


assert set(REACHED) == set(LINES)
