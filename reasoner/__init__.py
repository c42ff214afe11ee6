"""OWL 2 RL closure, contradictions and proofs over a graph."""

from reasoner.causes import Cause
from reasoner.closure import Closure, Staged
from reasoner.config import Config, InconsistentError
from reasoner.contradictions import Contradiction
from reasoner.decisions import Refutation, Undecided
from reasoner.dl.profile import ProfileViolation, check_profile
from reasoner.entail import Entailment, entails
from reasoner.following import Follower
from reasoner.fork import Fork
from reasoner.proofs import Decision, Proof
from reasoner.rules.strata import StratificationError
from reasoner.rules.user_rules import LabelledRule, RuleError
from reasoner.rules.work import ChangeBudget, ClosureTooLargeError, NeedsRebuildError
from reasoner.shacl import ShaclReport, validate

__all__ = [
    "Cause",
    "ChangeBudget",
    "Closure",
    "ClosureTooLargeError",
    "Config",
    "Contradiction",
    "Decision",
    "Entailment",
    "Follower",
    "Fork",
    "InconsistentError",
    "LabelledRule",
    "NeedsRebuildError",
    "ProfileViolation",
    "Proof",
    "Refutation",
    "RuleError",
    "ShaclReport",
    "Staged",
    "StratificationError",
    "Undecided",
    "check_profile",
    "entails",
    "validate",
]
