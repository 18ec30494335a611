"""Checks of model files: every mistake is found with its line and key, and a correct file has no findings."""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from drivecomm.errors import FileFormatError, NotSupported, UsageError
from drivecomm.models import check_model, packaged_models, read_model
from drivecomm.protocol import Protocol, installed
from drivecomm.virtual import virtual_drive

HEAD = 'format = 1\nprotocol = "vabus"\nname = "own"\nsource = "a page"\nextends = "act"\n'
PARAMETER = '[[parameter]]\naddress = "481"\nname = "ramp"\ntype = "long"\n'


@pytest.fixture
def check(tmp_path):
    def of_text(text, plugin=None, name="own.toml"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return [(finding.line, finding.key, finding.text) for finding in check_model(path, plugin)]

    return of_text


def test_correct_model_has_no_findings(check):
    assert check(HEAD + PARAMETER) == []


@pytest.mark.parametrize(
    ("printed", "factor"), [("0.01 Hz", "0.01"), ("* 0.1", "0.1"), ("x 100 A", "0.01"), ("Hz", "1"), ("x10", "0.1")]
)
def test_printed_scale_that_agrees_with_the_factor_is_accepted(check, printed, factor):
    assert check(HEAD + PARAMETER + f"factor = '{factor}'\nprinted = '{printed}'\n") == []


def test_finding_names_file_line_and_key(tmp_path):
    path = tmp_path / "own.toml"
    path.write_text(HEAD + PARAMETER + 'minimum = "2"\nmaximum = "1"\n', encoding="utf-8")
    [finding] = check_model(path)
    assert str(finding) == f"{path}, line 10: minimum: 2 is above the maximum of 1"
    path.write_text(HEAD + "[[parameter]]\naddress = '481'\n", encoding="utf-8")
    [finding] = check_model(path)
    assert str(finding) == f"{path}, line 6: parameter: the key 'name' is missing"


@pytest.mark.parametrize(
    ("text", "line", "key", "what"),
    [
        # Mistakes that the loader refuses as well.
        ("format = 1", 1, "protocol", "installed are ct-ansi, danfoss-fc, ei-bisynch, fuji, "),
        ("no toml", 1, "", "cannot be read as a model: "),
        (HEAD + "a = 1\na = 2\n", 7, "", "cannot be read as a model: "),
        (HEAD.replace("1", "2"), 1, "format", "a model begins with format = 1"),
        (HEAD.replace('"own"', "7"), 3, "name", "7 is not a text"),
        (HEAD.replace("vabus", "vabuz"), 2, "protocol", "no installed protocol is named 'vabuz'"),
        (HEAD + 'tittle = "x"\n', 6, "tittle", "unknown key 'tittle'; did you mean 'title'?"),
        (HEAD + "[faults]\nfive = 'overload'\n", 7, "five", "'five' is not a whole number"),
        (HEAD + "[faults]\n16 = 'overload'\n0x10 = 'short'\n", 8, "0x10", "'0x10' is the same as '16'"),
        (HEAD + "[identified_by]\nserial = '('\n", 7, "serial", "'(' is not a regular expression"),
        (HEAD + "options = 3\n", 6, "options", "is not a table; write [options] and its keys below"),
        (HEAD + "fault_log = '481'\n", 6, "fault_log", "names parameters by their addresses, the newest fault first"),
        (HEAD + "fault_log = ['rump']\n" + PARAMETER, 6, "fault_log", "'rump'; did you mean 'ramp'?"),
        (HEAD + "fault_log = ['481']\n" + PARAMETER + "access = 'w'\n", 6, "fault_log", "cannot be read"),
        (HEAD + "quantities = 3\n", 6, "quantities", "is not a table; write [quantities]"),
        (HEAD + "parameter = 3\n", 6, "parameter", "parameters are tables"),
        (HEAD + "[quantities]\nenergy = 3\n", 7, "energy", "3 is not a parameter address"),
        (HEAD + PARAMETER + "factor = '0'\n", 10, "factor", "steps of 0"),
        (HEAD + PARAMETER + "printed = '0.01 s'\n", 10, "printed", "says a factor of 0.01, and the factor here is 1"),
        (HEAD + PARAMETER + "factor = '100'\nprinted = 'x 100 s'\n", 11, "printed", "says a factor of 0.01"),
        (HEAD + PARAMETER + "printed = 'steps 0 s'\n", 10, "printed", "'steps 0 s' says no scale"),
        (HEAD + "[sources]\nstatus = 'a page'\n", 7, "status", "names documents or programs"),
        (HEAD + "[sources]\nstate = ['a page']\n", 7, "state", "did you mean 'status'?"),
        (HEAD + PARAMETER + "sure = 'perhaps'\n", 10, "sure", "it is one of printed, derived, field, unconfirmed"),
        (HEAD + PARAMETER + "values = { 1 = 2 }\n", 10, "values", "2 is not a text"),
        (HEAD + PARAMETER + "only_with = { 412 = 2 }\n", 10, "only_with", "names other parameters, each with a list"),
        (HEAD + PARAMETER + "only_with = { 412 = [] }\n", 10, "only_with", "names other parameters, each with a list"),
        (HEAD + PARAMETER + "only_with = 3\n", 10, "only_with", "names other parameters, each with a list"),
        (HEAD + PARAMETER + "only_with = { 999 = [2] }\n", 10, "only_with", "there is no parameter '999'"),
        (HEAD + PARAMETER.replace("long", "string") + "start = 1\n", 10, "start", "1 is not a text"),
        (HEAD.replace("act", "none"), 5, "extends", "there is no model 'none' beside this one or among"),
        (HEAD.replace('"act"', "[]"), 5, "extends", "[] is not a text"),
        (HEAD.replace("act", "../act"), 5, "extends", "there is no model '../act' beside this one or among"),
        (HEAD.replace("act", "own"), 5, "extends", "extends itself, through own"),
        # Entries that must agree with each other.
        (HEAD.replace("a page", "") + PARAMETER, 6, "", "parameter 481: its source is missing"),
        (HEAD + PARAMETER * 2, 11, "address", "481 is listed twice"),
        (HEAD + PARAMETER + PARAMETER.replace("481", "482"), 12, "name", "ramp is parameter 481 already"),
        (HEAD + PARAMETER.replace("ramp", "Ramp 1"), 8, "name", "'Ramp 1' is not a name; use lower case"),
        (HEAD + PARAMETER.replace("ramp", "energy"), 8, "name", 'say energy = "481" under [quantities]'),
        (HEAD + PARAMETER + 'maximum = "5"\nstart = "6"\n', 11, "start", "6 is not within the maximum of 5"),
        (
            HEAD + PARAMETER + 'unit = "Hz"\nminimum = "1"\nmaximum = "5"\nstart = "0"\n',
            13,
            "start",
            "0 Hz is not within the minimum of 1 Hz and the maximum of 5 Hz",
        ),
        # Common names.
        (HEAD + "[quantities]\nenergie = '481'\n" + PARAMETER, 7, "energie", "no common name; did you mean 'energy'?"),
        (HEAD + "[quantities]\nqqqq = '481'\n" + PARAMETER, 7, "qqqq", "drivecomm models names lists them"),
        (HEAD + "[quantities]\nfault_code = 'rump'\n" + PARAMETER, 7, "fault_code", "'rump'; did you mean 'ramp'?"),
        (HEAD + "[quantities]\nenergy = ''\n" + PARAMETER, 7, "energy", "no other model has mapped it"),
        (HEAD + "[quantities]\nenergy = '481'\n" + PARAMETER, 7, "energy", "has no unit, and energy is given in kWh"),
        (
            HEAD + "[quantities]\nfault_code = '481'\n" + PARAMETER + "unit = 'Hz'\n",
            7,
            "fault_code",
            "is in Hz, and fault_code is without one",
        ),
        (HEAD + "[quantities]\npower_ups = '481'\n" + PARAMETER + "access = 'w'\n", 7, "power_ups", "cannot be read"),
        # The watchdog.
        (HEAD + "[watchdog]\nsauce = 'x'\ntime = '481'\n", 7, "sauce", "unknown key 'sauce'; did you mean 'source'?"),
        (HEAD + "[watchdog]\nactions = { trip = 0 }\n", 6, "time", "a watchdog names the parameter with its time"),
        (HEAD + "[watchdog]\ntime = '481'\nactions = { stop = 1 }\n", 8, "actions", "hold, ramp, coast, trip"),
        (HEAD + "[watchdog]\ntime = '7'\nactions = { trip = 0 }\n", 7, "time", "there is no parameter '7'"),
        (HEAD + "[watchdog]\ntime = '481'\nactions = { trip = 0 }\n" + PARAMETER, 7, "time", "and a time is in s"),
        (
            HEAD + "[watchdog]\ntime = '481'\nactions = { trip = 0 }\n" + PARAMETER + "unit = 's'\naccess = 'w'\n",
            7,
            "time",
            "parameter 481 cannot be read",
        ),
        (
            HEAD + "[watchdog]\ntime = '481'\naction = '482'\nactions = { trip = 5 }\n"
            + PARAMETER + "unit = 'ms'\n" + PARAMETER.replace("481", "482").replace("ramp", "what")
            + "values = { 0 = 'off', 1 = 'stop' }\n",
            9,
            "actions",
            "trip = 5, and parameter 482 accepts 0, 1",
        ),
        (
            HEAD + "[watchdog]\ntime = '481'\nactions = { trip = 0, hold = 1 }\n" + PARAMETER + "unit = 's'\n",
            8,
            "actions",
            "a drive has exactly one reaction",
        ),
        (
            HEAD + "[watchdog]\ntime = '481'\naction = 5\nactions = { trip = 0 }\n" + PARAMETER + "unit = 's'\n",
            8,
            "action",
            "invalid value 5",
        ),
        (HEAD + "[watchdog]\ntime = '481'\nactions = { trip = 0 }\nfault = '5'\n", 9, "fault", "is not a fault code"),
        (
            HEAD + "[watchdog]\ntime = '481'\nactions = { trip = 0 }\nfault = 5\n" + PARAMETER + "unit = 's'\n",
            9,
            "fault",
            "[faults] has no fault 5",
        ),
        (
            HEAD
            + "[watchdog]\ntime = '481'\nactions = { ramp = 0 }\nfault = 5\n[faults]\n5 = 'silent'\n"
            + PARAMETER
            + "unit = 's'\n",
            9,
            "fault",
            "no action of this watchdog trips",
        ),
        (
            HEAD + "[watchdog]\ntime = '481'\nactions = { trip = 0 }\nsure = 'no'\n" + PARAMETER + "unit = 's'\n",
            9,
            "sure",
            "invalid value 'no'; it is one of printed",
        ),
        (
            HEAD.replace("a page", "") + "[watchdog]\ntime = '481'\nactions = { trip = 0 }\n"
            + PARAMETER + "unit = 's'\nsource = 'page 2'\n",
            6,
            "",
            "its source is missing; name the manual and the page under source",
        ),
        # Rules of the protocol package.
        (HEAD + "[options]\nram_dataset = true\n", 7, "ram_dataset", "no such option; did you mean 'ram_datasets'?"),
        (HEAD + "[options]\nqqqq = true\n", 7, "qqqq", "vabus drives have no such option; they have "),
        (HEAD + "[options]\nram_datasets = 'false'\n", 7, "ram_datasets", "invalid value 'false'"),
        (HEAD + "[options]\nbytesize = 9\n", 7, "bytesize", "9 data bits are not possible"),
        (HEAD + "[options]\ngap_s = 'long'\n", 7, "gap_s", "invalid gap_s = 'long'; give a number"),
        (HEAD + PARAMETER + "dataset = 4\n", 10, "dataset", "key 'dataset'; did you mean 'datasets'?"),
        (HEAD + PARAMETER + "qqqq = 4\n", 10, "qqqq", "the keys are access, address, datasets, factor"),
        (HEAD + PARAMETER.replace("481", "4x8"), 7, "address", "is not a VABus parameter address"),
        (HEAD + PARAMETER.replace("481", "1600"), 7, "address", "is beyond 1599"),
        (HEAD + PARAMETER.replace("long", "longish"), 9, "type", "longish"),
        (HEAD + PARAMETER + "factor = '0.1'\nstart = '0.05'\n", 11, "start", "is not a multiple of 0.1"),
    ],
)  # fmt: skip
def test_each_mistake_is_found_with_its_line_and_key(check, text, line, key, what):
    found = check(text)
    assert len(found) == 1, found
    assert found[0][:2] == (line, key)
    assert what in found[0][2]


def test_check_reports_all_mistakes_of_a_file_in_order(check):
    lines = (
        'format = 1\nprotocol = "vabus"\nname = "own"\nsource = "a page"\nextends = "act"\ncolour = "red"\n'
        "[options]\nsystem = 1\nram_datasets = true\n"
        '[quantities]\nenergie = "481"\n'
        '[[parameter]]\naddress = "480"\nname = "first"\nsure = "perhaps"\nunit = 3\n'
        '[[parameter]]\naddress = "4x8"\nname = "second"\ndataset = 4\n'
        '[[parameter]]\naddress = "482"\nname = "third"\ntype = "long"\nminimum = "2"\nmaximum = "1"\n'
        '[[parameter]]\naddress = "483"\nname = "third"\ntype = "longish"\n'
    )
    wanted = ["colour", "system", "energie", "sure", "unit", "address", "dataset", "minimum", "name", "type"]
    found = check(lines)
    assert [key for _, key, _ in found] == wanted
    shown = lines.splitlines()
    assert [shown[line - 1].partition(" ")[0] for line, _, _ in found] == wanted, "the line is that of the key"


def test_missing_file_is_a_finding(tmp_path):
    [finding] = check_model(tmp_path / "none.toml")
    assert str(finding) == f"{tmp_path / 'none.toml'}: there is no such file"


def test_inherited_mapping_is_reported_at_the_parameter_that_contradicts_it(check, tmp_path):
    (tmp_path / "base.toml").write_text(
        HEAD.replace('"own"', '"base"') + "[quantities]\nacceleration_time = '481'\n" + PARAMETER + "unit = 's'\n",
        encoding="utf-8",
    )
    own = HEAD.replace("act", "base")
    assert check(own) == []
    # The parameter that the base model has mapped gets another unit.
    [(line, key, text)] = check(own + PARAMETER + "unit = 'Hz'\n")
    assert (line, key) == (10, "unit")
    assert text == "parameter 481 is in Hz, and acceleration_time is given in s"
    assert check(own + "[quantities]\nacceleration_time = ''\n" + PARAMETER + "unit = 'Hz'\n") == []


def test_mistake_in_the_base_model_is_reported_with_the_line_of_the_base(check, tmp_path):
    (tmp_path / "base.toml").write_text(HEAD + "options = 1\n", encoding="utf-8")
    [(line, key, text)] = check(HEAD.replace("act", "base"))
    assert (line, key) == (5, "extends")
    assert f"{tmp_path / 'base.toml'}, line 6: options: is not a table" in text


def test_unit_of_a_mapped_array_element_is_checked(check):
    head = HEAD.replace("vabus", "vlt3500").replace("act", "vlt2000")
    element = '[[parameter]]\naddress = "502[20]"\nname = "cooling"\nunit = "degC"\naccess = "r"\nindexed = [1]\n'
    assert check(head + "[quantities]\nheat_sink_temperature = '502[20]'\n" + element) == []
    [(_, key, text)] = check(head + "[quantities]\nheat_sink_temperature = '502[20]'\n" + element.replace("degC", "Hz"))
    assert (key, text) == (
        "heat_sink_temperature",
        "parameter 502[20] is in Hz, and heat_sink_temperature is given in degC",
    )


def test_fuji_data_format_is_checked_as_the_type(check):
    head = HEAD.replace("vabus", "fuji").replace("act", "g11s") + '[options]\nprofile = "g11s"\n'
    parameter = '[[parameter]]\naddress = "F99"\nname = "own"\ntype = "[99]"\n'
    found = check(head + parameter)
    assert [(line, key) for line, key, _ in found] == [(9, "address")], "numbers of this generation end at 49"
    found = check(head + parameter.replace("F99", "F40"))
    assert [(line, key) for line, key, _ in found] == [(11, "type")]
    assert "is not a data format" in found[0][2]


def altered(**how) -> Protocol:
    return replace(installed["vabus"], **how)


def test_unknown_parameter_keys_pass_if_the_protocol_declares_none(check):
    assert check(HEAD + PARAMETER + "qqqq = 4\n", altered(parameter_keys=None)) == []


def test_failure_to_make_a_virtual_drive_is_a_finding(check):
    real = installed["vabus"].virtual

    def picky(address, options, model):
        for info in model.parameters.values():
            if info.extra.get("datasets") == 7:
                raise KeyError("seven")
        return real(address, options, model)

    both = HEAD + PARAMETER + PARAMETER.replace("481", "482").replace("ramp", "other") + "datasets = 7\n"
    [(line, key, text)] = check(both, altered(virtual=picky))
    assert (line, key) == (10, "")
    assert text == "parameter 482: no virtual drive can be made with it (KeyError: 'seven')"

    def never(*_):
        raise RuntimeError("no")

    [(line, key, text)] = check(HEAD + "[faults]\n1 = 'x'\n", altered(virtual=never))
    remedy = "extend a model that has what a drive needs, such as extends = 'agile'"
    assert (line, key, text) == (1, "", f"no virtual drive can be made with it (RuntimeError: no); {remedy}")


def test_failing_peek_of_the_virtual_drive_is_a_finding(check):
    class Blind:
        def __init__(self, *_):
            pass

        def peek(self, parameter, _):
            raise ZeroDivisionError(parameter)

    [(_, _, text)] = check(HEAD + PARAMETER, altered(virtual=Blind))
    assert text == "parameter 481: no virtual drive can be made with it (ZeroDivisionError: 481)"


def test_exception_in_the_protocol_package_is_a_finding(check):
    real = installed["vabus"].operations

    class Clumsy:
        def __init__(self, *values):
            self.real = real(*values)

        def read(self, parameter):
            if parameter == "482":
                raise IndexError(parameter)
            return self.real.read(parameter)

        def write(self, *_, **__):
            raise LookupError

    class Unwritable(Clumsy):
        def read(self, parameter):
            raise NotSupported(f"{parameter} cannot be read")

        def write(self, *_, **__):
            raise UsageError("not over this line")

    assert check(HEAD + PARAMETER + "start = '1'\n", altered(operations=Unwritable)) == []

    other = PARAMETER.replace("481", "482").replace("ramp", "other")
    found = check(HEAD + PARAMETER + "start = '1'\n" + other, altered(operations=Clumsy))
    assert found == [(11, "", "parameter 482: IndexError: 482")]

    def never(*_):
        raise RuntimeError("no")

    [(line, key, text)] = check(HEAD + PARAMETER, altered(operations=never))
    assert (line, key, text) == (1, "options", "no drive of vabus can have these together: RuntimeError: no")


def test_options_that_exclude_each_other_are_a_finding(check):
    head = HEAD.replace("vabus", "vlt3500").replace("act", "vlt2000") + "[options]\nminimum_hz = 60\n"
    assert check(head) == []
    [(line, key, text)] = check(head + "maximum_hz = 50\n")
    assert (line, key) == (6, "options")
    assert "minimum_hz is at least 0 and below maximum_hz" in text


@pytest.mark.parametrize("protocol", ["fuji", "vlt3500"])
def test_packaged_models_have_no_findings(protocol):
    plugin = installed[protocol]
    paths = packaged_models(plugin.package)
    assert len(paths) >= 3
    assert [str(finding) for path in paths for finding in check_model(path)] == []


def test_model_of_few_parameters_is_valid_but_makes_no_virtual_drive(check, tmp_path):
    text = HEAD.replace('extends = "act"\n', "") + PARAMETER
    assert check(text) == []
    path = tmp_path / "few.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(UsageError, match=r"it lacks parameters that a drive works with; .*extends = 'agile'"):
        virtual_drive("vabus", 1, model=path)


ODD_VALUES = (
    "1",
    '"x"',
    "[]",
    "{ a = 1 }",
    "true",
    "nan",
    "-1e99",
    '"999999999999"',
    "2026-01-01",
    '""',
    "{ 1 = 'x' }",
)
SEEDS = [path for plugin in installed.working() for path in packaged_models(plugin.package)]


@st.composite
def damaged(draw):
    """Draw a packaged model with some of its lines lost, doubled or changed."""
    path = draw(st.sampled_from(SEEDS))
    lines = path.read_text(encoding="utf-8").splitlines()
    # Keep the head and a few parameters, so that most of the damage hits lines that matter.
    starts = [number for number, line in enumerate(lines) if line == "[[parameter]]"]
    first = starts[0] if starts else len(lines)
    kept = lines[:first]
    for number in draw(st.lists(st.sampled_from(range(len(starts))), max_size=4)) if starts else ():
        kept += lines[starts[number] : starts[number + 1] if number + 1 < len(starts) else len(lines)]
    for _ in range(draw(st.integers(0, 4))):
        number = draw(st.integers(0, len(kept) - 1))
        key, equals, _value = kept[number].partition(" = ")
        what = draw(st.sampled_from(["lose", "double", "change", "change", "change"]))
        if what == "change" and equals:
            kept[number] = f"{key} = {draw(st.sampled_from(ODD_VALUES))}"
        elif what == "double":
            kept.insert(number, kept[number])
        elif len(kept) > 1:
            del kept[number]
    return path, "\n".join(kept)


@pytest.mark.soak
@given(damaged())
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_damaged_model_is_checked_at_least_as_strictly_as_by_the_loader(damage):
    """Check that damage raises nothing and that each refusal of the loader is a finding.

    A model without findings must make a virtual drive, unless it lacks parameters that a drive works with.
    """
    seed, text = damage
    plugin = next(each for each in installed.working() if seed in packaged_models(each.package))
    with TemporaryDirectory() as folder:
        path = Path(folder) / "own.toml"
        path.write_text(text, encoding="utf-8")
        found = check_model(path, plugin)
        lines = text.count("\n") + 1
        assert all(1 <= finding.line <= lines and finding.text for finding in found)
        refusal = ""
        try:
            read_model(path, plugin.name, plugin.package)
        except FileFormatError as error:
            refusal = str(error)
        if refusal:
            assert any(finding.text in refusal for finding in found), refusal
        elif not found:
            # A model may list few parameters and still be valid.
            too_short = ""
            try:
                drive = virtual_drive(plugin.name, plugin.addresses[0], model=path)
            except UsageError as error:
                too_short = str(error)
            assert "lacks parameters that a drive works with" in too_short or drive.address == plugin.addresses[0]
