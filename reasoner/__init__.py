"""OWL 2 RL closure, contradictions and proofs over the shared graph."""

from .checks import Contradiction
from .closure import Closure, Config, InconsistentError, Staged
from .delta import ClosureTooLargeError
from .proofs import Proof
from .strata import StratificationError
from .user_rules import RuleError

__all__ = [
    "Closure",
    "ClosureTooLargeError",
    "Config",
    "Contradiction",
    "InconsistentError",
    "Proof",
    "RuleError",
    "Staged",
    "StratificationError",
]
