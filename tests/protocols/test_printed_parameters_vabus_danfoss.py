"""Parameters printed in the tables of the manuals: each is in the models, with its source.

The lists here record the tables that were read (the models name the sources), so that no parameter gets lost from a
model file.
"""

import pytest

from drivecomm.models import load_model, model_names

PACKAGES = {"vabus": "drivecomm_vabus", "danfoss-fc": "drivecomm_danfoss_fc"}


def numbers(text):
    """Return the addresses of a list such as `372 375 480..482`, with leading zeros kept."""
    found = []
    for word in text.split():
        first, _, last = word.partition("..")
        before, _, member = first.rpartition("-")
        prefix = f"{before}-" if before else ""
        end = int(last.rpartition("-")[2]) if last else int(member)
        found += [f"{prefix}{number:0{len(member)}d}" for number in range(int(member), end + 1)]
    return found


# Bonfiglioli: parameters named in a document.
VABUS = numbers(
    "10 11 17..19 30 66..70 210 211 213 228 230 241 250 251 260 269 270 282 283 372 375 376 394 395 405 406 410..413 "
    "418..423 426 434 450 475 476 480..482 518..520 541 542 549 631 632 637 638 900"
)
# Bonfiglioli: read in addition by a program that runs such drives.
VABUS_FIELD = numbers("249 289 291 294 297")
VABUS_ALL = VABUS + VABUS_FIELD
# Bonfiglioli: numbers known from hearsay only.
HEARSAY = numbers(
    "29 212 214 224 222 223 240 244 245 254 255 256 259 273 274 310..325 362 370 371 373 374 483 521..523 484 524"
)
# Danfoss FC series: the table, without facts from general knowledge only; 8-51 to 8-56 in the row of 8-50.
FC = numbers(
    "0-01 0-37 1-20 1-22..1-25 3-00 3-02 3-03 3-10 3-11 3-41 3-42 3-51 3-81 4-10 4-12 4-14 4-18 5-40 8-01..8-04 "
    "8-10 8-30..8-33 8-35 8-37 8-50..8-56 8-80 8-90 14-01 14-20..14-22 15-00..15-03 15-30 15-31 15-40..15-46 15-51 "
    "15-53 16-00..16-03 16-10 16-12..16-14 16-16..16-18 16-22 16-30 16-34 16-35 16-60 16-71 16-85 "
    "16-86 16-90 16-92 16-94"
)
# Danfoss FC series: named in the text beside the table.
FC_TEXT = numbers("0-10 8-91")
# Danfoss FC series: read in addition by a program that runs FC 302 drives.
FC_FIELD = numbers("1-26 1-39 3-80 4-16 4-17 4-19 16-39 16-87 16-91 16-93")
FC_ALL = FC + FC_TEXT + FC_FIELD
VLT_5000 = numbers("001 105 201..205 207 208 212 213 215..218 500..510 512..514 518 520..522 537 538 540 615 621..635")
VLT_6000 = numbers("206 207 209 323 326 415 501 502 503..508 533 534 556 621..631")

PRINTED = {
    ("vabus", "act"): VABUS_ALL,
    ("vabus", "acu"): VABUS_ALL,
    ("vabus", "agile"): VABUS_ALL,
    ("vabus", "family"): VABUS_ALL,
    ("vabus", "guesses"): VABUS_ALL + HEARSAY,
    ("danfoss-fc", "fc101"): FC_ALL,
    ("danfoss-fc", "fc102"): [*FC_ALL, "0-38", "0-39"],
    ("danfoss-fc", "fc202"): FC_ALL,
    ("danfoss-fc", "fc300"): FC_ALL,
    ("danfoss-fc", "fc302"): FC_ALL,
    ("danfoss-fc", "vlt2800"): numbers("105 500 518"),
    ("danfoss-fc", "vlt5000"): VLT_5000,
    ("danfoss-fc", "vlt6000"): VLT_6000,
}

# Named with a number in a sister manual or in the text of the protocol, and needed by a virtual drive.
NAMED_ELSEWHERE = {("danfoss-fc", "vlt6000"): numbers("001 201..205 518")}


def model_of(which):
    protocol, name = which
    return load_model(PACKAGES[protocol], protocol, name)


def test_each_packaged_model_is_listed():
    assert set(PRINTED) == {
        (protocol, name) for protocol, package in PACKAGES.items() for name in model_names(package, protocol)
    }


@pytest.mark.parametrize("which", PRINTED, ids="-".join)
def test_model_has_exactly_the_printed_parameters(which):
    assert set(model_of(which).parameters) == {*PRINTED[which], *NAMED_ELSEWHERE.get(which, ())}


@pytest.mark.parametrize("which", PRINTED, ids="-".join)
def test_each_parameter_has_a_source(which):
    assert not [info.address for info in model_of(which).parameters.values() if not info.source]


def test_hearsay_parameters_are_unconfirmed():
    parameters = model_of(("vabus", "guesses")).parameters
    assert {parameters[address].sure for address in HEARSAY} == {"unconfirmed"}


@pytest.mark.parametrize("which", PRINTED, ids="-".join)
def test_parameter_names_of_a_model_are_unique_identifiers(which):
    parameters = model_of(which).parameters.values()
    assert len({info.name for info in parameters}) == len(parameters)
    assert all(info.name.isidentifier() and info.name == info.name.lower() for info in parameters)
