"""The public functions: those at the top level, and those of modules that the reference of the documents lists."""

import inspect
from importlib import import_module


import critflow

NAMES = sorted(critflow.__all__)
"""The names at the top level."""

IN_MODULES = {
    "taut_part": ("backbone",),
    "isogonal": ("face_modes",),
    "quantities": ("transition_modulus", "stress_hessian", "flat_directions"),
    "extras.cables.rigidity_surface": ("strain_plane",),
    "extras.certificates.spaces": ("zero_modes",),
    "extras.design_stiffness.stiffnesses": ("isotropic_targets",),
    "extras.hessian.splits": ("geometric_split", "hookean_split", "bond_operator"),
    "extras.local.diagonals": ("face_diagonals", "response_name"),
    "extras.local.drawing": ("draw_response",),
    "extras.tensegrity.second_order": ("second_order_rigidity",),
    "extras.tensegrity.signed_stress": ("signed_stress",),
    "extras.weak.soft_spectrum": ("soft_spectrum",),
    "extras.weak.weak_equilibrium": ("weak_equilibrium",),
    "points": ("random_sequential_addition",),
    "deformation": ("deformation_of",),
    "faces": ("planar_faces",),
}
"""Further functions whose arguments are checked, by module."""


def checked_functions():
    """Functions by name whose arguments are checked: of the top level and of modules, without deleted extras."""
    functions = {name: f for name in NAMES if inspect.isfunction(f := getattr(critflow, name, None))}
    for module, names in IN_MODULES.items():
        if not module.startswith("extras.") or not absent([module.split(".")[1]]):
            functions |= {name: getattr(import_module(f"critflow.{module}"), name) for name in names}
    return functions
