"""Effects of proofs on the facts of a model: the table [proofs] of its file.

A proof is about one series: a fact that a model takes over by `extends` keeps the mark that its sources give it, unless
a drive of the other series has contradicted it.
"""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from drivecomm.errors import UsageError, did_you_mean, shortened
from drivecomm.models.quantities import parameter_at
from drivecomm.models.schema import Mistake
from drivecomm.models.support import addresses_behind
from drivecomm.protocol import WATCHDOG_PROOF, Proved

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from drivecomm.protocol import Model, ParameterInfo


def with_proofs(model: Model, own: Mapping[str, Mapping[str, Any]]) -> Model:
    """Return a model with the marks that proofs give its facts. own: the table of its file, without mistakes."""
    proofs: dict[str, Proved] = {}
    parameters = dict(model.parameters)
    for address, given in own.items():
        info = parameters.get(address)
        if info is not None:
            proofs[address] = Proved(sure=given["sure"], proof=given["proof"], before=info.sure)
            parameters[address] = replace(info, sure=given["sure"], proof=given["proof"])
    watchdog = model.watchdog
    if watchdog is not None and WATCHDOG_PROOF in own:
        given = own[WATCHDOG_PROOF]
        proofs[WATCHDOG_PROOF] = Proved(sure=given["sure"], proof=given["proof"], before=watchdog.sure)
        watchdog = replace(watchdog, sure=given["sure"])
    if not proofs:
        return model
    return replace(model, parameters=MappingProxyType(parameters), watchdog=watchdog, proofs=MappingProxyType(proofs))


def with_confirmed(model: Model | None, names: Iterable[str]) -> Model:
    """Return a model with facts that a person has checked on their own drive, by address, name or common name.

    Raises UsageError for a parameter that the model does not have, and for one that a proof contradicts.
    """
    if model is None:
        raise UsageError("only facts of a model can be confirmed; name the drive's model")
    if isinstance(names, str) or not all(isinstance(each, str) for each in names):
        raise UsageError(f"invalid confirmed = {shortened(names)}; give a list of parameters by address or name")
    parameters = dict(model.parameters)
    for name in names:
        info = parameter_at(model.quantities.get(name, name), model)
        if info is None:
            known = sorted({*model.quantities, *(each.name for each in parameters.values())})
            wrong = f"model {model.name} has no parameter {shortened(name)} that could be confirmed"
            raise UsageError(f"{wrong}; {did_you_mean(name, known) or 'drivecomm models show lists them'}")
        if info.sure == "contradicted":
            raise UsageError(f"{name} cannot be confirmed, because {info.proof} contradicts it; correct it in a model")
        parameters[info.address] = replace(info, sure="drive", proof="confirmed for this drive")
    return replace(model, parameters=MappingProxyType(parameters))


def without_proofs(model: Model) -> Model:
    """Return a model whose facts have only the marks that its sources give them."""
    if not model.proofs:
        return model
    parameters = {address: _as_before(info, model.proofs.get(address)) for address, info in model.parameters.items()}
    watchdog, proved = model.watchdog, model.proofs.get(WATCHDOG_PROOF)
    if watchdog is not None and proved is not None:
        watchdog = replace(watchdog, sure=proved.before)
    return replace(model, parameters=MappingProxyType(parameters), watchdog=watchdog, proofs=MappingProxyType({}))


def inherited_proofs(base: Model) -> Mapping[str, Mapping[str, Any]]:
    """Return the proofs of a model that another series inherits: contradicted facts."""
    return {
        address: {"sure": each.sure, "proof": each.proof}
        for address, each in base.proofs.items()
        if each.sure == "contradicted"
    }


def table_of(model: Model) -> dict[str, dict[str, Any]]:
    """Return the table [proofs] that gives a model its marks."""
    return {address: {"sure": each.sure, "proof": each.proof} for address, each in model.proofs.items()}


def contradicted(model: Model) -> list[str]:
    """Return the facts that a drive has contradicted: addresses of parameters, and "the watchdog"."""
    return [
        "the watchdog" if address == WATCHDOG_PROOF else address
        for address, each in model.proofs.items()
        if each.sure == "contradicted"
    ]


def contradicted_orders(model: Model) -> list[str]:
    """Return the addresses of contradicted parameters that a command, the status or a reference uses."""
    against = set(contradicted(model))
    if not against:
        return []
    return [each for each in dict.fromkeys(addresses_behind(model.control)) if each in against]


def broken_proofs(own: Mapping[str, Any], model: Model) -> Iterator[Mistake]:
    """Yield the invalid marks of a file, and each command that a drive has contradicted."""
    for address in own:
        if address == WATCHDOG_PROOF and model.watchdog is None:
            yield Mistake(table="proofs", key=address, text="the model has no watchdog")
        elif address != WATCHDOG_PROOF and address not in model.parameters:
            yield Mistake(table="proofs", key=address, text=f"there is no parameter {address!r}")
    try:
        against = contradicted_orders(model)
    except (TypeError, AttributeError, LookupError):
        # A malformed table [control] is reported by the trials.
        return
    for address in against:
        text = f"a command or the status rests on {address}, which a drive has contradicted; correct the fact"
        yield Mistake(table="proofs", key=address, text=text)


def _as_before(info: ParameterInfo, proved: Proved | None) -> ParameterInfo:
    return info if proved is None else replace(info, sure=proved.before, proof="")
