"""Random valid networks through the functions of this folder."""

from fuzzing import answers_or_explains, relaxed

from critflow_extras.hessian.splits import bond_operator, geometric_split, hookean_split

CALLS = {
    "bond_operator": lambda p, r: bond_operator(relaxed(p, r).value),
    "geometric_split": lambda p, r: geometric_split(relaxed(p, r).value),
    "hookean_split": lambda p, r: hookean_split(relaxed(p, r).value),
}

test_answers_or_explains = answers_or_explains(CALLS)
