"""Loading of vector files: valid files, and the errors for invalid ones."""

import pytest

from drivecomm.errors import FileFormatError
from drivecomm.protocol import installed
from drivecomm.testing import FORMAT, load_vectors, packaged_vectors

HEAD = 'format = 2\nprotocol = "vabus"\n'
VECTOR = """
[[vector]]
id = "one"
source = "somewhere"
direction = "request"
hex = "04 41 30 30 34 38 31 05"
valid = true
[vector.fields]
kind = "enquiry"
"""
REPLY = VECTOR.replace('"request"', '"reply"')
REFUSED = VECTOR.partition("[vector.fields]")[0].replace("valid = true", 'valid = false\nerror = "length"')
STREAM = '[[stream]]\nid = "s"\ndirection = "reply"\nhex = "41 06 41 06"\nframes = ["41 06", "41 06"]\n'
REFUSE = '[[refuse]]\nid = "r"\ndirection = "request"\n[refuse.fields]\nkind = "enquiry"\n'


@pytest.fixture
def load(tmp_path):
    def from_text(text, **options):
        path = tmp_path / "some.toml"
        path.write_text(text, encoding="utf-8")
        return load_vectors(path, **options)

    return from_text


def put(line, into=VECTOR):
    """Return a file with a line added before the fields."""
    return HEAD + into.replace("valid =", f"{line}\nvalid =", 1)


def test_complete_file_is_loaded(load):
    read = load(HEAD + VECTOR + REFUSED.replace('"one"', '"two"') + STREAM + REFUSE, protocol="vabus")
    one, two = read.vectors
    assert (read.name, read.protocol) == ("some.toml", "vabus")
    assert (one.id, one.source, one.direction) == ("one", "somewhere", "request")
    assert one.data == bytes.fromhex("0441303034383105")
    assert (one.valid, one.canonical, one.printed, one.reply_expected, one.answers_to) == (
        True,
        True,
        False,
        True,
        None,
    )
    assert one.fields == {"kind": "enquiry"}
    assert (two.valid, two.error, two.fields) == (False, "length", {})
    assert read.streams[0].frames == (b"\x41\x06", b"\x41\x06")
    assert read.refusals[0].fields == {"kind": "enquiry"}


def test_reply_is_loaded_with_its_request(load):
    text = put('answers_to = "04"\nanswers = false\nmismatch = "kind"', REPLY)
    vector = load(text).vectors[0]
    assert (vector.answers_to, vector.answers, vector.mismatch) == (b"\x04", False, "kind")


def test_file_without_entries_is_loaded(load):
    assert load(HEAD).vectors == ()


def test_every_packaged_file_is_loaded():
    for plugin in installed.working():
        assert packaged_vectors(plugin).protocol == plugin.name


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("this is no toml", "cannot be read as a vector file"),
        ("", f"begins with format = {FORMAT}"),
        ('format = 1\nprotocol = "vabus"', f"begins with format = {FORMAT}"),
        ('format = true\nprotocol = "vabus"', f"begins with format = {FORMAT}"),
        ('format = "2"\nprotocol = "vabus"', f"begins with format = {FORMAT}"),
        ("format = 2", "line 1: the key 'protocol' is missing; write protocol = a text in quotes"),
        ("format = 2\nprotocol = 7", "line 2: invalid protocol = 7; write a text in quotes"),
        ('format = 2\nprotocol = ""', "names its protocol"),
        ('format = 2\nprotocol = "fuji"', "holds vectors of 'fuji', not of 'vabus'"),
        (HEAD + "[[exchanges]]\nid = 'x'", "unknown key 'exchanges'; did you mean 'exchange'?"),
        (
            HEAD + "vector = 3",
            "line 3: invalid vector = 3; write a table of its own each time, under a header in double",
        ),
        (
            HEAD + "[vector]\nid = 'x'",
            "invalid vector = {'id': 'x'}; write a table of its own each time, under a header",
        ),
        (HEAD + "stream = [1]", "write stream as tables: [[stream]] and the keys below, for each"),
        (HEAD + VECTOR.replace('id = "one"', ""), "vector 1: the key 'id' is missing"),
        (HEAD + VECTOR.replace('"one"', "1"), "line 5: vector 1: invalid id = 1; write a text in quotes"),
        (HEAD + VECTOR.replace('"one"', '" "'), "vector 1: id is empty"),
        (HEAD + VECTOR + VECTOR, "the id 'one' is used twice"),
        (HEAD + VECTOR + STREAM.replace('"s"', '"one"'), "the id 'one' is used twice"),
        (HEAD + VECTOR.replace('source = "somewhere"', ""), "vector one: the key 'source' is missing"),
        (HEAD + VECTOR.replace('direction = "request"', ""), "vector one: the key 'direction' is missing"),
        (HEAD + VECTOR.replace('"request"', '"up"'), "vector one: direction 'up' is not one of request, reply"),
        (
            HEAD + VECTOR.replace("valid = true", "valid = 1"),
            "line 9: vector one: invalid valid = 1; write true or false",
        ),
        (HEAD + VECTOR.replace("valid = true", ""), "vector one: the key 'valid' is missing"),
        (HEAD + VECTOR.replace("04 41", "4 41"), "vector one: hex is not hexadecimal"),
        (HEAD + VECTOR.replace("04 41", "0x04"), "vector one: hex is not hexadecimal"),
        (HEAD + VECTOR.replace("04 41 30 30 34 38 31 05", ""), "vector one: hex is empty"),
        (HEAD + VECTOR.partition("[vector.fields]")[0], "vector one: the key 'fields' is missing"),
        (
            HEAD + VECTOR.partition("[vector.fields]")[0] + "fields = 3",
            "vector one: invalid fields = 3; write a table in braces, such as { key = value }",
        ),
        (put('colour = "red"'), "line 9: vector one: unknown key 'colour'; the keys are id, source,"),
        (put("note = 3"), "line 9: vector one: invalid note = 3; write a text in quotes"),
        (put('printed = "yes"'), "vector one: invalid printed = 'yes'; write true or false"),
        (put("options = 3"), "vector one: invalid options = 3; write a table in braces, such as { key = value }"),
        (put('error = "length"'), "vector one: a valid telegram has no error"),
        (put("reply_expected = false", REPLY), "vector one: a reply has no reply_expected"),
        (put('answers_to = "04"\nanswers = true'), "vector one: a request has no answers_to"),
        (put("answers = true", REPLY), "vector one: a vector without answers_to has no answers"),
        (put('answers_to = "04"', REPLY), "vector one: the key 'answers' is missing"),
        (put('answers_to = "04"\nanswers = false', REPLY), "vector one: answers = false needs mismatch"),
        (put('answers_to = "04"\nanswers = true\nmismatch = "x"', REPLY), "the answer has no mismatch"),
        (HEAD + REFUSED.replace('error = "length"', ""), "vector one: the key 'error' is missing"),
        (
            HEAD + REFUSED.replace('"length"', '"parity"'),
            "error 'parity' is not one of framing, length, checksum, field",
        ),
        (HEAD + REFUSED + "canonical = true", "vector one: a refused telegram has no canonical"),
        (HEAD + REFUSED + "[vector.fields]\nkind = 'x'", "vector one: a refused telegram has no fields"),
        (
            HEAD + STREAM.replace('["41 06", "41 06"]', '"41 06"'),
            "stream s: invalid frames = '41 06'; write a list, such as",
        ),
        (HEAD + STREAM.replace('["41 06", "41 06"]', "[1]"), "stream s: frames is not a list of texts"),
        (HEAD + STREAM.replace('["41 06", "41 06"]', '["4"]'), "stream s: frames is not hexadecimal"),
        (HEAD + STREAM.replace('["41 06", "41 06"]', '[""]'), "stream s: frames is empty"),
        (
            HEAD + STREAM + "valid = true",
            "stream s: unknown key 'valid'; the keys are id, direction, hex, source, note, frames, options",
        ),
        (HEAD + REFUSE.replace("[refuse.fields]", "").replace('kind = "enquiry"', ""), "the key 'fields' is missing"),
        (
            HEAD + REFUSE.replace("[refuse.fields]", 'hex = "04"\n[refuse.fields]'),
            "refuse r: unknown key 'hex'; the keys are id, direction, reason, source, note, fields, options",
        ),
    ],
)
def test_error_names_the_mistake_in_a_vector_file(load, text, what):
    with pytest.raises(FileFormatError, match=r"some\.toml(, line \d+)?: ") as caught:
        load(text, protocol="vabus")
    assert what in str(caught.value)


def test_missing_file_raises_file_format_error(tmp_path):
    with pytest.raises(FileFormatError, match=r"none\.toml: there is no such file"):
        load_vectors(tmp_path / "none.toml")


def test_file_in_another_encoding_raises_file_format_error(tmp_path):
    path = tmp_path / "latin.toml"
    path.write_bytes((HEAD + "# \xe4").encode("latin-1"))
    with pytest.raises(FileFormatError, match=r"latin\.toml, line 3: cannot be read"):
        load_vectors(path)
