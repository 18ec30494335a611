from .findings import Finding as Finding, Verdict as Verdict
from .proving import Proving as Proving, Subject as Subject, questions as questions
