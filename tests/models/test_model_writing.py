"""Models written as text: reading the text again gives the same model."""

import string
from decimal import Decimal
from typing import get_args

import pytest
from extents import extents
from hypothesis import given, settings, strategies as st

from drivecomm.errors import UsageError
from drivecomm.models import load_model, model_names, model_text, read_model
from drivecomm.protocol import (
    Access,
    LinkLoss,
    MadeFrom,
    Model,
    PanelSetting,
    ParameterInfo,
    Purpose,
    Storage,
    Watchdog,
    installed,
)

# TOML text may contain any character except lone surrogates.
TEXTS = st.text(st.characters(codec="utf-8"), max_size=12)
WORDS = st.text(string.ascii_lowercase + string.digits + "_-[].", min_size=1, max_size=8)
CODES = st.dictionaries(st.integers(-10, 70000), TEXTS, max_size=3)
DECIMALS = st.decimals(allow_nan=False, allow_infinity=False, min_value=-(10**12), max_value=10**12, places=4)
# A model is immutable, so a list of its file is read as a tuple.
OWN = st.one_of(st.booleans(), st.integers(-(2**31), 2**31), TEXTS, st.lists(st.integers(0, 9), max_size=3).map(tuple))
# The other marks are given by a proof.
MARKS = ("printed", "derived", "field", "unconfirmed")
OWN_KEYS = WORDS.filter(lambda key: key not in ParameterInfo.__dataclass_fields__)


@st.composite
def parameters(draw):
    kind = draw(st.sampled_from(["", "uint", "text", "int32"]))
    return ParameterInfo(
        address=draw(WORDS),
        name=draw(WORDS),
        title=draw(TEXTS),
        type=kind,
        unit=draw(TEXTS),
        factor=draw(DECIMALS.filter(bool)),
        access=draw(st.sampled_from(get_args(Access))),
        storage=draw(st.sampled_from(get_args(Storage))),
        values=draw(CODES),
        minimum=draw(st.none() | DECIMALS),
        maximum=draw(st.none() | DECIMALS),
        start=draw(st.none() | (TEXTS if kind == "text" else DECIMALS)),
        source=draw(TEXTS),
        sure=draw(st.sampled_from(MARKS)),
        extra=draw(st.dictionaries(OWN_KEYS, OWN, max_size=2)),
    )


WATCHDOGS = st.builds(
    Watchdog,
    time=WORDS,
    action=st.just("") | WORDS,
    actions=st.dictionaries(st.sampled_from(get_args(LinkLoss)), st.integers(0, 9)),
    off=st.none() | st.integers(0, 9),
    source=TEXTS,
    sure=st.sampled_from(MARKS),
    note=TEXTS,
)

SETTINGS = st.builds(
    PanelSetting,
    parameter=TEXTS.filter(bool),
    name=TEXTS.filter(bool),
    purpose=st.sampled_from(get_args(Purpose)),
    made_from=st.sampled_from(get_args(MadeFrom)),
    codes=st.dictionaries(WORDS, WORDS, max_size=2),
    also=st.lists(WORDS, max_size=2).map(tuple),
    hexadecimal=st.booleans(),
    unit=st.sampled_from(["s", "ms"]),
    factory=TEXTS,
    address=TEXTS,
    when=TEXTS,
    note=TEXTS,
    source=TEXTS.filter(bool),
    sure=st.sampled_from(MARKS),
)


@st.composite
def models(draw):
    known = draw(st.lists(parameters(), max_size=3, unique_by=lambda info: info.address))
    return Model(
        protocol="toy",
        name=draw(WORDS),
        title=draw(TEXTS.filter(bool)),
        source=draw(TEXTS),
        parameters={info.address: info for info in known},
        faults=draw(CODES),
        warnings=draw(CODES),
        options=draw(st.dictionaries(WORDS, OWN, max_size=3)),
        quantities=draw(st.dictionaries(WORDS, WORDS, max_size=3)),
        watchdog=draw(st.none() | WATCHDOGS),
        setup=draw(st.lists(SETTINGS, max_size=2).map(tuple)),
        fault_log=draw(st.lists(WORDS, max_size=3).map(tuple)),
        identified_by=draw(st.dictionaries(TEXTS, WORDS.map(lambda word: word.replace("[", "")), max_size=2)),
    )


@extents(50, 150)
def test_written_model_reads_as_the_same_model(tmp_path, extent):
    path = tmp_path / "some.toml"

    @settings(max_examples=extent, deadline=None)
    @given(model=models())
    def read_as_written(model):
        path.write_text(model_text(model), encoding="utf-8", newline="")
        assert read_model(path, "toy") == model

    read_as_written()


PACKAGED = [(plugin, name) for plugin in installed.working() for name in model_names(plugin.package, plugin.name)]


@pytest.mark.parametrize(("plugin", "name"), PACKAGED, ids=[f"{plugin.name}-{name}" for plugin, name in PACKAGED])
def test_packaged_model_written_as_one_file_reads_as_the_same_model(plugin, name, tmp_path):
    model = load_model(plugin.package, plugin.name, name)
    path = tmp_path / f"{name}.toml"
    path.write_text(model_text(model), encoding="utf-8")
    assert read_model(path, plugin.name) == model


def test_model_text_has_options_then_identification_then_parameters():
    info = ParameterInfo(
        address="3-41",
        name="ramp_up",
        title='ramp "up"',
        type="uint32",
        unit="s",
        factor=Decimal("0.01"),
        values={0: "off"},
        source="p. 1",
        sure="field",
        extra={"elements": 2},
    )
    model = Model(
        protocol="toy",
        name="own",
        title="own",
        source="",
        parameters={info.address: info},
        faults={},
        options={"pnu_bits": 12, "text_writes": False},
        identified_by={"FC type": "FC-1.."},
    )
    assert model_text(model) == (
        "format = 1\n"
        'protocol = "toy"\n'
        'name = "own"\n'
        'title = "own"\n'
        "\n"
        "[options]\n"
        "pnu_bits = 12\n"
        "text_writes = false\n"
        "\n"
        "[identified_by]\n"
        '"FC type" = "FC-1.."\n'
        "\n"
        "[[parameter]]\n"
        'address = "3-41"\n'
        'name = "ramp_up"\n'
        'title = "ramp \\"up\\""\n'
        'type = "uint32"\n'
        'unit = "s"\n'
        'factor = "0.01"\n'
        'access = "rw"\n'
        'values = { 0 = "off" }\n'
        "elements = 2\n"
        'source = "p. 1"\n'
        'sure = "field"\n'
    )


def test_model_text_refuses_a_value_that_toml_cannot_hold():
    model = Model(
        protocol="toy", name="own", title="own", source="", parameters={}, faults={}, options={"odd": object()}
    )
    with pytest.raises(UsageError, match="Object of type 'object' is not TOML serializable"):
        model_text(model)
