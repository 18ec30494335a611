"""Commands `models list`, `show`, `check` and `names`: known drive series, their facts, and checks of model files."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

import click

from drivecomm.cli import options
from drivecomm.cli.commands import CliCommand
from drivecomm.cli.models.named import model_named
from drivecomm.cli.output import complain, counted, emit, plain, print_columns, say, tell
from drivecomm.cli.values import FILE
from drivecomm.errors import FileFormatError, ParameterAddressError, UsageError
from drivecomm.models import (
    MONITORING_ONLY,
    check_model,
    contradicted,
    is_monitoring_only,
    link_loss_of,
    load_model,
    model_paths,
    open_model_file,
    packaged_models,
    parameter_at,
    quantities,
    sureness_of_facts,
)
from drivecomm.protocol import DOUBTFUL, installed, resolve_options

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from drivecomm.protocol import Model, ParameterInfo

_NO_ORDERS = f"none, {MONITORING_ONLY}: it is read, and neither commanded nor stopped"

_protocol_option = click.option(
    "--protocol",
    metavar="PROTOCOL",
    shell_complete=options.complete_protocol,
    help="If several protocols have a model of that name.",
)


@click.command("list", cls=CliCommand)
@click.argument(
    "protocol", shell_complete=options.complete_protocol, required=False, help="Default: all installed ones."
)
@options.json
def list_models(*, protocol: str | None, json: bool) -> int:
    """List the models by protocol: name, title, number of parameters, whether it is monitoring only, and its origin."""
    code = 0
    rows = []
    for plugin in [installed[protocol]] if protocol else installed.working():
        own = set(packaged_models(plugin.package))
        for name, path in model_paths(plugin.package, plugin.name).items():
            try:
                model = load_model(plugin.package, plugin.name, path)
            except FileFormatError as error:
                complain(error, as_json=json)
                code = error.exit_code
                continue
            origin = plugin.package if path in own else str(path)
            number, only_read = len(model.parameters), is_monitoring_only(plugin, model)
            if json:
                emit(
                    protocol=plugin.name,
                    model=name,
                    title=model.title,
                    parameters=number,
                    monitoring_only=only_read,
                    origin=origin,
                )
            told = f", {MONITORING_ONLY}" if only_read else ""
            rows.append((f"{plugin.name}/{name}", model.title, f"{number} parameters{told}", origin))
    if not json:
        print_columns(rows)
    return code


@click.command(cls=CliCommand)
@click.argument("model", help="NAME, PROTOCOL/NAME, or a .toml file.")
@click.argument("parameters", metavar="[PARAM...]", nargs=-1, help="Only these, in full detail.")
@_protocol_option
@click.option("--quantities", "common", is_flag=True, help="Only its common names.")
@options.json
def show(*, model: str, parameters: tuple[str, ...], protocol: str | None, common: bool, json: bool) -> int:
    """Show the facts of a drive series: its parameters, common names, watchdog, and the mark of each fact."""
    known = model_named(model, protocol)
    if parameters:
        for number, info in enumerate([_parameter(each, known) for each in parameters]):
            if json:
                emit(parameter=info)
                continue
            if number:
                say()
            _print_parameter(info, known)
    elif json:
        _emit(known, common=common)
    elif common:
        print_columns(_common_rows(known))
    else:
        _print_model(known)
    return 0


@click.command(cls=CliCommand)
@click.argument("files", type=FILE, metavar="[FILE...]", nargs=-1, help="Default: all that drivecomm finds by name.")
@options.json
def check(*, files: tuple[Path, ...], json: bool) -> int:
    """Check model files and list all faults in them. Exit code 2 if there are any."""
    wrong = 0
    for path in files or _all_model_files():
        findings = check_model(path)
        wrong += bool(findings)
        for finding in findings:
            about = {"file": str(path), "line": finding.line, "key": finding.key, "text": finding.text}
            tell(str(finding), as_json=json, **about)
        if json:
            emit(file=str(path), findings=len(findings))
        elif not findings:
            say(f"{path}: in order{_contradicted(path)}")
    if not files and not wrong:
        marks = sureness_of_facts()
        all_of_them, weak = marks.total(), sum(marks[mark] for mark in DOUBTFUL)
        share = f"{100 * weak / max(all_of_them, 1):.1f}"
        if json:
            emit(facts=all_of_them, unconfirmed_percent=float(share), **marks)
        else:
            facts = f"{all_of_them} facts of packaged models (parameters and panel settings)"
            say(f"{facts}, {weak} of them unconfirmed ({share} %)")
    return UsageError.exit_code if wrong else 0


@click.command(cls=CliCommand)
@options.json
def names(*, json: bool) -> int:
    """List the common names with their meaning on every drive, and their unit."""
    if json:
        for quantity in quantities().values():
            emit(**asdict(quantity))
    else:
        print_columns((each.name, each.unit, each.meaning) for each in quantities().values())
    return 0


def _contradicted(path: Path) -> str:
    """Return the facts of a valid model file that a drive has contradicted, as text; empty if there are none."""
    if "proofs" not in (content := open_model_file(path).content):
        return ""
    plugin = installed[content["protocol"]]
    facts = contradicted(load_model(plugin.package, plugin.name, path))
    return f"; a drive has contradicted {', '.join(facts)}, which counts as unconfirmed" if facts else ""


def _all_model_files() -> Iterator[Path]:
    """Yield the files of all models, including packaged ones that a user's file of the same name hides."""
    for plugin in installed.working():
        yield from dict.fromkeys([*model_paths(plugin.package, plugin.name).values(), *packaged_models(plugin.package)])


def _parameter(text: str, model: Model) -> ParameterInfo:
    """Return a parameter of a model by its address, its name or a common name. Raises ParameterAddressError."""
    info = parameter_at(model.quantities.get(text, text), model)
    if info is None:
        raise ParameterAddressError(f"model {model.name} has no parameter {text!r}; drivecomm models show lists them")
    return info


def _print_parameter(info: ParameterInfo, model: Model) -> None:
    say(f"{info.address}  {info.title}")
    common = [name for name, address in model.quantities.items() if parameter_at(address, model) is info]
    about = {
        "name": info.name,
        "common name": ", ".join(common),
        "type": info.type,
        "unit": info.unit,
        "factor": "" if info.factor == 1 else str(info.factor),
        "limits": _limits(info),
        "access": info.access,
        "storage": info.storage,
        "values": ", ".join(f"{code} {text}" for code, text in info.values.items()),
        "counts with": ", ".join(f"{at} = {' or '.join(map(str, codes))}" for at, codes in info.only_with.items()),
        **{key: str(plain(value)) for key, value in info.extra.items()},
        "source": info.source or model.source,
        "sure": info.sure,
        "proof": info.proof,
    }
    print_columns((f"  {key}", text) for key, text in about.items() if text)


def _limits(info: ParameterInfo) -> str:
    low = "" if info.minimum is None else str(info.minimum)
    return low if info.maximum is None else f"{low} to {info.maximum}".lstrip()


def _emit(model: Model, *, common: bool) -> None:
    emit(
        protocol=model.protocol,
        model=model.name,
        title=model.title,
        source=model.source,
        monitoring_only=is_monitoring_only(installed[model.protocol], model),
        options=dict(model.options),
        quantities=dict(model.quantities),
        needs={address: list(raws) for address, raws in model.control.get("needs", {}).items()},
        watchdog=model.watchdog,
        link_loss=link_loss_of(model),
        identified_by=dict(model.identified_by),
        faults=len(model.faults),
        warnings=len(model.warnings),
    )
    for info in [] if common else model.parameters.values():
        emit(parameter=info)


def _print_model(model: Model) -> None:
    say(f"{model.protocol}/{model.name}  {model.title}")
    texts = (("fault", model.faults), ("warning", model.warnings))
    about = {
        "commands": _NO_ORDERS if is_monitoring_only(installed[model.protocol], model) else "",
        "source": model.source,
        "options": ", ".join(f"{name}={value}" for name, value in model.options.items()),
        "identified by": ", ".join(f"{key} = {pattern}" for key, pattern in model.identified_by.items()),
        "keypad": f"{resolve_options(installed[model.protocol], model, {})[0].settings}{_needs(model)}",
        "watchdog": _watchdog(model),
        "link loss": "" if model.watchdog else link_loss_of(model),
        "texts": ", ".join(counted(len(some), what) for what, some in texts if some),
    }
    print_columns((f"  {key}", text) for key, text in about.items() if text)
    common: dict[str, str] = {}
    for name, address in model.quantities.items():
        common.setdefault(address, name)
    say()
    print_columns(_parameter_row(info, common.get(info.address, "")) for info in model.parameters.values())


def _needs(model: Model) -> str:
    """Return the parameters that need certain values before such a drive obeys commands, by its model, as text."""
    told = ""
    for address, raws in model.control.get("needs", {}).items():
        info = parameter_at(address, model)
        name = f" {info.title}" if info else ""
        texts = info.values if info else {}
        allowed = [" ".join(filter(None, (str(raw), texts.get(raw)))) for raw in raws]
        told += f"; {address}{name} = {' or '.join(allowed)}"
    return told


def _watchdog(model: Model) -> str:
    watchdog = model.watchdog
    if watchdog is None:
        return ""
    policies = [f"{policy} {code}" if watchdog.action else policy for policy, code in watchdog.actions.items()]
    action = f"action {watchdog.action} ({', '.join(policies)})" if watchdog.action else f"always {policies[0]}"
    return f"time {watchdog.time}, {action}, {watchdog.sure}" + (f"; {watchdog.note}" if watchdog.note else "")


def _parameter_row(info: ParameterInfo, common: str) -> tuple[str, ...]:
    other = f" [{common}]" if common and common != info.name else ""
    return (info.address, info.name + other, info.unit, _limits(info), info.access, info.storage, info.sure, info.title)


def _common_rows(model: Model) -> Iterator[tuple[str, ...]]:
    for name, quantity in quantities().items():
        address = model.quantities.get(name)
        info = parameter_at(address, model) if address else None
        if address and info:
            yield name, quantity.unit, address, info.title, info.sure
