"""Settings at which each study of the scene takes a few seconds, for the tests of studies and `.ci/datasets`."""

SETTINGS = {
    "boundary": ("seeds=0:3", "n_vertices=40"),
    "ensemble": ("seeds=0:3", "n_vertices=60"),
    "failure_map": (
        *("difficulties=stress_spread,near_singular,short_edge,small_strain,rest_lengths", "seeds=0", "n_steps=4"),
    ),
    "gallery": ("seeds=1:3", "n_vertices=60", "starts=2"),
    "percolation": ("seeds=0:3", "n_vertices=20,40", "spreads=0.02,0.1,0.5"),
    "relations": (
        *("seeds=0:3", "n_vertices=40", "space_vertices=50", "draws=2", "signed_samples=24"),
        "laws=half_normal,log_normal_1.2",
    ),
    "shear": (
        *("seeds=0:3", "n_vertices=40,80", "ascent_vertices=60", "steps=0,1,3,10,40,200", "n_steps=400"),
        *("fractions=0.3,0.6", "detailed_seeds=2", "n_starts=3", "thresholds=0.1,0.3"),
    ),
    "statements": ("seeds=0:1", "n_vertices=40"),
    "three_bar": ("s=-2.1:2.1:0.3", "span=2.0"),
}
