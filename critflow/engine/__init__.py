"""Experiments: a study declares cases, the `critflow` command computes, stores, labels and verifies them."""

from critflow.engine.settings import decimals, stable_rng
from critflow.engine.study import Axis, AxisLabel, Claim, Coordinate, Study, Variable

__all__ = ["Axis", "AxisLabel", "Claim", "Coordinate", "Study", "Variable", "decimals", "stable_rng"]
