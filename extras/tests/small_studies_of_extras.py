"""Settings at which each study of the extras takes a few seconds, for the tests of studies and `.ci/datasets`."""

SETTINGS = {
    "allostery": (
        *("seeds=0:1", "n_vertices=40", "loads=0.1,1.0", "sizes=24,40", "fractions=0.2,0.6", "starts=1", "steps=100"),
    ),
    "reach": (
        *("seeds=0:1", "n_vertices=16", "directions=3", "samples=3", "thresholds=0.3", "ascent=10", "sizes=24"),
        *("ratios=-0.5,0.5", "surface_vertices=24", "surface_directions=8"),
    ),
    "stiffening": (
        *("seeds=0:1", "n_vertices=24", "sources=max_B_0,random_stress", "isogonal_vertices=24"),
        *("coefficients=0.1,0.3", "strains=0.01"),
    ),
    "tension_inference": ("seeds=0:3", "n_vertices=20", "noises=1e-6,1e-3", "traced=0,2"),
    "weak_forces": ("seeds=0:1", "n_vertices=24", "kappas=0.000001,0.0001"),
    "three_dimensions": ("seeds=0:2", "n_vertices=60"),
    "topology": ("seeds=0:1", "n_vertices=24", "cuts=3", "pruned_vertices=40", "pruned_edges=4"),
}
