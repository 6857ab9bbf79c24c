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
        "EnergyConstraints", "energy as a sum of squared constraints", "mechanics.springs.SpringState.energy",
        "mechanics/test_springs.test_forces_and_hessian_are_derivatives_of_the_energy",
    ),
    Equation(
        "FirstOrder", "motions that change no constraint to first order", "rigidity.counts.zero_modes",
        "rigidity/test_counts.test_all_null_vectors_by_either_way",
    ),
    Equation(
        "RigidityMatrix", "R of Hookean springs", "rigidity.counts.rigidity_matrix",
        "rigidity/test_counts.test_the_matrix_is_the_derivative_of_lengths",
    ),
    Equation(
        "BondVectors", "bond vectors from coordinates and boundary", "networks.network.Network.bond_vectors",
        "networks/test_network.test_bond_vectors_are_differences_plus_boundary",
    ),
    Equation(
        "Equilibrium", "forces from tensions and R", "mechanics.springs.SpringState.forces",
        "mechanics/test_springs.test_forces_and_hessian_are_derivatives_of_the_energy",
    ),
    Equation(
        "selfstressdef", "self-stresses: the left null space of R", "rigidity.counts.rigidity",
        "rigidity/test_counts.test_all_null_vectors_by_either_way",
    ),
    Equation(
        "Maxwell-Calladine", "N_0 − N_s = d N_v − N_b", "rigidity.counts.rigidity",
        "rigidity/test_counts.test_critical_configurations",
    ),
    Equation(
        "SecondOrderRigidity", "zero modes that no self-stress stops", "rigidity.second_order.second_order_rigidity",
        "rigidity/test_second_order.test_two_strings_of_which_none_holds_the_other",
    ),
    Equation(
        "ForceBalance", "balance of any energy E(h)", "mechanics.springs.SpringState.forces",
        "mechanics/test_laws.test_each_function_is_the_derivative_of_the_one_before",
    ),
    Equation(
        "ForceBalanceL", "tensions alone do not fix a configuration", "design.isogonal.IsogonalModes.walk",
        "design/test_isogonal.test_the_walk_keeps_directions_tensions_and_bulk_modulus",
    ),
    Equation(
        "ForceDensity", "σ = τ/|L|", "critical.manifold.CriticalConfiguration.tensions",
        "mechanics/test_springs.test_stress_and_modified_stiffness_by_their_formulas",
    ),
    Equation(
        "ForceBalanceLsqr", "balance of squared lengths, gᵀ(σ ∘ L) = 0", "critical.manifold.CriticalConfiguration.residual",
        "critical/test_manifold.test_the_residual_sees_imbalance",
    ),
    Equation(
        "FDM1", "balance as a linear system for the coordinates", "critical.manifold.CriticalManifold.solve",
        "critical/test_manifold.test_forces_balance_to_rounding",
    ),
    Equation(
        "PrestressMatrix", "P: the Laplacian weighted by σ", "linalg.matrices.laplacian",
        "linalg/test_matrices.test_laplacian_against_dense",
    ),
    Equation(
        "SelfStressParamaterization_coords", "the configuration x(σ)", "critical.manifold.CriticalManifold.configuration",
        "critical/test_manifold.test_square_octagon_closed_form",
    ),
    Equation(
        "SelfStressParamaterization_bondvecs", "the bond vectors L(σ)", "critical.manifold.CriticalManifold.balance",
        "critical/test_manifold.test_map_is_the_pseudo_inverse_formula",
    ),
    Equation(
        "GenericHessian", "H = RᵀKR + P", "mechanics.hessian.geometric_split", "mechanics/test_hessian.test_both_splits_are_the_hessian",
    ),
    Equation(
        "ModifiedStiffness", "K = (k − σ)/|L|²", "mechanics.springs.SpringState.modified_stiffness",
        "mechanics/test_springs.test_stress_and_modified_stiffness_by_their_formulas",
    ),
    Equation(
        "SelfStressParamaterization_Lsqr", "the manifold as a surface of half squared lengths",
        "critical.curvature.surface_geometry", "critical/test_curvature.test_tangents_and_metric_match_finite_differences",
    ),
    Equation(
        "projection", "stereographic chart σ(s)", "critical.curvature.StereographicChart.sigma",
        "critical/test_curvature.test_the_chart_covers_the_unit_sphere",
    ),
    Equation(
        "projectionDeriv", "its derivative V", "critical.curvature.StereographicChart.derivative",
        "critical/test_curvature.test_the_transposes_belong_to_their_operators",
    ),
    Equation(
        "TangentVectors", "stress is normal to every curve on the manifold", "critical.manifold.CriticalManifold.response",
        "critical/test_manifold.test_response_is_the_derivative_of_half_squared_lengths",
    ),
    Equation(
        "SelfStressParamaterization_BondVectorDeriv", "∂L/∂σ", "critical.manifold.CriticalManifold.tangent",
        "critical/test_manifold.test_response_is_the_derivative_of_half_squared_lengths",
    ),
    Equation(
        "SelfStressParamaterization_LsqrDeriv", "B = ∂h/∂σ", "critical.manifold.CriticalManifold.response",
        "critical/test_manifold.test_response_is_the_derivative_of_half_squared_lengths",
    ),
    Equation(
        "BondOperator", "RH⁻¹Rᵀ", "mechanics.hessian.bond_operator",
        "mechanics/test_hessian.test_a_force_dipole_changes_lengths_by_a_column",
    ),
    Equation(
        "TangentSpace", "tangents BV", "critical.curvature.surface_geometry",
        "critical/test_curvature.test_tangents_and_metric_match_finite_differences",
    ),
    Equation(
        "Metric", "metric VᵀB²V", "critical.curvature.surface_geometry",
        "critical/test_curvature.test_tangents_and_metric_match_finite_differences",
    ),
    Equation(
        "2FF", "second fundamental form", "critical.curvature.surface_geometry",
        "critical/test_curvature.test_second_fundamental_form_matches_finite_differences",
        "differs: finite differences give −VᵀBV/|σ|, the paper prints +; σᵀB = 0 implies σᵀ∂B = −B",
    ),
    Equation(
        "HookeanEnergy", "E = ½Σk(|L| − ℓ)²", "mechanics.laws.Hookean",
        "mechanics/test_springs.test_forces_and_hessian_are_derivatives_of_the_energy",
    ),
    Equation(
        "TotalDeriv", "dO/dσ by one more solve", "critical.manifold.CriticalManifold.pull_back",
        "critical/test_objectives.test_gradient_and_hessian_by_taylor_remainders",
    ),
    Equation(
        "GenericModulus", "modulus at the transition for any affine strain", "critical.objectives.transition_modulus",
        "mechanics/test_moduli.test_transition_moduli_three_ways",
    ),
    Equation(
        "BulkModulus", "B_0", "mechanics.moduli.transition_moduli",
        "critical/test_objectives.test_bulk_and_shear_by_the_papers_formulas",
    ),
    Equation(
        "BulkModulusHessian", "flat directions at max B_0", "critical.stress_hessian.flat_directions",
        "critical/test_stress_hessian.test_the_largest_bulk_modulus_is_flat_along_scale_and_isogonal_modes",
        "differs: the nullity is N_v/2, the scale of σ and N_v/2 − 1 isogonal modes; the paper prints N_v/2 − 1 = N_f, "
        "and there are N_f = N_v/2 polygons",
    ),
    Equation(
        "BulkModulusAffNonAff", "affine and non-affine parts of B_0", "design.isogonal.affine_bulk_modulus",
        "design/test_isogonal.test_the_affine_part_of_the_bulk_modulus",
    ),
    Equation(
        "BulkModulusAffine", "σ = k is the most affine of the stiffest", "design.modulus_bounds.largest_modulus",
        "design/test_isogonal.test_the_affine_part_of_the_bulk_modulus",
    ),
    Equation(
        "ShearModulus", "G_0", "mechanics.moduli.transition_moduli",
        "critical/test_objectives.test_bulk_and_shear_by_the_papers_formulas",
    ),
    Equation(
        "ShearMod+Constraint", "G_0 with a penalty on small stresses", "critical.objectives.ConstrainedModulus",
        "critical/test_objectives.test_the_barrier_rises_as_the_tenth_power",
    ),
    Equation(
        "LengthVariance", "V_L", "rigidity.structure.length_variance", "rigidity/test_structure.test_variances_by_their_formulas",
    ),
    Equation(
        "TensionVariance", "V_τ", "rigidity.structure.tension_variance", "rigidity/test_structure.test_variances_by_their_formulas",
    ),
    Equation(
        "ShapeAnisotropy", "κ of faces and force triangles", "rigidity.structure.polygon_anisotropy",
        "rigidity/test_structure.test_the_eigenvalue_formula_and_its_symmetries",
    ),
    Equation(
        "RestLengthVolumetric", "V(γ) = V(0)(1 + γ)", "mechanics.strain_path.strain_path", "mechanics/test_strain_path.test_energy_is_the_work_done",
    ),
    Equation(
        "ModulusStrainScaling", "B = B_0 + C_B γ, G = G_0 + C_G γ", "mechanics.stiffening.stiffening",
        "mechanics/test_moduli.test_exact_stiffening_is_the_limit_of_fits",
    ),
    Equation(
        "incidenceMatrix", "signed incidence g", "networks.network.Network.incidence",
        "networks/test_network.test_incidence_against_a_dense_one",
    ),
    Equation(
        "BondVectors2", "bond vectors, boundary in b", "networks.network.Network.boundary_vectors",
        "networks/test_network.test_deformation_maps_boundary_and_pins",
    ),
    Equation(
        "RigidityMatrix2", "geometric response matrix R^h", "mechanics.hessian.geometric_split",
        "mechanics/test_hessian.test_responses_are_slopes_of_squares_and_lengths",
    ),
    Equation(
        "PrestressMatrix2", "P from second derivatives of h", "mechanics.hessian.geometric_split",
        "mechanics/test_hessian.test_both_splits_are_the_hessian",
    ),
    Equation(
        "HookeanRigidityMatrix", "R from lengths", "mechanics.hessian.hookean_split",
        "mechanics/test_hessian.test_responses_are_slopes_of_squares_and_lengths",
        "holds; an intermediate step prints a factor L too many",
    ),
    Equation(
        "HookeanPrestressMatrix", "prestress matrix of Hookean constraints", "mechanics.hessian.hookean_split",
        "mechanics/test_hessian.test_zero_modes_see_no_difference",
        "differs: the last term is Σ RᵀσR with σ = τ/|L|, the paper prints Σ RᵀτR",
    ),
    Equation(
        "BondVectorFDM", "L(σ) in the supplement", "critical.manifold.CriticalManifold.balance",
        "critical/test_manifold.test_map_is_the_pseudo_inverse_formula",
    ),
    Equation(
        "BondVectorDerivativeFDM2", "∂L/∂σ derived", "critical.manifold.CriticalManifold.tangent",
        "critical/test_manifold.test_response_is_the_derivative_of_half_squared_lengths",
    ),
    Equation(
        "BondVectorDerivativeFDM", "∂h/∂σ derived", "critical.manifold.CriticalManifold.response",
        "critical/test_manifold.test_response_is_the_derivative_of_half_squared_lengths",
    ),
    Equation(
        "tangents", "B = −R^h P⁻¹ R^hᵀ", "critical.manifold.CriticalManifold.response",
        "critical/test_manifold.test_response_is_the_derivative_of_half_squared_lengths",
    ),
    Equation(
        "2FF2", "second fundamental form, derived", "critical.curvature.surface_geometry",
        "critical/test_curvature.test_second_fundamental_form_matches_finite_differences",
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
