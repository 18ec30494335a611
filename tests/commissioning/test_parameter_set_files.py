"""Parameter sets as files: read back as written, in a fixed order, with errors located by line."""

from dataclasses import replace
from datetime import UTC, datetime
from decimal import Decimal

import pytest
from hypothesis import HealthCheck, given, settings, strategies as st
from pages import ROOT, blocks_of

from drivecomm.commissioning.parameter_sets import (
    PARTS,
    ParameterEntry,
    ParameterSet,
    entries_text,
    in_order,
    read_set,
    text_of,
    write_set,
)
from drivecomm.errors import FileFormatError, UsageError
from drivecomm.models import quantities

FEW = settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
NAMES = TEXTS.filter(bool)
NUMBERS = st.one_of(
    st.integers(-(2**32), 2**32),
    st.decimals(-(10**6), 10**6, places=3),
    st.decimals(allow_nan=False, allow_infinity=False, min_value=-1000, max_value=1000, places=9),
)
ADDRESSES = st.from_regex(r"[A-Fa-z]?[0-9]{1,4}(-[0-9]{2})?(\[[0-9]{1,2}(,[0-9])?\])?", fullmatch=True)


@st.composite
def sets(draw):
    addresses = draw(st.lists(ADDRESSES, unique=True, max_size=8))
    entries = {
        address: ParameterEntry(
            address=address,
            value=draw(st.one_of(NUMBERS, TEXTS)),
            name=draw(TEXTS),
            unit=draw(TEXTS),
            raw=draw(st.one_of(st.none(), st.integers(-(2**32), 2**32), NAMES)),
            common=draw(st.sampled_from(["", *quantities()])),
            part=draw(st.sampled_from(PARTS)),
            meaning=draw(TEXTS),
        )
        for address in in_order(addresses)
    }
    return ParameterSet(
        protocol=draw(NAMES),
        drive=draw(NAMES),
        model=draw(NAMES),
        firmware=draw(TEXTS),
        time=draw(st.none() | st.datetimes(datetime(1970, 1, 1), timezones=st.just(UTC)).map(_to_the_second)),  # noqa: DTZ001
        identity=draw(st.dictionaries(TEXTS, TEXTS, max_size=3)),
        entries=entries,
        not_read=draw(st.dictionaries(ADDRESSES, TEXTS, max_size=3)),
    )


def _to_the_second(time):
    return time.replace(microsecond=0)


@pytest.mark.soak
@FEW
@given(known=sets())
def test_written_set_is_read_back_unchanged(known, tmp_path_factory):
    path = tmp_path_factory.mktemp("sets") / "set.toml"
    write_set(path, known)
    found = read_set(path)
    assert found == known
    for address, entry in known.entries.items():
        again = found.entries[address]
        if not isinstance(entry.value, str):
            assert format(again.value, "f") == format(entry.value, "f"), "with all its decimals"
    assert all(entries_text(found, part) == entries_text(known, part) for part in PARTS)


@pytest.mark.soak
@FEW
@given(known=sets())
def test_order_of_the_file_does_not_depend_on_the_order_of_reading(known):
    other_way_round = dict(reversed(known.entries.items()))
    assert text_of(replace(known, entries=other_way_round)) == text_of(known)


@pytest.mark.soak
@FEW
@given(known=sets().filter(lambda known: known.entries), new=st.integers(-999, 999))
def test_one_changed_parameter_changes_one_line(known, new):
    address = next(iter(known.entries))
    changed = replace(known, entries={**known.entries, address: replace(known.entries[address], value=new)})
    before, after = text_of(known).split("\n"), text_of(changed).split("\n")
    assert len(before) == len(after)
    assert sum(old != line for old, line in zip(before, after, strict=True)) <= 1


def test_smallest_and_largest_float_of_a_drive_are_read_back(tmp_path):
    ends = {"1": Decimal("1E-45"), "2": Decimal("3.40282347E+38")}
    known = ParameterSet(
        protocol="uss", drive="uss:1", model="micromaster4",
        entries={address: ParameterEntry(address=address, value=value) for address, value in ends.items()},
    )  # fmt: skip
    write_set(tmp_path / "set.toml", known)
    assert read_set(tmp_path / "set.toml").entries == known.entries


def test_file_shown_on_the_how_to_page_is_valid(tmp_path):
    page = ROOT / "docs" / "how-to" / "parameter-sets.md"
    (block,) = [block for block in blocks_of(page) if block.title == "fan.toml"]
    path = tmp_path / "fan.toml"
    path.write_text(block.code, encoding="utf-8")
    known = read_set(path)
    assert [entry.part for entry in known.entries.values()] == ["settings", "settings", "communication", "settings"]
    assert str(known.entries["202"]) == "50.0 Hz"


def test_addresses_are_in_natural_order():
    assert in_order(["3-10[10]", "10", "9", "3-10[2]", "3-02", "y01", "F03", "A13"]) == [
        "3-02", "3-10[2]", "3-10[10]", "9", "10", "A13", "F03", "y01",
    ]  # fmt: skip


HEAD = 'format = 1\nprotocol = "vabus"\ndrive = "vabus:1"\nmodel = "agile"\n'


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("format = 2", "line 1: a parameter set begins with format = 1"),
        ('format = 1\ndrive = "vabus:1"', "the key 'protocol' is missing"),
        (f"{HEAD}colour = 1", "line 5: unknown key 'colour'; the keys are format, protocol"),
        (f"{HEAD}time = 12", "line 5: invalid time = 12; write a time with its zone, as 2026-"),
        (f"{HEAD}time = 2026-11-21T19:00:00", "line 5: invalid time 2026-11-21 19:00:00; write it with its zone"),
        (f"{HEAD}firmware = 5", "line 5: invalid firmware = 5; write a text in quotes"),
        (f"{HEAD}settings = 5", "line 5: invalid settings = 5; write a table"),
        (f'{HEAD}[settings]\n"481" = 5', "line 6: settings: invalid 481 = 5; write a table in braces"),
        (
            f'{HEAD}[settings]\n\n"481" = {{ valeu = 5 }}',
            "481: unknown key 'valeu'; did you mean 'value'?",
        ),
        (f'{HEAD}[settings]\n"481" = {{ name = "x" }}', "line 6: settings, 481: the key 'value' is missing"),
        (f'{HEAD}[settings]\n"481" = {{ value = true }}', "line 6: settings, 481: invalid value = True"),
        (f'{HEAD}[settings]\n"481" = {{ value = nan }}', "line 6: settings, 481: no drive holds such a number"),
        (f'{HEAD}[settings]\n"481" = {{ value = 1e999999999 }}', "line 6: settings, 481: no drive holds such a number"),
        (
            f'{HEAD}[settings]\n"481" = {{ value = 1, common = "speed" }}',
            "481: unknown common name 'speed'",
        ),
        (
            f'{HEAD}[settings]\n"1" = {{ value = 1 }}\n[measured]\n"1" = {{ value = 1 }}',
            "line 8: measured: 1 is also listed under [sett",
        ),
        (f"{HEAD}[identity]\nserial = 5", "line 6: identity: invalid serial = 5; write a text in quotes"),
        (f"{HEAD}[settings", "cannot be read as a parameter set"),
        (f"{HEAD}x = 1e9999999999999999999999", "cannot be read as a parameter set"),
        ("\udcff", "cannot be read as a parameter set"),
    ],
)
def test_error_in_a_file_is_reported_with_its_line(text, sentence, tmp_path):
    path = tmp_path / "set.toml"
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(FileFormatError) as caught:
        read_set(path)
    assert str(caught.value).startswith(str(path))
    assert sentence in str(caught.value)


def test_unwritable_path_is_refused(tmp_path):
    known = ParameterSet(protocol="vabus", drive="vabus:1", model="agile", entries={})
    with pytest.raises(UsageError, match="not a parameter set; give another name"):
        write_set(tmp_path, known)
    with pytest.raises(UsageError, match="there is no folder"):
        write_set(tmp_path / "a" / "b.toml", known)


def test_handwritten_numbers_are_read(tmp_path):
    path = tmp_path / "set.toml"
    path.write_text(f'{HEAD}[settings]\n481 = {{ value = 0.1 }}\n"480" = {{ value = 1_000 }}\n')
    assert [entry.value for entry in read_set(path).entries.values()] == [1000, Decimal("0.1")]
