from .applying import (
    AppliedMarks as AppliedMarks,
    apply_proof as apply_proof,
    disagreements as disagreements,
    marks_of as marks_of,
)
from .findings import ProofFinding as ProofFinding, Verdict as Verdict
from .motor_trial import Moving as Moving
from .proving import ProofSubject as ProofSubject, Proving as Proving, questions as questions
from .recording import ProofRecord as ProofRecord
from .report import Proof as Proof, proof_text as proof_text, read_proof as read_proof
