"""Telegrams made from named fields: each missing or unknown field is named in a single sentence, in every protocol."""

import pytest

from drivecomm import decode, encode
from drivecomm.cli import main
from drivecomm.errors import TelegramError
from drivecomm.protocol import installed
from drivecomm.testing import packaged_vectors


def examples():
    """Return the fields of one telegram of every kind, by protocol, direction and kind."""
    found = {}
    for plugin in installed.working():
        for vector in packaged_vectors(plugin).vectors:
            fields = vector.fields
            if not fields or not vector.canonical:
                continue
            known = (
                plugin.name,
                vector.direction,
                fields.get("frame", ""),
                plugin.message(fields, vector.direction).kind,
            )
            found.setdefault(known, (plugin.name, vector.direction, dict(fields), vector.options))
    return found


EXAMPLES = examples()
TELLS_THE_KIND = {("modbus", "exception"), ("uss", "broadcast")}
"""Fields that decide the kind: without one, the others belong to another telegram, which lacks different fields."""


@pytest.mark.parametrize(("protocol", "direction", "fields", "options"), EXAMPLES.values(), ids=map(str, EXAMPLES))
def test_each_missing_field_is_named_in_the_error(protocol, direction, fields, options):
    assert encode(protocol, fields, direction=direction, **options)
    for name in fields:
        if (protocol, name) in TELLS_THE_KIND:
            continue
        rest = {key: value for key, value in fields.items() if key != name}
        try:
            encode(protocol, rest, direction=direction, **options)
        except TelegramError as refused:
            said = str(refused)
            assert name in said
            assert "__init__" not in said
            assert "None is" not in said


@pytest.mark.parametrize(("protocol", "direction", "fields", "options"), EXAMPLES.values(), ids=map(str, EXAMPLES))
def test_unknown_field_is_refused_with_the_known_fields(protocol, direction, fields, options):
    with pytest.raises(TelegramError) as refused:
        encode(protocol, {**fields, "colour": "red"}, direction=direction, **options)
    assert "has no field 'colour'; it has " in str(refused.value)
    assert refused.value.field == "colour"


def test_danfoss_request_has_defaults_that_command_nothing(capsys):
    assert main(["encode", "danfoss-fc", "kind=parameter", "address=3", "ak=1", "pnu=1630"]) == 0
    data = bytes.fromhex(capsys.readouterr().out)
    fields = decode("danfoss-fc", data, direction="request").fields
    assert (fields["control_word"], fields["reference"], fields["ind"], fields["pwe"]) == (0, 0, 0, 0)
    assert installed["danfoss-fc"].intent(decode("danfoss-fc", data, direction="request").message).only_asks
    assert main(["encode", "danfoss-fc", "kind=process", "address=3"]) == 4
    assert "a process block also needs control_word, reference; it may also have" in capsys.readouterr().err
    assert main(["encode", "danfoss-fc", "kind=process", "address=3", "control_word=0", "reference=0"]) == 0
    assert capsys.readouterr().out == "02 06 83 00 00 00 00 87\n"
    assert main(["encode", "danfoss-fc", "kind=text", "address=3", "pnu=533", "text=FAN"]) == 0
    text = decode("danfoss-fc", bytes.fromhex(capsys.readouterr().out), direction="request").fields
    assert (text["ak"], text["ind"], text["text"]) == (15, 0x0500, "FAN")


def test_incomplete_reply_is_refused(capsys):
    assert main(["encode", "danfoss-fc", "-d", "reply", "kind=parameter", "address=3", "ak=1", "pnu=1"]) == 4
    said = capsys.readouterr().err
    assert "a parameter block also needs ind, pwe, status_word, main_actual; it may also have" in said
    assert said.count("\n") == 1
