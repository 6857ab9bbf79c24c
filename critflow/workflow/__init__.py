"""Studies: what a workflow file declares.  The engine that runs them is behind the `critflow` command."""

from critflow.workflow.plan import decimals
from critflow.workflow.seeds import stable_rng
from critflow.workflow.study import Axis, Claim, Coordinate, Study, Variable

__all__ = ["Axis", "Claim", "Coordinate", "Study", "Variable", "decimals", "stable_rng"]
