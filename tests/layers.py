"""The layers of the package, in one place: each module or folder imports only those before it."""

LAYERS = (
    *("result", "calls", "arguments", "extensions", "minimisers", "numerics", "checks", "deformation", "faces"),
    *("networks", "points", "lattices", "sparse", "saddles", "double_double", "refinement"),
    *("manifold", "taut_part", "quantities", "isogonal", "self_stress", "springs"),
    *("equilibria", "cones", "taut_edges", "lengths", "descent", "optima", "linear_response", "elastic", "growth"),
    *("lean_steps", "paths", "engine", "pictures", "network_files", "studies", "command", "__main__"),
)
