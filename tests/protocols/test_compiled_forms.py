"""Compiled forms, which read and write the same as the declared schemas for any field values.

The conformance checks use vectors and valid messages; here the fields have any type and size.
"""

from functools import lru_cache

import pytest
from extents import extents
from hypothesis import HealthCheck, given, settings, strategies as st

from drivecomm.errors import DriveCommError, TelegramError
from drivecomm.protocol import installed
from drivecomm.testing import junk_fields, telegrams

BOTH = [(name, direction) for name in ("vabus", "danfoss-fc", "vlt3500", "fuji") for direction in ("request", "reply")]
every_direction = pytest.mark.parametrize(("name", "direction"), BOTH)
UNHURRIED = settings(
    derandomize=True,
    deadline=None,
    database=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)


@lru_cache
def junk_for(name, direction):
    return junk_fields(installed[name], direction)


@lru_cache
def telegrams_for(name, direction):
    return telegrams(installed[name], direction)


def outcome(function, given):
    try:
        return function(given)
    except TelegramError as error:
        return (error.category, error.field, str(error))


def in_code(form, message):
    try:
        return form.build_compiled(message)
    except Exception:  # noqa: BLE001 - compiled code may refuse with any exception
        return None


@every_direction
@extents(20, 150)
def test_compiled_form_builds_any_fields_as_the_declared_form(name, direction, extent):
    plugin = installed[name]

    @settings(UNHURRIED, max_examples=extent)
    @given(data=st.data())
    def alike(data):
        try:
            message = plugin.message(data.draw(junk_for(name, direction)), direction)
        except DriveCommError:
            return
        for form in plugin.forms().values():
            if form.message is not type(message):
                continue
            declared = outcome(form.build_declared, message)
            assert in_code(form, message) in (None, declared)
            assert outcome(form.build, message) == declared

    alike()


@every_direction
@extents(20, 150)
def test_compiled_form_parses_a_changed_byte_as_the_declared_form(name, direction, extent):
    @settings(UNHURRIED, max_examples=extent)
    @given(telegram=telegrams_for(name, direction), wrong=st.integers(0, 255))
    def alike(telegram, wrong):
        for form in installed[name].forms().values():
            if isinstance(outcome(form.parse_declared, telegram), tuple):
                continue
            for place in range(len(telegram)):
                changed = telegram[:place] + bytes([wrong]) + telegram[place + 1 :]
                read, declared = outcome(form.parse, changed), outcome(form.parse_declared, changed)
                assert (type(read), read, repr(read)) == (type(declared), declared, repr(declared))

    alike()
