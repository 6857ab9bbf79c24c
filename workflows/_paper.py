"""Where each equation and figure of the paper lives here: its function, the test that holds it, its verdict.

Keys are the labels of Hain, Santangelo and Manning's source (arXiv:2407.13939).  A verdict other than "holds" says
what differs; figures get theirs from the claims of their studies.
"""

from __future__ import annotations

from typing import NamedTuple


class Equation(NamedTuple):
    """One labelled equation: what it says, the public function or method that computes it, the test that checks it."""

    label: str
    meaning: str
    function: str
    test: str
    verdict: str = "holds"


class Figure(NamedTuple):
    """One labelled figure: what it shows and the study and pictures that reproduce it."""

    label: str
    meaning: str
    study: str
    pictures: tuple[str, ...]


EQUATIONS = (
    Equation(
        "EnergyConstraints", "energy as a sum of squared constraints", "springs.SpringState.energy",
        "test_springs.test_forces_and_hessian_are_derivatives_of_the_energy",
    ),
    Equation(
        "FirstOrder", "motions that change no constraint to first order", "rigidity.zero_modes",
        "test_rigidity.test_all_null_vectors_by_either_way",
    ),
    Equation(
        "RigidityMatrix", "R of Hookean springs", "rigidity.rigidity_matrix",
        "test_rigidity.test_the_matrix_is_the_derivative_of_lengths",
    ),
    Equation(
        "BondVectors", "bond vectors from coordinates and boundary", "network.Network.bond_vectors",
        "test_network.test_bond_vectors_are_differences_plus_boundary",
    ),
    Equation(
        "Equilibrium", "forces from tensions and R", "springs.SpringState.forces",
        "test_springs.test_forces_and_hessian_are_derivatives_of_the_energy",
    ),
    Equation(
        "selfstressdef", "self-stresses: the left null space of R", "rigidity.rigidity",
        "test_rigidity.test_all_null_vectors_by_either_way",
    ),
    Equation(
        "Maxwell-Calladine", "N_0 − N_s = d N_v − N_b", "rigidity.rigidity",
        "test_rigidity.test_critical_configurations",
    ),
    Equation(
        "SecondOrderRigidity", "zero modes that no self-stress stops", "second_order.second_order_rigidity",
        "test_second_order.test_two_strings_of_which_none_holds_the_other",
    ),
    Equation(
        "ForceBalance", "balance of any energy E(h)", "springs.SpringState.forces",
        "test_laws.test_each_function_is_the_derivative_of_the_one_before",
    ),
    Equation(
        "ForceBalanceL", "tensions alone do not fix a configuration", "isogonal.IsogonalModes.walk",
        "test_isogonal.test_the_walk_keeps_directions_tensions_and_bulk_modulus",
    ),
    Equation(
        "ForceDensity", "σ = τ/|L|", "manifold.CriticalConfiguration.tensions",
        "test_springs.test_stress_and_modified_stiffness_by_their_formulas",
    ),
    Equation(
        "ForceBalanceLsqr", "balance of squared lengths, gᵀ(σ ∘ L) = 0", "manifold.CriticalConfiguration.residual",
        "test_manifold.test_the_residual_sees_imbalance",
    ),
    Equation(
        "FDM1", "balance as a linear system for the coordinates", "manifold.CriticalManifold.solve",
        "test_manifold.test_forces_balance_to_rounding",
    ),
    Equation(
        "PrestressMatrix", "P: the Laplacian weighted by σ", "linalg.laplacian",
        "test_linalg.test_laplacian_against_dense",
    ),
    Equation(
        "SelfStressParamaterization_coords", "the configuration x(σ)", "manifold.CriticalManifold.configuration",
        "test_manifold.test_square_octagon_closed_form",
    ),
    Equation(
        "SelfStressParamaterization_bondvecs", "the bond vectors L(σ)", "manifold.CriticalManifold.balance",
        "test_manifold.test_map_is_the_pseudo_inverse_formula",
    ),
    Equation(
        "GenericHessian", "H = RᵀKR + P", "hessian.geometric_split", "test_hessian.test_both_splits_are_the_hessian",
    ),
    Equation(
        "ModifiedStiffness", "K = (k − σ)/|L|²", "springs.SpringState.modified_stiffness",
        "test_springs.test_stress_and_modified_stiffness_by_their_formulas",
    ),
    Equation(
        "SelfStressParamaterization_Lsqr", "the manifold as a surface of half squared lengths",
        "geometry.surface_geometry", "test_geometry.test_tangents_and_metric_match_finite_differences",
    ),
    Equation(
        "projection", "stereographic chart σ(s)", "geometry.StereographicChart.sigma",
        "test_geometry.test_the_chart_covers_the_unit_sphere",
    ),
    Equation(
        "projectionDeriv", "its derivative V", "geometry.StereographicChart.derivative",
        "test_geometry.test_the_transposes_belong_to_their_operators",
    ),
    Equation(
        "TangentVectors", "stress is normal to every curve on the manifold", "manifold.CriticalManifold.response",
        "test_manifold.test_response_is_the_derivative_of_half_squared_lengths",
    ),
    Equation(
        "SelfStressParamaterization_BondVectorDeriv", "∂L/∂σ", "manifold.CriticalManifold.tangent",
        "test_manifold.test_response_is_the_derivative_of_half_squared_lengths",
    ),
    Equation(
        "SelfStressParamaterization_LsqrDeriv", "B = ∂h/∂σ", "manifold.CriticalManifold.response",
        "test_manifold.test_response_is_the_derivative_of_half_squared_lengths",
    ),
    Equation(
        "BondOperator", "RH⁻¹Rᵀ", "hessian.bond_operator",
        "test_hessian.test_a_force_dipole_changes_lengths_by_a_column",
    ),
    Equation(
        "TangentSpace", "tangents BV", "geometry.surface_geometry",
        "test_geometry.test_tangents_and_metric_match_finite_differences",
    ),
    Equation(
        "Metric", "metric VᵀB²V", "geometry.surface_geometry",
        "test_geometry.test_tangents_and_metric_match_finite_differences",
    ),
    Equation(
        "2FF", "second fundamental form", "geometry.surface_geometry",
        "test_geometry.test_second_fundamental_form_matches_finite_differences",
        "differs: finite differences give −VᵀBV/|σ|, the paper prints +; σᵀB = 0 implies σᵀ∂B = −B",
    ),
    Equation(
        "HookeanEnergy", "E = ½Σk(|L| − ℓ)²", "laws.Hookean",
        "test_springs.test_forces_and_hessian_are_derivatives_of_the_energy",
    ),
    Equation(
        "TotalDeriv", "dO/dσ by one more solve", "manifold.CriticalManifold.pull_back",
        "test_objectives.test_gradient_and_hessian_by_taylor_remainders",
    ),
    Equation(
        "GenericModulus", "modulus at the transition for any affine strain", "objectives.transition_modulus",
        "test_moduli.test_transition_moduli_three_ways",
    ),
    Equation(
        "BulkModulus", "B_0", "moduli.transition_moduli",
        "test_objectives.test_bulk_and_shear_by_the_papers_formulas",
    ),
    Equation(
        "BulkModulusHessian", "flat directions at max B_0", "flatness.flat_directions",
        "test_flatness.test_the_largest_bulk_modulus_is_flat_along_scale_and_isogonal_modes",
        "differs: the nullity is N_v/2, the scale of σ and N_v/2 − 1 isogonal modes; the paper prints N_v/2 − 1 = N_f, "
        "and there are N_f = N_v/2 polygons",
    ),
    Equation(
        "BulkModulusAffNonAff", "affine and non-affine parts of B_0", "isogonal.affine_bulk_modulus",
        "test_isogonal.test_the_affine_part_of_the_bulk_modulus",
    ),
    Equation(
        "BulkModulusAffine", "σ = k is the most affine of the stiffest", "supremum.largest_modulus",
        "test_isogonal.test_the_affine_part_of_the_bulk_modulus",
    ),
    Equation(
        "ShearModulus", "G_0", "moduli.transition_moduli",
        "test_objectives.test_bulk_and_shear_by_the_papers_formulas",
    ),
    Equation(
        "ShearMod+Constraint", "G_0 with a penalty on small stresses", "objectives.ConstrainedModulus",
        "test_objectives.test_the_barrier_rises_as_the_tenth_power",
    ),
    Equation(
        "LengthVariance", "V_L", "structure.length_variance", "test_structure.test_variances_by_their_formulas",
    ),
    Equation(
        "TensionVariance", "V_τ", "structure.tension_variance", "test_structure.test_variances_by_their_formulas",
    ),
    Equation(
        "ShapeAnisotropy", "κ of faces and force triangles", "structure.polygon_anisotropy",
        "test_structure.test_the_eigenvalue_formula_and_its_symmetries",
    ),
    Equation(
        "RestLengthVolumetric", "V(γ) = V(0)(1 + γ)", "path.strain_path", "test_path.test_energy_is_the_work_done",
    ),
    Equation(
        "ModulusStrainScaling", "B = B_0 + C_B γ, G = G_0 + C_G γ", "coefficients.stiffening",
        "test_moduli.test_exact_stiffening_is_the_limit_of_fits",
    ),
    Equation(
        "incidenceMatrix", "signed incidence g", "network.Network.incidence",
        "test_network.test_incidence_against_a_dense_one",
    ),
    Equation(
        "BondVectors2", "bond vectors, boundary in b", "network.Network.boundary_vectors",
        "test_network.test_deformation_maps_boundary_and_pins",
    ),
    Equation(
        "RigidityMatrix2", "geometric response matrix R^h", "hessian.geometric_split",
        "test_hessian.test_responses_are_slopes_of_squares_and_lengths",
    ),
    Equation(
        "PrestressMatrix2", "P from second derivatives of h", "hessian.geometric_split",
        "test_hessian.test_both_splits_are_the_hessian",
    ),
    Equation(
        "HookeanRigidityMatrix", "R from lengths", "hessian.hookean_split",
        "test_hessian.test_responses_are_slopes_of_squares_and_lengths",
        "holds; an intermediate step prints a factor L too many",
    ),
    Equation(
        "HookeanPrestressMatrix", "prestress matrix of Hookean constraints", "hessian.hookean_split",
        "test_hessian.test_zero_modes_see_no_difference",
        "differs: the last term is Σ RᵀσR with σ = τ/|L|, the paper prints Σ RᵀτR",
    ),
    Equation(
        "BondVectorFDM", "L(σ) in the supplement", "manifold.CriticalManifold.balance",
        "test_manifold.test_map_is_the_pseudo_inverse_formula",
    ),
    Equation(
        "BondVectorDerivativeFDM2", "∂L/∂σ derived", "manifold.CriticalManifold.tangent",
        "test_manifold.test_response_is_the_derivative_of_half_squared_lengths",
    ),
    Equation(
        "BondVectorDerivativeFDM", "∂h/∂σ derived", "manifold.CriticalManifold.response",
        "test_manifold.test_response_is_the_derivative_of_half_squared_lengths",
    ),
    Equation(
        "tangents", "B = −R^h P⁻¹ R^hᵀ", "manifold.CriticalManifold.response",
        "test_manifold.test_response_is_the_derivative_of_half_squared_lengths",
    ),
    Equation(
        "2FF2", "second fundamental form, derived", "geometry.surface_geometry",
        "test_geometry.test_second_fundamental_form_matches_finite_differences",
        "differs: the derivation takes B = +R^h P⁻¹ R^hᵀ in its last line, against `tangents`",
    ),
)  # fmt: skip

FIGURES = (
    Figure("3-barlinkage", "the critical manifold of the three-bar linkage", "three_bar", ()),
    Figure("CriticalManifoldGeometry", "its grid lines and normals", "three_bar", ()),
    Figure("Networks", "thirteen critical configurations of one network", "gallery", ("gallery",)),
    Figure(
        "ShearModulusSteepestDescent", "unconstrained ascent of G_0 (A–E, Movie 1)", "shear_ascent",
        ("shear_ascent",),
    ),
    Figure(
        "ShearModulusSteepestDescent", "compressed edges against size (F, G)", "shear_ascent_scaling",
        ("compression",),
    ),
    Figure("ShearModulusScaling", "constrained G_0 against size and threshold", "shear_scaling", ("shear_scaling",)),
    Figure("StructuralMetrics", "structure of the populations", "ensemble", ("structure",)),
    Figure("ResponseMetrics", "moduli of the populations", "ensemble", ("response",)),
    Figure("BoundaryTerm", "a small periodic network and its boundary term", "boundary", ("boundary",)),
)  # fmt: skip

# Studies beyond the paper's figures.
MORE = (
    Figure("", "which of these claims carry over to three dimensions", "three_dimensions", ("response",)),
    Figure("", "error against time of every method, its own and its peers'", "speed_accuracy", ("speed_accuracy",)),
    Figure("", "where methods fail: errors, claimed bounds and statuses", "failure_map", ("failure_map",)),
    Figure("", "times, memory and exponents up to 10⁶ vertices", "scale", ("scale",)),
    Figure("", "what it spares to compute no more than is asked for", "economy", ("economy",)),
)
