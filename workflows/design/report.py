"""Claims and summary of the study, module by module."""

from __future__ import annotations

from .parts import name_of, reported


def claims_of(modules):
    """The function that makes the claims of all modules that were run."""
    return lambda ds: [claim for _, made in reported(ds, modules, "claims") for claim in made]


def summary_of(modules):
    """The function that makes the summary of all modules that were run."""
    return lambda ds: {
        "seeds": ds.seed.values.tolist(),
        **{name_of(module): made for module, made in reported(ds, modules, "summary")},
    }
