"""Experiments: a study declares cases, the `critflow` command computes, stores, labels and verifies them."""

from critflow.workflow.claim import Claim
from critflow.workflow.plan import decimals, stable_rng
from critflow.workflow.study import Axis, AxisLabel, Coordinate, Study, Variable

__all__ = ["Axis", "AxisLabel", "Claim", "Coordinate", "Study", "Variable", "decimals", "stable_rng"]
