"""Planted mistakes for the search over the server: each removes a protection that stops a motor.

    python tests/adversary/planted_mistakes.py --scripts 300

prints for each mistake the number of scripts after which it is found.
"""

import argparse
import subprocess
import sys
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

CAMPAIGN = Path(__file__).with_name("server_campaign.py")


def _put(owner, name, value):
    """Replace an attribute by a faulty one."""
    assert hasattr(owner, name), f"{owner.__name__} has no {name} any more; plant the mistake elsewhere"
    setattr(owner, name, value)


def leases_never_expire():
    from drivecomm.server.leases import Leases

    _put(Leases, "expire", lambda *_, **__: [])


def lapsed_leases_are_ignored():
    from drivecomm.server.kept_motors import KeptMotors

    _put(KeptMotors, "lease_expired", lambda *_: None)


def leases_given_back_are_ignored():
    from drivecomm.server.kept_motors import KeptMotors

    _put(KeptMotors, "given_back", lambda *_: None)


def a_repeated_order_is_carried_out_again():
    from drivecomm.server.repeats import AnswerCache

    async def once(_, caller, command, begin):
        del caller, command
        return await begin()

    _put(AnswerCache, "once", once)


def every_start_is_with_the_policy_hold():
    import drivecomm.server.commands as module

    before = module.keep_settings_of

    def keep_order(*given, **further):
        order = before(*given, **further)
        return order if order is None else replace(order, policy="hold")

    _put(module, "keep_settings_of", keep_order)


def what_the_broker_kept_is_obeyed():
    import drivecomm.server.broker.connection as module

    before = module.ReceivedMessage

    def received(**given):
        return before(**{**given, "retained": False})

    _put(module, "ReceivedMessage", received)


def old_commands_are_fresh():
    import drivecomm.server.commands as module

    _put(module, "check_fresh", lambda *_, **__: None)


def a_changed_plant_keeps_its_motors():
    from drivecomm.server.kept_motors import KeptMotors

    before = KeptMotors.release_all

    async def release_all(self, drives=None):
        if drives is None:
            await before(self)

    _put(KeptMotors, "release_all", release_all)


def a_stop_that_was_not_confirmed_is_called_done():
    from drivecomm.bus import AsyncDrive
    from drivecomm.errors import DriveCommError

    before = AsyncDrive.stop

    async def stop(self, *given, **further):
        with suppress(DriveCommError):
            return await before(self, *given, **further)

    _put(AsyncDrive, "stop", stop)


def a_stop_goes_to_the_first_drive_of_the_line():
    from drivecomm.server.served_line import ServedLine

    before = ServedLine.drive

    def drive(self, name):
        del name
        return before(self, self.drives[0].name)

    _put(ServedLine, "drive", drive)


def stop_all_stops_the_first_line():
    from drivecomm.server.commands import CommandExecutor

    before = CommandExecutor.stop_all

    async def stop_all(self, caller, how, lines=()):
        return await before(self, caller, how, lines or tuple(self._core.lines)[:1])

    _put(CommandExecutor, "stop_all", stop_all)


def a_stop_that_was_not_confirmed_is_forgotten():
    from drivecomm.server.standing_stops import StandingStops

    _put(StandingStops, "stand", lambda *_: None)


def a_stop_that_stands_in_an_image_is_an_event():
    from drivecomm.server.stop_demands import StopDemands

    _put(StopDemands, "check", lambda *_: None)
    _put(StopDemands, "seen", lambda *_, **__: None)


def a_host_that_is_offline_is_online():
    import drivecomm.server.sparkplug.session as module

    before = module.host_message

    def host_message(payload):
        message = before(payload)
        return message if message is None else replace(message, online=True)

    _put(module, "host_message", host_message)


def watchdogs_are_not_set():
    import drivecomm.bus.keeper as module

    def nothing(*_):
        return None
        yield

    _put(module, "setting_watchdog", nothing)


def who_looks_may_not_stop():
    import drivecomm.server.rights as module
    from drivecomm.server import Role

    module.NEEDS["stop"] = replace(module.NEEDS["stop"], role=Role.OPERATE)


def a_plc_that_stops_is_not_heard():
    from drivecomm.server.modbus_tcp.commanding import RegisterCommander

    _put(RegisterCommander, "_take_stop", lambda *_: None)


def what_failed_to_be_read_is_as_before():
    import drivecomm.server.served_line as module

    before, known = module.new_value, {}

    def new_value(**given):
        key = given["drive"], given["name"]
        if given["reading"] is not None:
            known[key] = given["reading"]
        elif key in known:
            as_new = replace(known[key], time_s=given["time_s"])
            given = {**given, "reading": as_new, "quality": "good", "cause": ""}
        return before(**given)

    _put(module, "new_value", new_value)


MISTAKES = {
    name: made
    for name, made in list(globals().items())
    if callable(made) and getattr(made, "__module__", "") == __name__ and not name.startswith("_")
}


def plant(name):
    """Plant a mistake in this process."""
    MISTAKES[name]()


def found_after(name, seed, scripts):
    """Return the number of scripts after which a mistake is found, and the failure; None if it is not."""
    words = [sys.executable, str(CAMPAIGN), "--plant", name, "--seed", seed, "--scripts", str(scripts)]
    done = subprocess.run(
        [*words, "--until-found", "--plain", "--at-once", "1"], capture_output=True, text=True, check=False
    )
    lines = [each for each in done.stdout.splitlines() if each.startswith("script ")]
    return (int(lines[0].split()[1].rstrip(":")) + 1, lines[0]) if lines else None


def main():
    words = argparse.ArgumentParser()
    words.add_argument("--scripts", type=int, default=300)
    words.add_argument("--seed", default="planted")
    words.add_argument("--only", action="append")
    given = words.parse_args()
    missed = []
    for name in given.only or MISTAKES:
        found = found_after(name, given.seed, given.scripts)
        print(f"{name:<48}{'not found' if found is None else f'{found[0]:>4}  {found[1]}'}", flush=True)
        missed += [name] if found is None else []
    sys.exit(1 if missed else 0)


if __name__ == "__main__":
    main()
