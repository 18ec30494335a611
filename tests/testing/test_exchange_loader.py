"""Loading of exchange vectors: valid tables, and the errors for invalid ones."""

from dataclasses import fields
from pathlib import Path

import pytest
from hypothesis import given, strategies as st

from drivecomm import errors
from drivecomm.errors import FileFormatError
from drivecomm.testing import ExchangeVector, Expected, VectorCall, WireStep, load_vectors
from drivecomm.testing.exchange_vectors import ACTIONS, ERROR_NAMES, read_exchange
from drivecomm.tomlfile import TomlTable

HEAD = 'format = 2\nprotocol = "vabus"\n'
EXCHANGE = """
[[exchange]]
id = "one"
source = "somewhere"
address = 1
calls = [{ call = "read", arguments = { parameter = "481" } }]
steps = [{ send = "04" }, { reply = "41 06" }]
"""


def load_one(tmp_path, text):
    path = tmp_path / "some.toml"
    path.write_text(HEAD + text, encoding="utf-8")
    return load_vectors(path).exchanges[0]


@pytest.fixture
def load(tmp_path):
    return lambda text: load_one(tmp_path, text)


def test_minimal_exchange_is_loaded_with_defaults(load):
    vector = load(EXCHANGE)
    assert (vector.id, vector.source, vector.address) == ("one", "somewhere", 1)
    assert (vector.printed, vector.model, vector.options, vector.note) == (False, "", {}, "")
    assert vector.watched_s is None
    assert vector.calls == (VectorCall(call="read", arguments={"parameter": "481"}),)
    assert vector.steps == (WireStep(action="send", data=b"\x04"), WireStep(action="reply", data=b"A\x06"))


def test_exchange_with_all_keys_is_loaded(load):
    vector = load("""
[[exchange]]
id = "two"
source = "page 3"
printed = true
address = 32
model = "agile"
options = { attempts = 2 }
watched_s = 2.5
calls = [
    { call = "set_reference", arguments = { percent = 50 }, error = "NoReplyError", error_text = "within" },
    { call = "status", result = { word = 7 } },
    { call = "start" },
]
steps = [
    { garbage = "00" },
    { send = "04 41" },
    { silence = true, at_least_s = 2 },
    { reply = "4106", after_s = 0.01 },
    { garbage = "55 aa", after_s = 1 },
    { silence = true },
    { pause_s = 0.5 },
    { send = "04" },
]
result = {}
note = "all of it"
""")
    assert (vector.printed, vector.model, vector.options, vector.note) == (True, "agile", {"attempts": 2}, "all of it")
    assert vector.watched_s == 2.5
    first, second, last = vector.calls
    assert first.expected == Expected(error="NoReplyError", error_text="within")
    assert second.expected == Expected(result={"word": 7})
    assert last.expected == Expected(result={})
    assert [step.action for step in vector.steps] == [
        "garbage",
        "send",
        "silence",
        "reply",
        "garbage",
        "silence",
        "pause_s",
        "send",
    ]
    assert [step.seconds for step in vector.steps] == [None, None, 2.0, 0.01, 1.0, None, 0.5, None]


def test_exchange_without_steps_is_loaded(load):
    vector = load(EXCHANGE.replace('[{ send = "04" }, { reply = "41 06" }]', "[]") + 'error = "ValueRefusedError"')
    assert vector.steps == ()
    assert vector.calls[-1].expected == Expected(error="ValueRefusedError")


def test_error_names_contain_only_drivecomm_errors():
    assert "RefusedError" in ERROR_NAMES
    assert all(issubclass(getattr(errors, name), errors.DriveCommError) for name in ERROR_NAMES)


def test_vectors_page_explains_every_key():
    text = (Path(__file__).parents[2] / "docs" / "development" / "vectors.md").read_text(encoding="utf-8")
    section = text.partition("## `[[exchange]]`")[2].partition("\n## ")[0]
    for name in [field.name for field in fields(ExchangeVector)] + [field.name for field in fields(Expected)]:
        assert f"`{name}`" in section, name
    assert all(f"{{ {action} = " in section for action in ACTIONS)


def steps(text):
    return EXCHANGE.partition("steps")[0] + f"steps = {text}\n"


def calls(text):
    return EXCHANGE.replace('[{ call = "read", arguments = { parameter = "481" } }]', text)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        (EXCHANGE.replace('source = "somewhere"', ""), "exchange one: the key 'source' is missing"),
        (EXCHANGE.replace('"somewhere"', '" "'), "exchange one: source is empty"),
        (EXCHANGE.replace("address = 1", ""), "exchange one: the key 'address' is missing"),
        (
            EXCHANGE.replace("address = 1", 'address = "1"'),
            "line 7: exchange one: invalid address = '1'; write a whole number",
        ),
        (
            EXCHANGE.replace("address = 1", "address = true"),
            "exchange one: invalid address = True; write a whole number",
        ),
        (EXCHANGE + "colour = 3", "exchange one: unknown key 'colour'; the keys are id, source, model,"),
        (EXCHANGE + 'error = "NoReply"', "exchange one: error 'NoReply' is not one of AddressError,"),
        (EXCHANGE + 'error_text = "x"', "exchange one: an exchange without error has no error_text"),
        (
            EXCHANGE + 'error = "LinkError"\nresult = {}',
            "exchange one: an exchange that ends with an error has no result",
        ),
        (EXCHANGE + "result = 3", "exchange one: invalid result = 3; write a table in braces"),
        (calls("[]"), "exchange one: calls is empty"),
        (calls('"read"'), "exchange one: invalid calls = 'read'; write a list of tables, such as [{ call = "),
        (calls('["read"]'), "exchange one: write calls as tables"),
        (calls("[{}]"), "exchange one, calls 1: the key 'call' is missing"),
        (calls('[{ call = "" }]'), "exchange one, calls 1: call is empty"),
        (
            calls('[{ call = "read", with = 1 }]'),
            "exchange one, calls 1: unknown key 'with'; the keys are call, arguments, result, error, error_text",
        ),
        (
            calls('[{ call = "read", arguments = 1 }]'),
            "exchange one, calls 1: invalid arguments = 1; write a table in braces",
        ),
        (calls('[{ call = "read", result = {} }]'), "exchange one: the last call's result and error stand beside"),
        (steps("3"), "exchange one: invalid steps = 3; write a list of tables, such as [{ send = "),
        (steps('["04"]'), "exchange one: write steps as tables"),
        (steps("[{}]"), "exchange one, steps 1: has exactly one of send, reply, silence, garbage, pause_s"),
        (steps('[{ send = "04", reply = "04" }]'), "exchange one, steps 1: has exactly one of"),
        (steps('[{ send = "0" }]'), "exchange one, steps 1: send is not hexadecimal"),
        (steps('[{ send = "04", after_s = 1 }]'), "exchange one, steps 1: unknown key 'after_s'; the keys are send"),
        (steps('[{ send = "04" }, { reply = "" }]'), "exchange one, steps 2: reply is empty"),
        (
            steps('[{ send = "04" }, { reply = "04", after_s = -1 }]'),
            "steps 2: invalid after_s = -1; write seconds from 0 to 1e9",
        ),
        (
            steps('[{ send = "04" }, { reply = "04", after_s = "1" }]'),
            "exchange one, steps 2: invalid after_s = '1'; write seconds",
        ),
        (
            steps('[{ send = "04" }, { reply = "04", after_s = inf }]'),
            "steps 2: invalid after_s = inf; write seconds from 0 to 1e9",
        ),
        (
            steps('[{ send = "04" }, { reply = "04", after_s = true }]'),
            "exchange one, steps 2: invalid after_s = True; write seconds",
        ),
        (steps('[{ send = "04" }, { silence = false }]'), "exchange one, steps 2: silence is true or absent"),
        (steps('[{ send = "04" }, { pause_s = 1 }]'), "exchange one, steps 2: after a pause comes a send"),
        (steps('[{ pause_s = 1 }, { reply = "04" }]'), "exchange one, steps 1: after a pause comes a send"),
        (steps('[{ reply = "04" }]'), "exchange one, steps 1: reply comes after a send"),
        (steps("[{ silence = true }]"), "exchange one, steps 1: silence comes after a send"),
    ],
)
def test_error_names_the_mistake_in_an_exchange(load, text, what):
    with pytest.raises(FileFormatError, match=r"some\.toml, line \d+: ") as caught:
        load(text)
    assert what in str(caught.value)


SCALARS = st.one_of(st.booleans(), st.integers(-9, 9), st.sampled_from(["", "04", "read", "NoReplyError"]))
LISTS = st.lists(
    st.dictionaries(st.sampled_from([*ACTIONS, "call", "after_s", "error", "result"]), SCALARS), max_size=3
)


@pytest.mark.soak
@given(
    content=st.dictionaries(
        st.sampled_from([field.name for field in fields(ExchangeVector)] + ["result", "error", "x"]),
        st.one_of(SCALARS, LISTS, st.just({})),
    )
)
def test_random_table_is_loaded_or_refused_with_its_name(content):
    try:
        vector = read_exchange(TomlTable(content, "file", name="exchange x"))
    except FileFormatError as error:
        where = str(error)
    else:
        where = "file: exchange x" * bool(vector.calls)
    assert where.startswith("file: exchange x")
