"""Tests of the conformance checks: codecs with one mistake each, and the check that must find it."""

from dataclasses import replace

import pytest
from extents import first_of_each, shape_of_vector

from drivecomm.errors import AddressError, DriveCommError, FileFormatError, TelegramError
from drivecomm.protocol import VirtualReply, installed
from drivecomm.protocol.schema import Emission, Form, Leaf, constant, hex_number
from drivecomm.testing import (
    Check,
    CheckFailure,
    Refuse,
    Report,
    Stream,
    Vector,
    VectorFile,
    carry_out,
    checks_of,
    packaged_vectors,
    run_checks,
)
from drivecomm.testing.checks.schemas import compiles_whole, same_both_ways
from drivecomm_vabus.telegrams import Ack, Enquiry, Value

VABUS = installed["vabus"]
ALL = packaged_vectors(VABUS)
SAMPLE = replace(ALL, vectors=tuple(first_of_each(ALL.vectors, shape_of_vector)), exchanges=ALL.exchanges[::12])


@pytest.fixture(params=[SAMPLE, pytest.param(ALL, marks=pytest.mark.soak)], ids=["sample", "all"])
def packaged(request):
    """Return the vectors that ship with VABus: one of each shape, or all."""
    return request.param


class Wrapped:
    """VABus codec with one method replaced."""

    def __init__(self, options, **methods):
        self._codec = VABUS.codec(options)
        self._methods = methods

    def __getattr__(self, name):
        method = self._methods.get(name)
        return getattr(self._codec, name) if method is None else lambda *values: method(self._codec, *values)


def mutant(**methods):
    return replace(VABUS, codec=lambda options: Wrapped(options, **methods))


def failed_checks(plugin, vectors):
    return {failure.name.rpartition("/")[2]: failure.reason for failure in run_checks(plugin, vectors).failed}


@pytest.mark.soak
def test_unchanged_codec_passes_all_checks(packaged):
    report = run_checks(VABUS, packaged)
    assert report.ok
    assert str(report).endswith("checks passed, 0 failed")


@pytest.mark.soak
def test_wrong_decoded_field_is_found(packaged):
    def decode(codec, data, direction):
        message = codec.decode(data, direction)
        return replace(message, parameter=message.parameter + 1) if isinstance(message, Enquiry) else message

    assert "parameter is 482, the vector says 481" in run_checks(mutant(decode=decode), packaged).failed[0].reason


def test_missing_decoded_field_is_found(packaged):
    vector = replace(packaged.vectors[0], fields={**packaged.vectors[0].fields, "colour": "red"})
    assert "the field colour is missing" in failed_checks(VABUS, replace(packaged, vectors=(vector,)))["decode"]


def test_flag_does_not_match_a_number(packaged):
    vector = replace(packaged.vectors[0], fields={**packaged.vectors[0].fields, "address": True})
    assert "address is 1, the vector says True" in failed_checks(VABUS, replace(packaged, vectors=(vector,)))["decode"]


@pytest.mark.soak
def test_wrong_encoded_bytes_are_found(packaged):
    assert "encode" in failed_checks(mutant(encode=lambda codec, message: codec.encode(message) + b"\r"), packaged)


@pytest.mark.soak
def test_ignored_checksum_is_found(packaged):
    def decode(codec, data, direction):
        try:
            return codec.decode(data, direction)
        except TelegramError as error:
            if error.category != "checksum":
                raise
            return Ack(address=1)

    assert {"decode", "flipped"} <= set(failed_checks(mutant(decode=decode), packaged))


@pytest.mark.soak
def test_wrong_error_category_is_found(packaged):
    def decode(codec, data, direction):
        try:
            return codec.decode(data, direction)
        except TelegramError as error:
            raise TelegramError("framing", str(error)) from None

    failures = failed_checks(mutant(decode=decode), packaged)
    assert set(failures) == {"decode"}
    assert "refused as framing" in failures["decode"]


@pytest.mark.soak
def test_undeclared_blind_spot_is_found(packaged):
    assert set(failed_checks(replace(VABUS, blind_spots=lambda *_: frozenset()), packaged)) == {"flipped"}


def test_blind_spot_beyond_the_telegram_is_found(packaged):
    failures = failed_checks(replace(VABUS, blind_spots=lambda *_: frozenset([999])), packaged)
    assert "outside the telegram" in failures["flipped"]


@pytest.mark.soak
def test_ignored_bytes_after_a_telegram_are_found(packaged):
    def decode(codec, data, direction):
        return codec.decode(data[: codec.measure(data, direction)] or data, direction)

    assert "trailing" in failed_checks(mutant(decode=decode), packaged)


@pytest.mark.soak
def test_accepted_truncated_telegram_is_found(packaged):
    def decode(codec, data, direction):
        try:
            return codec.decode(data, direction)
        except TelegramError as error:
            if error.category != "length" or direction == "request":
                raise
            return Ack(address=1)

    assert {"truncated", "truncated-stream"} <= set(failed_checks(mutant(decode=decode), packaged))


@pytest.mark.soak
@pytest.mark.parametrize("wrong", [lambda length: length + 1, lambda length: max(0, length - 1), lambda _: 0])
def test_wrong_measured_length_is_found(packaged, wrong):
    failures = failed_checks(mutant(measure=lambda codec, *values: wrong(codec.measure(*values))), packaged)
    assert "five-in-a-row" in failures


@pytest.mark.soak
@pytest.mark.parametrize("shortest", [0, 3])
def test_wrong_shortest_length_is_found(packaged, shortest):
    failures = failed_checks(
        mutant(measure=lambda codec, head, direction: codec.measure(head, direction) if head else shortest), packaged
    )
    assert set(failures) == {"shortest"}
    assert f"is shorter than {shortest}" in failures["shortest"]


def test_noise_accepted_as_a_start_is_found():
    def measure(codec, head, direction):
        return 40 if head[:1] == b"\x7f" else codec.measure(head, direction)

    def decode(codec, data, direction):
        if data[:1] == b"\x7f":
            return Ack(address=1)
        return codec.decode(data, direction)

    codec = mutant(measure=measure, decode=decode)
    stream = Stream(id="s", direction="reply", data=b"\x7f\x41\x06", frames=(b"\x41\x06",))
    assert set(failed_checks(codec, VectorFile(name="f", protocol="vabus", streams=(stream,)))) == {"stream"}


def test_stream_frame_that_is_not_a_telegram_is_found():
    stream = Stream(id="s", direction="reply", data=b"\x41", frames=(b"\x41",))
    assert (
        "in pieces of 1 found []"
        in failed_checks(VABUS, VectorFile(name="f", protocol="vabus", streams=(stream,)))["stream"]
    )


def test_encoded_refusal_vector_is_found():
    refuse = Refuse(id="r", direction="reply", fields={"kind": "ack", "address": 1}, reason="some")
    failures = failed_checks(VABUS, VectorFile(name="f", protocol="vabus", refusals=(refuse,)))
    assert failures["refuse"] == "encoded as 41 06, the vector says it is refused (some)"


def test_unknown_option_fails_only_its_vector():
    refuse = Refuse(id="r", direction="reply", fields={}, options={"colour": "red"})
    failures = failed_checks(VABUS, VectorFile(name="f", protocol="vabus", refusals=(refuse,)))
    assert failures["refuse"].startswith("vabus has no option 'colour'; it has ")


@pytest.mark.soak
def test_exception_outside_the_error_tree_is_found(packaged):
    def decode(codec, data, direction):
        return codec.decode(data, direction) if len(data) % 3 else {}[data]

    assert "KeyError outside the error tree" in failed_checks(mutant(decode=decode), packaged)["truncated"]


def answering(answer):
    """Return the protocol with a virtual drive that answers with this function."""

    class Drive:
        codec = VABUS.codec(VABUS.options())

        def __init__(self, address, options, model):
            self._real = VABUS.virtual(address, options, model)

        def hear(self, find, now):
            return answer(self._real, find, now)

    return replace(VABUS, virtual=Drive)


def reply(data, delay_s=0.0):
    return VirtualReply(data=data, delay_s=delay_s)


@pytest.mark.soak
@pytest.mark.parametrize(
    ("answer", "expected"),
    [
        (lambda *_: reply(b"\x41\x06"), {"virtual-drive", "silence"}),
        (lambda real, find, now: real.hear(find, now) and reply(b"\x41\x07"), {"virtual-drive"}),
        (lambda real, find, now: real.hear(find, now) and reply(b"\x4b\x06"), {"virtual-drive"}),
        (lambda real, find, now: real.hear(find, now) and reply(real.hear(find, now).data, -1.0), {"virtual-drive"}),
        (lambda *_: None, set()),
    ],
    ids=["answers everybody", "answers nonsense", "answers for another", "answers too soon", "is dead"],
)
def test_wrong_answers_of_a_virtual_drive_are_found(packaged, answer, expected):
    assert set(failed_checks(answering(answer), packaged)) == expected


def test_request_to_an_unused_address_passes_without_a_reply(packaged):
    # The file does not mark this request as a broadcast, but no drive has the address, so no reply is right.
    broadcast = next(vector for vector in ALL.vectors if vector.id == "derived-broadcast-select-410-quickstop")
    file = replace(packaged, vectors=(replace(broadcast, reply_expected=True),))
    assert not failed_checks(VABUS, file)


@pytest.mark.soak
def test_addresses_missing_in_a_variant_are_skipped(packaged):
    def virtual(address, options, model):
        if address > 5:
            raise AddressError(f"no {address}")
        return VABUS.virtual(address, options, model)

    plugin = replace(VABUS, virtual=virtual)
    vectors = tuple(vector for vector in packaged.vectors if vector.fields.get("address", 1) <= 5)
    assert not failed_checks(plugin, replace(packaged, vectors=vectors))


def test_reply_to_another_request_is_found():
    request = bytes.fromhex("0441303034383105")
    answer = Vector(
        id="v",
        source="here",
        direction="reply",
        data=VABUS.codec(VABUS.options()).encode(Value(address=1, parameter=482, data="0000")),
        valid=True,
        fields={"kind": "value"},
        canonical=False,
        answers_to=request,
    )
    file = VectorFile(name="f", protocol="vabus", vectors=(answer,))
    assert failed_checks(VABUS, file) == {"answers": "differs in parameter, the vector says nothing"}
    right = replace(answer, answers=False, mismatch="parameter")
    assert not failed_checks(VABUS, replace(file, vectors=(right,)))


def test_exact_copy_of_the_request_counts_as_an_echo():
    # Simulates a protocol whose replies look like requests: both directions decode alike.
    def decode(codec, data, _):
        return codec.decode(data, "request")

    request = bytes.fromhex("0441303034383105")
    echo = Vector(
        id="v",
        source="here",
        direction="reply",
        data=request,
        valid=True,
        answers_to=request,
        answers=False,
        mismatch="echo",
    )
    plugin = mutant(decode=decode, measure=lambda codec, head, _: codec.measure(head, "request"))
    assert "answers" not in failed_checks(plugin, VectorFile(name="f", protocol="vabus", vectors=(echo,)))


def test_impossible_options_do_not_stop_the_virtual_drive_check(packaged):
    request = next(vector for vector in ALL.vectors if vector.id == "seed-enquiry-481")
    case = replace(request, fields={**request.fields, "sys": 99})
    failures = failed_checks(VABUS, replace(packaged, vectors=(case,)))
    assert set(failures) == {"decode", "encode"}


def test_vectors_of_another_protocol_are_refused():
    with pytest.raises(FileFormatError, match="holds vectors of 'vabus', not of 'other'"):
        list(checks_of(replace(VABUS, name="other"), ALL))


def test_package_without_vectors_is_checked_with_a_given_file():
    value = next(vector for vector in ALL.vectors if vector.id == "seed-reply-481")
    file = VectorFile(name="f", protocol="vabus", vectors=(value,))
    assert not failed_checks(replace(VABUS, package="drivecomm.protocol.schema"), file)


def test_partly_interpreted_schema_is_found():
    form = Form(Ack, "address" / Leaf(lambda _: 1, lambda data: data[0], lambda value: bytes([value])))
    with pytest.raises(CheckFailure, match="the whole schema is interpreted"):
        compiles_whole(form)
    assert form.parse(b"A") == Ack(address=65)


def undecided(code, text):
    """Return the emission of a one-character leaf whose compiled code differs from its functions."""
    return Emission(cut="B", read=lambda _, cut: code.format(cut), write=lambda _, value: text.format(value))


def test_schema_with_different_compiled_reading_is_found():
    said = undecided("{} + 1", "{}")
    form = Form(Ack, "address" / Leaf(1, lambda data: data[0], lambda value: bytes([value]), emission=said))
    with pytest.raises(CheckFailure, match=r"as Ack\(address=66\) compiled and as Ack\(address=65\) interpreted"):
        same_both_ways("form", form, b"A")


def test_schema_with_different_compiled_writing_is_found():
    said = undecided("{}", "{} + 1")
    form = Form(Ack, "address" / Leaf(1, lambda data: data[0], lambda value: bytes([value]), emission=said))
    with pytest.raises(CheckFailure, match=r"writes .* as b'B' compiled and as b'A' interpreted"):
        same_both_ways("form", form, b"A")


def test_schema_with_different_compiled_refusal_is_found():
    form = Form(Ack, constant(b"A", "start"), "address" / hex_number(2))

    def refused(_):
        raise TelegramError("checksum", "it is wrong")

    form.parse = refused
    with pytest.raises(CheckFailure, match=r"\('checksum', .* compiled and with \('framing', .* interpreted"):
        same_both_ways("form", form, b"B0F")


def test_schema_with_equal_compiled_code_passes():
    assert same_both_ways("form", Form(Ack, constant(b"A"), "address" / hex_number(2)), b"A0F") is None


def test_empty_report_is_not_ok():
    assert not carry_out([]).ok
    assert carry_out([Check("a", lambda: None)]).ok
    assert not Report(results=()).ok


def test_report_distinguishes_refusals_from_failures():
    def refuse():
        raise DriveCommError("no")

    def fail():
        raise CheckFailure("bad")

    report = carry_out([Check("a/b", refuse), Check("a/c", fail), Check("a/d", lambda: None)])
    assert [failure.reason for failure in report.failed] == ["refused: no", "bad"]
    assert report.passed == ("a/d",)
    assert str(report) == "1 checks passed, 2 failed\na/b: refused: no\na/c: bad"
    assert not report.ok
