"""Names of schema 3 in datasets, and what they are called since schema 4."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from critflow.workflow.study import nearest

VARIABLES = {
    "coordinates": "position",
    "bulk_modulus_0": "B_0",
    "shear_modulus_0": "G_0",
    "bulk_modulus": "B",
    "shear_modulus": "G",
    "shear_modulus_stress_corrected": "G_stress_corrected",
    "C_B": "C_B_fit",
    "C_G": "C_G_fit",
    "C_G_stress_corrected": "C_G_stress_corrected_fit",
    "C_B_error": "C_B_fit_standard_error",
    "C_G_error": "C_G_fit_standard_error",
    "C_G_stress_corrected_error": "C_G_stress_corrected_fit_standard_error",
    "C_B_exact": "C_B",
    "C_G_exact": "C_G",
    "C_G_stress_corrected_exact": "C_G_stress_corrected",
    "length_variance": "V_L",
    "tension_variance": "V_tau",
}
# Error bounds are called after their variables.
_BOUNDED = (
    *("coordinates", "bulk_modulus_0", "shear_modulus_0", "bulk_modulus", "shear_modulus"),
    *("shear_modulus_stress_corrected", "C_B_exact", "C_G_exact", "C_G_stress_corrected_exact"),
)
VARIABLES |= {f"{name}_error_bound": f"{VARIABLES[name]}_error_bound" for name in _BOUNDED}
# The shape anisotropies have another definition too, so that their old values keep their old names.
REPLACED = {"anisotropy_physical": "kappa_phys", "anisotropy_force": "kappa_force"}
POPULATIONS = {
    "length_variance": "min_V_L",
    "tension_variance": "min_V_tau",
    "bulk_modulus": "max_B_0",
    "shear_modulus": "max_G_0",
    "random_lengths_wide": "random_lengths_transition",
    # Rest lengths of spread 0.1 at the transition are no population of the studies any more.
    "random_lengths": "random_lengths_narrow",
}


def hint(word: str, known: Sequence[str], noun: str, former: Mapping[str, str]) -> str:
    """End of a message about an unknown word: its present name if it is a former one, else the closest known word."""
    present = former.get(word)
    return f"it is called {present!r} now" if present in known else nearest(word, known, noun)
