"""Requirements for a file in the folder `proofs`."""

import re

from drivecomm.models import load_model
from drivecomm.protocol import installed
from drivecomm.proving import disagreements, read_proof

NAME = re.compile(r"[a-z0-9.-]+-\d{4}-\d{2}-\d{2}(-[a-z0-9-]+)?\.toml")
_WORDS_OF_A_PLATE = 2


def faults_of(path):
    """Yield the reasons why a file does not belong in the folder, as sentences."""
    proof = read_proof(path)
    begin = f"{proof.protocol}-{proof.model}-{proof.date.isoformat()}"
    if not (NAME.fullmatch(path.name) and path.name.startswith(begin)):
        yield f"its name begins with {begin}"
    if proof.virtual:
        yield "it is of a virtual drive, which says what its model says"
    if len(proof.name_plate.split()) < _WORDS_OF_A_PLATE:
        yield "name_plate does not say maker, type and rating as they are printed on the drive"
    plugin = installed[proof.protocol]
    yield from disagreements(proof, load_model(plugin.package, plugin.name, proof.model))
