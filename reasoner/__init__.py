"""OWL 2 RL closure, contradictions and proofs over the shared graph."""

from .closure import Closure, Config, InconsistentError, Staged
from .contradictions import Contradiction
from .delta import ClosureTooLargeError
from .entail import Entailment, entails
from .profile import ProfileViolation, check_profile
from .proofs import Proof
from .shacl import ShaclReport, validate
from .strata import StratificationError
from .user_rules import RuleError

__all__ = [
    "Closure",
    "ClosureTooLargeError",
    "Config",
    "Contradiction",
    "Entailment",
    "InconsistentError",
    "ProfileViolation",
    "Proof",
    "RuleError",
    "ShaclReport",
    "Staged",
    "StratificationError",
    "check_profile",
    "entails",
    "validate",
]
