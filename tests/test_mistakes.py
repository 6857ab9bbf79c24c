"""Sentences that users get for mistakes: for each call and each command, the kind of error and its decisive words."""

from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from fixtures import TINY
from mistake_checks import (  # noqa: F401 (fixtures)
    BEST,
    CRITICAL,
    FAILED,
    MAKES_ONE,
    MANIFOLD,
    NETWORK,
    STATE,
    WIDE,
    give_their_codes_and_sentences,
    give_their_sentences,
    here,
)
from refusals import refused

import critflow as cf
from critflow import InputError, SolveError


def assign(thing, name):
    setattr(thing, name, 3)


CALLS = {
    # Names of quantities, methods and deformations
    "quantity misspelt": (lambda: cf.optimize(NETWORK, "B0"), InputError, "'B0'", "did you mean 'B_0'?"),
    "quantity misspelt, long": (
        lambda: cf.optimize(NETWORK, "bulk_modulos"),
        *(InputError, "'bulk_modulos'", "did you mean 'bulk_modulus'?"),
    ),
    "bound of a misspelt quantity": (lambda: cf.upper_bound(NETWORK, "B0"), InputError, "did you mean 'B_0'?"),
    "quantity in lower case": (lambda: cf.quantity(NETWORK, "v_l"), InputError, "did you mean 'V_L'?"),
    "quantity of a deformation": (
        lambda: cf.quantity(NETWORK, "modulus[twist]"),
        *(InputError, "'modulus[twist]'", "did you mean 'modulus[dilation]'?", "simple_shear"),
    ),
    "quantity without its deformation": (lambda: cf.quantity(NETWORK, "modulus"), InputError, "modulus[D]"),
    "objective a number": (lambda: cf.optimize(NETWORK, 3), InputError, "objective must be a name or a Quantity"),
    "method misspelt": (
        lambda: cf.optimize(NETWORK, "G_0", "newtn"),
        *(InputError, "no method is called 'newtn'", "lbfgs", "newton", "auto"),
    ),
    "relaxation method": (lambda: cf.equilibrium(STATE, "magic"), InputError, "'magic'", "'newton' or 'fire'"),
    "deformation misspelt": (
        lambda: cf.strain_path(BEST, [0.01], "twist"),
        *(InputError, "no deformation is called 'twist'", "dilation, simple_shear, pure_shear, uniaxial"),
    ),
    "sides misspelt": (lambda: cf.Deformation.uniaxial(2, sides="loose"), InputError, "'fixed' or 'free'"),
    "lattice misspelt": (
        lambda: cf.lattice("kagomé", 4, 4),
        *(InputError, "no lattice is called 'kagomé'", "honeycomb", "kagome,"),
    ),
    "measure of a path": (
        lambda: cf.strain_path(BEST, [0.01], measure="all"),
        *(InputError, "a path measures one of tensors, moduli, energy", "'all'"),
    ),
    # Numbers
    "odd number of vertices": (
        lambda: cf.voronoi_network(n_vertices=61, seed=1),
        *(InputError, "n_vertices must be an even number of at least 4", "not 61", "two a cell"),
    ),
    "vertices as a word": (lambda: cf.voronoi_network("60"), InputError, "n_vertices", "whole number, not '60'"),
    "seed a word": (
        lambda: cf.voronoi_network(60, "a"),
        *(InputError, "seed must be a whole number or a Generator", "not 'a'"),
    ),
    "seed a fraction": (lambda: cf.voronoi_network(60, 1.5), InputError, "numpy.random.default_rng(1.5)"),
    "seed negative": (lambda: cf.voronoi_network(60, -1), InputError, "seed must be a whole number from zero"),
    "lattice of no cells": (
        lambda: cf.lattice("honeycomb", 0, 3),
        *(InputError, "honeycomb", "whole numbers of at least 1", "2 directions", "0 × 3"),
    ),
    "tolerance a word": (
        lambda: cf.optimize(NETWORK, "B_0", tolerance="small"),
        *(InputError, "tolerance must be a number", "not 'small'"),
    ),
    "steps a fraction": (
        lambda: cf.optimize(NETWORK, "B_0", max_steps=2.5),
        *(InputError, "max_steps must be a whole number", "not 2.5"),
    ),
    "steps true": (lambda: cf.optimize(NETWORK, "V_L", max_steps=True), InputError, "whole number, not True"),
    "throw a number": (lambda: cf.optimize(NETWORK, "B_0", throw=2), InputError, "throw must be True or False"),
    "volume negative": (
        lambda: cf.three_bar_linkage().with_volume(-1),
        *(InputError, "a volume must be positive and finite", "not -1"),
    ),
    "strains of both signs": (
        lambda: cf.strain_path(BEST, [-0.1, 0.01]),
        *(InputError, "strains must be finite", "0.001:0.010:0.001", "one path for each sign"),
    ),
    "strain a word": (lambda: cf.strain_path(BEST, ["a"]), InputError, "strains must be an array of numbers"),
    # Arrays over edges
    "sigma zero": (
        lambda: MANIFOLD.configuration(np.zeros(90)),
        *(InputError, "sigma is zero on every edge", "positive for tension"),
    ),
    "sigma NaN": (
        lambda: MANIFOLD.configuration(np.full(90, np.nan)),
        *(InputError, "sigma must be finite on every edge", "sigma[0] = nan"),
    ),
    "sigma too short": (
        lambda: MANIFOLD.configuration(np.ones(3)),
        *(InputError, "sigma must have one value per edge", "shape (90,), not (3,)"),
    ),
    "sigma a word": (lambda: MANIFOLD.solve("a"), InputError, "sigma must be real numbers", "'a'"),
    "lengths too short": (
        lambda: cf.critical_from_lengths(NETWORK, np.ones(5)),
        *(InputError, "rest_lengths must have one value per edge", "shape (90,), not (5,)"),
    ),
    "lengths negative": (
        lambda: cf.critical_from_lengths(NETWORK, -np.ones(90)),
        *(InputError, "rest_lengths must be positive", "rest_lengths[0] = -1"),
    ),
    "lengths a word": (
        lambda: cf.critical_from_lengths(NETWORK, "ones"),
        *(InputError, "rest_lengths must be an array of numbers", "'ones'"),
    ),
    "spring lengths too short": (
        lambda: cf.spring_state(NETWORK, np.ones(5), CRITICAL.coordinates),
        *(InputError, "rest_lengths", "shape (90,), not (5,)"),
    ),
    # Graphs
    "network from a name": (lambda: cf.Network("foo.csv"), InputError, "edges must be whole numbers"),
    "network without boundary": (
        lambda: cf.Network([[0, 1], [1, 2]]),
        *(InputError, "a periodic cell or pins", "collapses to a point"),
    ),
    # Arguments of another kind
    "path from a network": (
        lambda: cf.strain_path(NETWORK, [0.1]),
        *(InputError, "start must be a CriticalConfiguration", "not a Network", MAKES_ONE),
    ),
    "path from a manifold": (
        lambda: cf.strain_path(MANIFOLD, [0.1]),
        *(InputError, "start must be a CriticalConfiguration", "not a CriticalManifold", MAKES_ONE),
    ),
    "path from a word": (lambda: cf.strain_path("best", [0.1]), InputError, "start must be", "not 'best'"),
    "method of a path unknown": (
        lambda: cf.strain_path(BEST, [0.01], method="steepest"),
        *(InputError, "no relaxation method is called 'steepest'", "'newton'"),
    ),
    "tolerance of a path a word": (
        lambda: cf.strain_path(BEST, [0.01], tolerance="fine"),
        *(InputError, "tolerance must be a number", "not 'fine'"),
    ),
    "elasticity of a number": (
        lambda: cf.elasticity(3),
        *(InputError, "CriticalConfiguration", "SpringState", "not 3", MAKES_ONE),
    ),
    "elasticity of coordinates": (
        lambda: cf.elasticity(CRITICAL.coordinates),
        *(InputError, "CriticalConfiguration", "SpringState", "not an array of shape (60, 2)", MAKES_ONE),
    ),
    "stiffening of a network": (
        lambda: cf.stiffening(NETWORK),
        *(InputError, "critical must be a CriticalConfiguration", "not a Network", MAKES_ONE),
    ),
    "stiffening of a state": (
        lambda: cf.stiffening(STATE),
        *(InputError, "critical must be a CriticalConfiguration", "not a SpringState", MAKES_ONE),
    ),
    "relaxation of a network": (
        lambda: cf.equilibrium(NETWORK),
        *(InputError, "state must be a SpringState, not a Network", "spring_state(network, coordinates)"),
    ),
    "relaxation of an optimum": (
        lambda: cf.equilibrium(BEST),
        *(InputError, "state must be a SpringState, not an Optimum", "use its .value"),
    ),
    "optimum of a word": (
        lambda: cf.optimize("n", "B_0"),
        *(InputError, "network must be a Network or a CriticalManifold", "not 'n'"),
    ),
    "optimum of an array": (
        lambda: cf.optimize(CRITICAL.coordinates, "B_0"),
        *(InputError, "network must be a Network", "not an array of shape (60, 2) and type float64"),
    ),
    "manifold of edges": (
        lambda: cf.CriticalManifold(NETWORK.edges),
        *(InputError, "network must be a Network, not an array of shape (90, 2)"),
    ),
    # Solutions that failed
    "elasticity of a failure": (
        lambda: cf.elasticity(FAILED),
        *(InputError, "a solution that failed", "prestress matrix is singular", ".value"),
    ),
    "stiffening of a failure": (
        lambda: cf.stiffening(FAILED),
        *(InputError, "a solution that failed", "prestress matrix is singular", ".value"),
    ),
    "path from a failure": (
        lambda: cf.strain_path(FAILED, [0.01]),
        *(SolveError, "no path starts from this solution", "prestress matrix is singular"),
    ),
    "too few steps": (
        lambda: cf.optimize(NETWORK, "V_L", "lbfgs", max_steps=1),
        *(SolveError, "no optimum", "step limit", "raise max_steps", "method='auto'"),
    ),
    "slack edges": (
        lambda: cf.critical_from_lengths(NETWORK, WIDE),
        *(SolveError, "no all-tension critical configuration", "18 of 90 edges are slack", "narrow the lengths"),
    ),
    # Python's own sentences
    "no such public name": (lambda: cf.optimise, AttributeError, "critflow", "optimise"),
    "argument missing": (lambda: cf.optimize(NETWORK), TypeError, "optimize() missing", "'objective'"),
    "argument misspelt": (
        lambda: cf.optimize(NETWORK, "B_0", tolerence=1),
        *(TypeError, "optimize()", "unexpected keyword argument 'tolerence'"),
    ),
    "argument of a path misspelt": (
        lambda: cf.strain_path(BEST, [0.01], measur="moduli"),
        *(TypeError, "strain_path()", "'measur'"),
    ),
    "argument of a generator misspelt": (
        lambda: cf.voronoi_network(60, rng=3),
        *(TypeError, "voronoi_network()", "'rng'"),
    ),
    "quantity of a solution": (
        lambda: BEST.B_0,
        AttributeError,
        "Optimum",
        "'B_0'",
        ".objective",
        "elasticity(...)",
    ),
    "edges that count from one": (
        lambda: cf.Network([[1, 2], [2, 3]], pins={1: [0, 0], 3: [1, 0]}),
        *(InputError, "vertex 0 hangs on no edge", "pruned(", "vertices count from 0: subtract 1"),
    ),
    "many edges that count from one": (
        lambda: cf.Network([[1, 2], [1, 2], [2, 1]], [[1, 0], [0, 1], [0, 0]], np.eye(2)),
        *(InputError, "vertex 0 hangs on no edge", "vertices count from 0: subtract 1"),
    ),
    "field of a value": (lambda: CRITICAL.stress, AttributeError, "CriticalConfiguration", "'stress'"),
    "field of a network": (lambda: NETWORK.nope, AttributeError, "Network", "'nope'"),
    "field of an elasticity": (lambda: cf.elasticity(BEST).value.bulkk, AttributeError, "Elasticity", "'bulkk'"),
    "change of a network": (lambda: assign(NETWORK, "stiffness"), FrozenInstanceError, "field 'stiffness'"),
    "change of a configuration": (lambda: assign(CRITICAL, "sigma"), FrozenInstanceError, "field 'sigma'"),
}

# Calls that look like mistakes and are none: what they return.
ACCEPTED = {
    "a strain as a number": (lambda: cf.strain_path(BEST, 0.1).status, cf.Status.ok),
    "strains as percentages": (lambda: cf.strain_path(BEST, [1, 2, 5]).status, cf.Status.ok),
    "compressed edges": (lambda: type(MANIFOLD.configuration(-np.ones(90))), cf.CriticalConfiguration),
}

# A solution and a field of its value, which is read as solution.value.NAME.
FIELDS_OF_VALUES = {
    "an optimum": (BEST, "sigma"),
    "a force balance": (MANIFOLD.solve(np.ones(90)), "lengths"),
    "an elasticity": (cf.elasticity(BEST), "bulk"),
    "a path": (cf.strain_path(BEST, [0.001]), "energy"),
}

COMMANDS = {
    # Words that are no command, option or study
    "no command": ([], 2, "Missing command", "critflow --help"),
    "command misspelt": (["rnu"], 2, "No such command 'rnu'", "did you mean 'run'"),
    "option misspelt": (["run", TINY, "--worker", "2"], 2, "option '--worker'", "did you mean '--workers'"),
    "option of no command misspelt": (["--vesrion"], 2, "No such option '--vesrion'", "did you mean '--version'"),
    "option of show misspelt": (["show", "RESULTS/tiny.nc", "--seed", "1"], 2, "No such"),
    "no study": (["run"], 2, "Missing argument 'NAME|FILE'", "critflow run --help"),
    "no folder": (["status"], 2, "Missing argument 'DIR'", "critflow status --help"),
    "empty study": (["run", ""], 2, "the study '' is empty", "give the name of a study, or its file NAME.py"),
    "two studies": (["run", TINY, "twice.py"], 2, "unexpected extra argument", "twice.py"),
    "study misspelt": (["run", "ensembel"], 2, "there is no study 'ensembel'", "did you mean 'ensemble'?"),
    "study unlike any": (["run", "qqq"], 2, "the studies are ", "gallery, percolation"),
    "no such file": (["run", "nowhere.py"], 2, "cannot read the study file", "nowhere.py", "critflow list"),
    "folder as study": (["run", "folder/"], 2, "cannot read the study file", "its file NAME.py"),
    "list a misspelt study": (["list", "ensembel"], 2, "no study 'ensembel'", "did you mean 'ensemble'?"),
    # Settings
    "setting without --set": (["run", TINY, "seeds=0:2"], 2, "seeds=0:2", "write --set before KEY=VALUE"),
    "--set without a study": (["run", "--set", "seeds=1"], 2, "Missing"),
    "--set without a setting": (["run", TINY, "--set"], 2, "'--set' requires an argument"),
    "setting without a value": (["run", TINY, "--set", "seeds"], 2, "seeds has no value", "--set seeds=VALUE"),
    "setting misspelt": (
        ["run", TINY, "--set", "sedes=3"],
        *(2, "study 'tiny' has no setting 'sedes'", "did you mean 'seeds'?"),
    ),
    "setting shortened": (
        ["run", "ensemble", "--set", "vertices=100"],
        *(2, "study 'ensemble' has no setting 'vertices'", "did you mean 'n_vertices'?"),
    ),
    "setting of words": (["run", TINY, "--set", "seeds=a"], 2, "seeds needs whole numbers", "not 'a'"),
    "setting of no values": (
        ["run", TINY, "--set", "seeds=0:0"],
        *(2, "seeds=0:0 is an empty range", "give a stop above 0"),
    ),
    "setting with a value twice": (
        ["run", TINY, "--set", "seeds=1,1"],
        *(2, "seeds contains 1 twice", "give every value once"),
    ),
    "population misspelt": (
        ["run", "ensemble", "--set", "populations=random_stres"],
        *(2, "populations has no 'random_stres'", "did you mean 'random_stress'?"),
    ),
    "variable misspelt": (
        ["run", TINY, "--set", "variables=colour"],
        *(2, "study 'tiny' has no variable 'colour'", "the choices are all, scalars"),
    ),
    "odd number of vertices": (
        ["run", "ensemble", "--set", "n_vertices=61"],
        *(2, "n_vertices must be an even number of at least 4, not 61", "two a cell"),
    ),
    "too many vertices": (
        ["run", "ensemble", "--set", "n_vertices=1000000000"],
        *(2, "1,000,000,000 vertices", "1,000 GB", "at most 20,000,000"),
    ),
    "hard core too large": (
        ["run", "ensemble", "--set", "hard_core=1.2"],
        *(2, "500 points never fitted", "lower the hard core", "0.834"),
    ),
    "strain of zero": (
        ["run", "ensemble", "--set", "strains=0"],
        *(2, "strains must be finite, positive and increasing", "0.001:0.010:0.001"),
    ),
    "threshold of zero": (["run", "ensemble", "--set", "threshold=0.0"], 2, "threshold=0.0 must be positive"),
    "deformation misspelt": (
        ["run", "ensemble", "--set", "deformation=shear"],
        *(2, "deformation=shear must be one of dilation, simple_shear, pure_shear"),
    ),
    # Folders and processes
    "--out empty": (["run", TINY, "--out", ""], 2, "--out must be a non-empty path"),
    "--out unprintable": (["run", TINY, "--out", "a\nb"], 2, "--out"),
    "--out is a file": (["run", TINY, "--out", "text.txt"], 6, "text.txt is a file", "give a folder with --out"),
    "--out below a file": (
        ["run", TINY, "--workers=0", "--out", "text.txt/x"],
        *(6, "cannot write in text.txt/x", "Not a directory", "choose another folder with --out"),
    ),
    "--out of another study": (
        ["run", "other.py", "--out", "RESULTS"],
        *(2, "contains study 'tiny', not 'other'", "choose another folder with --out"),
    ),
    "--workers a word": (["run", TINY, "--workers", "many"], 2, "'--workers'", "valid integer"),
    "--workers negative": (["run", TINY, "--workers", "-1"], 2, "--workers must not be negative"),
    "--workers of a study that measures time": (
        ["run", "alone.py", "--workers", "2"],
        *(2, "--workers 2 disturbs the times", "give at most 1"),
    ),
    "--workers with a scheduler": (
        ["run", TINY, "--scheduler", "tls://a:1", "--workers", "2"],
        *(2, "--workers counts local processes", "leave it out with --scheduler"),
    ),
    "a batch system": (
        ["run", TINY, "--cluster", "slurm"],
        *(2, "--cluster, --jobs and --part are gone", "dask-jobqueue", "--scheduler ADDRESS", "docs/command.md"),
    ),
    "--part": (["run", TINY, "--part", "1/4"], 2, "--scheduler ADDRESS"),
    "--jobs": (["run", TINY, "--jobs", "4"], 2, "--scheduler ADDRESS"),
    "--cluster with --jobs": (["run", TINY, "--cluster", "slurm", "--jobs=4"], 2, "dask-jobqueue"),
    "--scheduler plain": (
        ["run", TINY, "--scheduler", "tcp://127.0.0.1:9"],
        *(2, "'tcp://127.0.0.1:9' is not encrypted", "use tls://, or add --insecure"),
    ),
    "--scheduler without certificates": (["run", TINY, "--scheduler", "tls://127.0.0.1:9"], 2, "certificates"),
    "--scheduler that does not answer": (["run", TINY, "--scheduler", "tcp://127.0.0.1:9", "--insecure"], 6, "answers"),
    "--scheduler of a study that measures time": (["run", "alone.py", "--scheduler", "tls://a:1"], 2, "measures"),
    "--time-limit zero": (
        ["run", TINY, "--workers=1", "--time-limit", "0"],
        *(2, "--time-limit 0 must be a number above zero"),
    ),
    "--time-limit NaN": (["run", TINY, "--workers=1", "--time-limit", "nan"], 2, "--time-limit"),
    "--time-limit without workers": (
        ["run", TINY, "--workers=0", "--time-limit", "5"],
        *(2, "limits need worker processes", "give --workers 1"),
    ),
    "--memory-limit negative": (
        ["run", TINY, "--workers=1", "--memory-limit=-1"],
        *(2, "--memory-limit -1 must be a number above zero"),
    ),
    "--memory-limit with a scheduler": (["run", TINY, "--memory-limit=5", "--scheduler=tls://h"], 2, "--memory-limit"),
    "status of a file": (["status", "text.txt"], 2, "results folder"),
    "status of no folder": (
        ["status", "nowhere"],
        *(2, "nowhere is not a results folder", "no study.json", "critflow run"),
    ),
    "status of a damaged note": (
        ["status", "damaged"],
        *(4, "damaged/study.json is damaged", "run the study again"),
    ),
    "verify no folder": (["verify", "nowhere"], 2, "nowhere is not a results folder", "critflow run"),
    "figures of no folder": (["figures", "nowhere"], 2, "nowhere is not a results folder", "critflow run"),
    "figures in an unknown format": (
        ["figures", "RESULTS", "--format", "gif"],
        *(2, "figures can be png, pdf, svg", "not 'gif'"),
    ),
    "show no dataset": (["show", "nowhere.nc"], 2, "there is no dataset nowhere.nc", "run the study first"),
    "show a folder": (["show", "folder"], 2, "folder is a folder", "give its dataset, folder/NAME.nc"),
    "show the folder of a run": (["show", "RESULTS"], 2, "is a folder: give its dataset", "tiny.nc"),
    "show a text": (["show", "text.txt"], 2, "text.txt is no dataset", "give a file NAME.nc"),
}

test_a_wrong_call_gives_its_kind_of_error_and_its_sentence = give_their_sentences(CALLS)
test_a_wrong_command_gives_its_exit_code_and_its_sentence = give_their_codes_and_sentences(
    COMMANDS, longest=400, silent=True
)


@pytest.mark.parametrize("name", ACCEPTED)
def test_a_call_that_is_no_mistake_returns(name):
    call, expected = ACCEPTED[name]
    assert call() == expected


@pytest.mark.parametrize("name", FIELDS_OF_VALUES)
def test_a_solution_has_no_fields_of_its_value(name):
    solution, field = FIELDS_OF_VALUES[name]
    assert hasattr(solution.value, field)
    with pytest.raises(AttributeError) as caught:
        getattr(solution, field)
    words = (type(solution).__name__, f"'{field}'")
    assert [word for word in words if word not in str(caught.value)] == [], str(caught.value)


def one(edge, value):
    """Ones on all edges but this one."""
    return np.where(np.arange(90) == edge, value, 1.0)


def state(**change):
    arguments = {"rest_lengths": CRITICAL.lengths, "coordinates": CRITICAL.coordinates} | change
    return cf.spring_state(NETWORK, **arguments)


# Further values: call, and a word of the sentence.
VALUES = {
    # Arrays over edges and vertices
    "sigma infinite": (lambda: MANIFOLD.configuration(one(2, np.inf)), r"sigma\[2\]"),
    "sigma text": (lambda: MANIFOLD.configuration(["a"] * 90), "number"),
    "sigma singular": (lambda: cf.CriticalManifold(cf.three_bar_linkage()).configuration([1, 1, -0.5]), "singular"),
    "start negative": (lambda: cf.optimize(NETWORK, "bulk_modulus", "lbfgs", start=one(1, -1)), r"start\[1\]"),
    "start zero": (lambda: cf.optimize(NETWORK, "bulk_modulus", "lbfgs", start=np.zeros(90)), r"start\[0\]"),
    "start too short": (lambda: cf.optimize(NETWORK, "bulk_modulus", "lbfgs", start=np.ones(3)), "edge"),
    "lengths NaN": (lambda: cf.critical_from_lengths(NETWORK, one(4, np.nan)), r"rest_lengths\[4\]"),
    "lengths too many": (lambda: cf.critical_from_lengths(NETWORK, np.ones(91)), "edge"),
    "spring lengths zero": (lambda: state(rest_lengths=one(0, 0)), r"rest_lengths\[0\]"),
    "coordinates too few": (lambda: state(coordinates=np.ones((3, 2))), r"shape \(60, 2\)"),
    "coordinates NaN": (lambda: state(coordinates=np.full((60, 2), np.nan)), "finite"),
    # Names and numbers
    "unknown objective": (lambda: cf.optimize(NETWORK, "beauty"), "V_L"),
    "unknown method": (lambda: cf.optimize(NETWORK, "bulk_modulus", "magic"), "auto"),
    "closed form of another": (lambda: cf.optimize(NETWORK, "length_variance", "closed_form"), "method"),
    "cone of another": (lambda: cf.optimize(NETWORK, "tension_variance", "conic"), "method"),
    "no starts": (lambda: cf.optimize(NETWORK, "tension_variance", starts=0), "at least"),
    "tolerance zero": (lambda: cf.optimize(NETWORK, "bulk_modulus", tolerance=0), "tolerance"),
    "threshold negative": (lambda: cf.optimize(NETWORK, "shear_modulus", threshold=-1), "threshold"),
    "threshold NaN": (lambda: cf.optimize(NETWORK, "shear_modulus", threshold=np.nan), "threshold"),
    "response of an array": (lambda: cf.CriticalManifold(NETWORK).response(np.ones(3)), "CriticalConfiguration"),
    "relaxation to nothing": (lambda: cf.equilibrium(state(), tolerance=0.0), "tolerance"),
    "relaxation to no number": (lambda: cf.equilibrium(state(), tolerance=np.nan), "tolerance"),
    "no strains": (lambda: cf.strain_path(CRITICAL, []), "at least"),
    "strains in a table": (lambda: cf.strain_path(CRITICAL, [[0.01, 0.02]]), r"shape \(1, 2\)"),
    "strains backwards": (lambda: cf.strain_path(CRITICAL, [0.02, 0.01]), "increasing"),
    "strains of both signs": (lambda: cf.strain_path(CRITICAL, [-0.01, 0.01]), "sign"),
    "a path that inverts the cell": (lambda: cf.strain_path(CRITICAL, [-1.5], deformation="uniaxial"), "inverts"),
    "a path without balance": (lambda: cf.strain_path(state(rest_lengths=np.ones(90)), [0.01]), "equilibrium"),
    "a path from a number": (lambda: cf.strain_path(1.0, [0.01]), "start must"),
    "strain NaN": (lambda: cf.strain_path(CRITICAL, [np.nan]), "finite"),
    "a strain of zero": (lambda: cf.strain_path(CRITICAL, [0.0, 0.001]), r"0\.001"),
    "strains twice": (lambda: cf.strain_path(CRITICAL, [0.001, 0.001]), r"0\.001"),
    "strain infinite": (lambda: cf.strain_path(CRITICAL, [np.inf]), r"0\.001"),
    "edge without length": (lambda: state(coordinates=np.zeros((60, 2))).sigma, "edge 0"),
}

test_a_wrong_value_gives_one_sentence = refused(VALUES)
