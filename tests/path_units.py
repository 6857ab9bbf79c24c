"""Results of paths by their units, for `same_in_units`."""

from problems import stiff_lattice

from critflow import spring_state, strain_path


def of_path(solution, units):
    path, d = solution.value, solution.value.deformation.dimension
    moduli = (path.bulk_modulus, path.shear_modulus, path.shear_modulus_stress_corrected, path.modulus, path.stress)
    errors = (path.bulk_modulus_error, path.shear_modulus_error, path.modulus_error)
    return {
        "number": (solution.status, solution.note, path.status, path.steps, path.inserted, path.free_components),
        "length": (path.coordinate_error, path.states[-1].bond_vectors if path.states else ()),
        "force": (path.max_force,),
        "energy": (path.energy,),
        "stiffness" if d == 2 else "pressure": (*moduli, *errors),
    }


def of_springs(network, units, **options):
    state = stiff_lattice()
    springs = spring_state(network, units.length * state.rest_lengths, units.length * state.coordinates)
    return of_path(strain_path(springs, [0.0, 1e-9, 1e-3], throw=False, **options), units)
