from .applying import (
    Applied as Applied,
    apply_proof as apply_proof,
    disagreements as disagreements,
    marks_of as marks_of,
)
from .findings import Finding as Finding, Verdict as Verdict
from .moving import Moving as Moving
from .proving import Proving as Proving, Subject as Subject, questions as questions
from .recording import ProofRecord as ProofRecord
from .report import Proof as Proof, proof_text as proof_text, read_proof as read_proof
