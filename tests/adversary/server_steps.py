"""Steps of random scripts over a server: orders at all doors, and disturbances of the server and its lines."""

from server_bench import DRIVES

_PAUSES = (0.0, 0.05, 0.3, 0.3, 1.0, 1.0, 2.5, 6.0)
_SECONDS = (0.5, 2.0, 5.0, 12.0)
_HOWS = ("ramp", "ramp", "coast", "quick")


def random_steps(chance, kinds):
    """Return 4 to 18 steps as (pause, step, arguments)."""
    able = [each for each in STEPS if _is_able(each, kinds)]
    weights = [WEIGHTS.get(each, 2) for each in able]
    patterns = [each for each in PATTERNS if all(_is_able(what, kinds) for _, what, _ in each)]
    favourite, many = chance.choice(list(DRIVES)), chance.randrange(4, 19)
    steps = []
    while len(steps) < many:
        drive = favourite if chance.random() < 0.6 else chance.choice(list(DRIVES))
        if chance.random() < _PATTERN_SHARE:
            steps += [_step(chance, drive, *each) for each in chance.choice(patterns)]
        else:
            steps.append(_step(chance, drive, chance.choice(_PAUSES), chance.choices(able, weights)[0], {}))
    return steps


def _is_able(what, kinds):
    return DOOR_OF.get(what, "http") in kinds


def _step(chance, drive, pause, what, given):
    return [pause, what, {name: make(chance, drive) for name, make in STEPS[what].items()} | given]


def _drive(_, drive):
    return drive


def _line_of(_, drive):
    return DRIVES[drive][0]


def _of(*values):
    return lambda chance, _: chance.choice(values)


_KEPT = {"drive": _drive, "lease_s": _of(1.0, 2.0, 4.0), "there_s": _of(0.0, 3.0, 8.0, 20.0)}
STEPS = {
    "http_start": _KEPT,
    "http_start_twice": _KEPT,
    "http_start_loosely": {
        "drive": _drive,
        "lease_s": _of(0, 2.0),
        "policy": _of("hold"),
        "watchdog_s": _of(None, 600),
    },
    "http_start_watchdog": {**_KEPT, "watchdog_s": _of(0.5, 600)},
    "http_start_alone": {"drive": _drive},
    "http_stop": {"drive": _drive, "how": _of(*_HOWS), "leaves": _of(False, False, True)},
    "http_stop_all": {},
    "http_reference": {"drive": _drive, "percent": _of(20, 80)},
    "http_flood": {"drive": _drive, "count": _of(10, 20)},
    "local_start": {"drive": _drive},
    "local_stop": {"drive": _drive},
    "local_stop_all": {},
    "mqtt_start": _KEPT,
    "mqtt_start_loosely": {
        "drive": _drive,
        "lease_s": _of(0, 2.0),
        "policy": _of("hold"),
        "watchdog_s": _of(None, 600),
    },
    "mqtt_start_kept": {"drive": _drive},
    "mqtt_replay": {},
    "mqtt_stop": {"drive": _drive, "how": _of(*_HOWS)},
    "mqtt_stop_all": {},
    "sparkplug_online": {"ahead_s": _of(0.0, 0.0, 3600.0)},
    "sparkplug_offline": {},
    "sparkplug_start": {"drive": _drive},
    "sparkplug_stop": {"drive": _drive},
    "modbus_start": {"drive": _drive},
    "modbus_stop": {"drive": _drive, "standing": _of(True, True, False)},
    "modbus_leave": {"drive": _drive},
    "opcua_start": {"drive": _drive, "there_s": _of(1.0, 6.0)},
    "opcua_stop": {"drive": _drive},
    "line_away": {"line": _line_of, "seconds": _of(*_SECONDS)},
    "requests_lost": {"line": _line_of, "seconds": _of(*_SECONDS)},
    "replies_lost": {"line": _line_of, "seconds": _of(*_SECONDS)},
    "noise": {
        "line": _line_of,
        "seconds": _of(*_SECONDS),
        "rate": _of(0.2, 0.5),
        "kind": _of("corrupt", "drop", "truncate", "duplicate"),
    },
    "power_cut": {"drive": _drive, "seconds": _of(*_SECONDS)},
    "trip": {"drive": _drive},
    "broker_cut": {},
    "broker_away": {"seconds": _of(*_SECONDS)},
    "wall_clock": {"seconds": _of(-3600, -3.0, 1.5, 30.0, 86400)},
    "disk_full": {"seconds": _of(*_SECONDS)},
    "descriptors_gone": {"seconds": _of(*_SECONDS)},
    "reload": {"change": _of("title", "poll", "half", "away", "none")},
    "remove": {"drive": _drive, "seconds": _of(*_SECONDS)},
    "server_ends": {"pause": _of(0.0, 3.0)},
    "server_killed": {"pause": _of(0.0, 3.0)},
}
_STAYS, _SILENT = {"lease_s": 4.0, "there_s": 8.0}, {"seconds": 5.0}
PATTERNS = (
    # Orders are repeated after they were carried out, by the same or another client.
    [(1.0, "http_start_twice", {"lease_s": 4.0, "there_s": 3.0}), (1.0, "http_stop", {})],
    [(1.0, "mqtt_start", {"lease_s": 4.0, "there_s": 0.0}), (1.0, "mqtt_stop", {}), (6.0, "mqtt_replay", {})],
    [(0.3, "mqtt_start_kept", {}), (0.3, "broker_cut", {})],
    [(0.3, "mqtt_start_kept", {}), (0.3, "server_killed", {"pause": 0.0})],
    # A motor runs, its line falls silent, and the motor is stopped.
    [(1.0, "http_start", _STAYS), (1.0, "requests_lost", _SILENT), (0.3, "http_stop", {})],
    [(1.0, "local_start", {}), (1.0, "power_cut", {"seconds": 2.0}), (0.3, "local_stop", {})],
    [(1.0, "local_start", {}), (1.0, "line_away", _SILENT), (0.3, "mqtt_stop", {})],
    [(1.0, "local_start", {}), (1.0, "replies_lost", _SILENT), (0.3, "http_stop_all", {})],
    # A stop stands while other clients request a start.
    [(0.3, "modbus_stop", {"standing": True}), (1.0, "mqtt_start", _STAYS), (1.0, "local_start", {})],
    [(0.3, "requests_lost", _SILENT), (0.3, "modbus_stop", {"standing": True}), (1.0, "http_start", _STAYS)],
    # A commander disappears.
    [(0.3, "sparkplug_online", {"ahead_s": 0.0}), (1.0, "sparkplug_start", {}), (1.0, "sparkplug_offline", {})],
    [(0.3, "modbus_start", {}), (2.5, "modbus_leave", {})],
    [(1.0, "http_start", _STAYS), (1.0, "remove", {"seconds": 5.0})],
    [(1.0, "http_start", _STAYS), (1.0, "server_killed", {"pause": 3.0})],
    # All running motors are stopped together.
    [(0.3, "local_start", {"drive": "saw"}), (0.0, "local_start", {"drive": "pump"}), (1.0, "http_stop_all", {})],
)
"""Sequences of orders that rarely occur by chance."""
_PATTERN_SHARE = 0.12
DOOR_OF = {
    each: "modbus-tcp" if each.startswith("modbus") else each.partition("_")[0]
    for each in STEPS
    if each.partition("_")[0] in {"mqtt", "sparkplug", "modbus", "opcua"}
}
DOOR_OF |= {"broker_cut": "mqtt", "broker_away": "mqtt"}
WEIGHTS = {
    "http_start": 6,
    "mqtt_start": 4,
    "http_stop": 5,
    "mqtt_stop": 3,
    "local_start": 3,
    "modbus_start": 4,
    "modbus_stop": 4,
}
WEIGHTS |= {"sparkplug_online": 4, "sparkplug_start": 4, "opcua_start": 5, "opcua_stop": 3, "requests_lost": 3}
WEIGHTS |= {
    "server_ends": 0.4,
    "server_killed": 0.7,
    "reload": 1,
    "remove": 1,
    "disk_full": 1,
    "descriptors_gone": 0.5,
    "wall_clock": 1,
}
