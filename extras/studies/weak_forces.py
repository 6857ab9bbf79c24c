"""Weak bending at the transition: tension by the equation of weak forces and of relaxed energies; apparent exponents.

Networks of the largest B_0 are dilated with angle springs of strength κ, at rest in the network as made.  Tensions and
strains are in units of the cubic equation at the transition, T = (κ²F/2D)^{1/3} and D T/c, in which its scaling
function is one curve, t³ − g t² = 1, without a free parameter.  Exponents are those that two values of κ, or of the
strain, would give.  Populations are compared by their modulus at the transition, and networks designed for a modulus at
the largest κ with the network of the largest B_0.
Random rest lengths (`random_lengths`) have s = 0.1, not the 0.3 of the paper, so that every edge carries tension.
"""

import numpy as np
from critflow.studies.shared.checks import voronoi_check
from critflow.studies.shared.figures import counted, lettered, panels
from critflow.studies.shared.populations import LABELS, NAMES, PAPER_POPULATIONS, configuration
from critflow.studies.shared.reports import PAPER, finite, parameters, series, spread
from critflow.studies.shared.tables import network_study, numbers, outcomes

import critflow as cf
import critflow_extras as ce
from critflow.engine import Claim, Coordinate
from critflow.engine.study import plural
from critflow.quantities import transition_modulus
from critflow_extras.weak.weak_equilibrium import weak_equilibrium
from critflow_extras.weak.weak_modulus import WeakModulus

from .shared.parts import NARROW

SOURCES = (
    f"{PAPER}; Lerner and Bouchbinder, Scaling theory of critical strain-stiffening in disordered elastic networks "
    "(arXiv:2208.08204)"
)
# Strains in units of the crossover, and those at which the exponent of the modulus below the transition is taken.
PLACES = np.array([-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 4.0])
ONSET = int(np.flatnonzero(PLACES == 0)[0])
WINDOW = np.array([-3e-3, -1e-3])
# Windows whose exponents go to that of γ → 0, at a κ whose crossover is far below all of them.
WINDOWS, LEAST_KAPPA = (1.0, 0.1, 0.01), 1e-13
RAISED = 1.1  # the modulus of a design, relative to that of max B_0
THIRD = 0.005  # of the modulus at the transition over B_0: half of the last digit of 0.33
STEP = 1e-4  # strain of the differences of relaxed stresses: their error is 1e-5 of the modulus
TENSION_EXPONENT, MODULUS_EXPONENT = 2 / 3, 3 / 2  # mean field: τ ∝ κ^{2/3} at γ = 0, M ∝ κ|γ|^{-φ} below


def case(parameters, *, seed):
    """One network: tensions at all κ, exponents, moduli of the populations."""
    manifold = cf.CriticalManifold(cf.voronoi_network(parameters["n_vertices"], seed))
    kappas = np.array(parameters["kappas"])
    critical, angles = cf.optimize(manifold, "bulk_modulus").value, ce.AngleSprings()
    return {
        "status": cf.Status.ok,
        **tensions(critical, angles, kappas),
        **exponents(critical, angles, kappas),
        **designed(manifold, critical, kappas.max()),
        **onset_moduli(manifold, seed, kappas),
    }


def tensions(critical, angles, kappas):
    """Tensions by both equations and of relaxed energies, at strains in units of the crossover."""
    full, cubic = (ce.weak_forces(critical, angles, order=order).value for order in ("full", "cubic"))
    strains = PLACES * cubic.crossover(kappas)[:, None]
    relaxed = [
        weak_equilibrium(critical, angles, row, kappa, throw=False).value.tension
        for row, kappa in zip(strains, kappas, strict=True)
    ]
    grid = strains, kappas[:, None]
    return {
        "unit": cubic.tension(0.0, kappas),
        "relaxed": np.array(relaxed),
        "full": full.tension(*grid),
        "cubic": cubic.tension(*grid),
        "full_error_bound": full.error(*grid),
        "cubic_error_bound": cubic.error(*grid),
        "tension_status": full.status(*grid),
    }


def exponents(critical, angles, kappas):
    """Logarithmic slopes of the tension and the modulus at the transition by κ, and of the modulus below by strain."""
    weak = ce.weak_forces(critical, angles).value
    near = kappas[:, None] * np.array([0.5, 2.0])
    at_onset = np.diff(np.log(weak.tension(0.0, near)))[:, 0] / np.log(4)
    modulus = np.diff(np.log(weak.modulus(0.0, near)))[:, 0] / np.log(4)
    limit = [_slope_below(weak, part * WINDOW, LEAST_KAPPA) for part in WINDOWS]
    below = np.array([_slope_below(weak, WINDOW, kappa) for kappa in kappas])
    slopes = {"below_exponent": below, "limit_exponent": np.array(limit)}
    return {"tension_exponent": at_onset, "onset_exponent": modulus, **slopes}


def _slope_below(weak, window, kappa):
    """Exponent −d ln M/d ln |γ| between two strains below the transition."""
    modulus = weak.modulus(window, kappa) * (1 + window)
    return np.diff(np.log(modulus))[0] / np.log(window[0] / window[1])


def designed(manifold, critical, kappa):
    """Relaxed moduli at the transition of a configuration and of one designed for a larger value, and the outcome."""
    modulus = WeakModulus(ce.AngleSprings(), kappa)
    now = ce.properties(critical, [modulus]).values[modulus.name]
    if not np.isfinite(now):  # κ is beyond the theory of this network, so that there is nothing to raise
        return {"design_modulus": np.full(2, np.nan), "design_status": cf.Status.undecided}
    found = ce.design(manifold, {modulus: RAISED * now})
    pair = (relaxed_modulus(each, kappa) if each is not None else np.nan for each in (critical, found.value))
    return {"design_modulus": np.array([*pair]), "design_status": found.status}


def relaxed_modulus(critical, kappa):
    """M = d/dγ[(1 + γ) stress] along dilation at the transition, of relaxed energies."""
    strains = STEP * np.array([-1.0, 1.0])
    relaxed = weak_equilibrium(critical, ce.AngleSprings(), strains, kappa, throw=False).value
    return np.diff(relaxed.stress * (1 + strains))[0] / (2 * STEP)


def onset_moduli(manifold, seed, kappas):
    """Moduli along dilation at the transition, with and without weak forces, NaN where a population has none."""
    weak, stiff = np.full((len(PAPER_POPULATIONS), len(kappas)), np.nan), np.full(len(PAPER_POPULATIONS), np.nan)
    dilation = transition_modulus(manifold.network, "dilation")
    for n, population in enumerate(PAPER_POPULATIONS):
        found = configuration(manifold, NARROW, seed, population)
        if found.ok:
            weak[n] = ce.weak_forces(found.value, ce.AngleSprings()).value.modulus(0.0, kappas)
            stiff[n] = ce.properties(found.value, [dilation]).values[dilation.name]
    return {"onset_modulus": weak, "transition_modulus": stiff}


def limit_of_smallest(exponents, kappas):
    """Exponents (n, κ) of up to three smallest κ, rising, extrapolated to κ = 0 in powers of κ^{1/3}, (n,)."""
    n = min(3, len(kappas))
    powers = np.cbrt(kappas[:n, None]) ** np.arange(n)
    return np.linalg.solve(powers, exponents[:, :n].T)[0]


def scaling_function(strain):
    """t of t³ − g t² = 1 for each g."""
    return np.array([max(root.real for root in np.roots([1, -g, 0, -1]) if abs(root.imag) < 1e-9) for g in strain])


def figure(ds):
    """Scaling function, and deviations of both equations at the transition."""
    kappas = np.array(parameters(ds)["kappas"])
    made, (left, right) = panels(
        2,
        "As κ → 0 tensions of all networks fall on one curve without a free parameter\n"
        f"({counted(ds)} of {parameters(ds)['n_vertices']} vertices with weak bending κ, in units of k)",
        height=3.3,
    )
    line = np.linspace(PLACES[0], PLACES[-1], 200)
    left.plot(line, scaling_function(line), color="k", linewidth=1, label="$t^3 - g t^2 = 1$")
    for n, kappa in enumerate(kappas):
        t, label = (ds.relaxed / ds.unit).values[:, n], f"κ = $10^{{{np.log10(kappa):.3g}}}$"
        left.plot(PLACES, np.nanmedian(t, axis=0), linestyle="none", markersize=4, label=label, **series(n))
    left.set(
        xlabel="strain over its crossover, $g = \\gamma/\\gamma_\\times$", ylabel="tension over its unit, $t = \\tau/T$"
    )
    left.set_title("medians")
    left.legend(fontsize=9, frameon=False, handlelength=1.2, loc="upper left")
    for n, name in enumerate(("cubic", "full")):
        deviation = 100 * np.abs(ds.relaxed / ds[name] - 1).values[:, :, ONSET]
        right.loglog(kappas, np.nanmedian(deviation, axis=0), label=f"{name} equation", markersize=4, **series(2 * n))
        right.fill_between(
            kappas, *np.nanquantile(deviation, [0.1, 0.9], axis=0), color=series(2 * n)["color"], alpha=0.2
        )
    right.set(
        xlabel="strength of bending κ  [k]",
        ylabel="error of the tension  [%]",
        title="at $\\gamma = 0$; medians and 80 %",
    )
    right.set_ylim(right.get_ylim()[0] / 30, None)  # room for the names
    right.legend(fontsize=9, frameon=False, handlelength=1.2, loc="lower right")
    lettered(left, right)
    return made


def population_figure(ds):
    """Moduli of the populations at the transition against κ, over those without weak forces."""
    kappas = np.array(parameters(ds)["kappas"])
    parts = ds.onset_modulus / ds.transition_modulus
    made, (axes,) = panels(
        1,
        "As κ → 0 weak bending leaves a third of the modulus at the transition, in every population\n"
        f"({counted(ds)} of {parameters(ds)['n_vertices']} vertices; means; random ℓ: "
        f"s = {NARROW['spread']:g})",
        height=3.3,
    )
    for n, name in enumerate(PAPER_POPULATIONS):
        axes.semilogx(kappas, parts[:, n].mean("seed"), label=LABELS[name], markersize=5, **series(n))
    axes.axhline(1 / 3, color="k", linewidth=0.8, linestyle=":")
    axes.text(kappas.max(), 1 / 3, "1/3", fontsize=9, ha="right", va="bottom")
    axes.set(xlabel="strength of bending κ  [k]", ylabel="$M$ at $\\gamma = 0$ over $M$ past it, κ = 0", ylim=(0, None))
    axes.legend(fontsize=9, frameon=False, ncols=2, loc="lower right", bbox_to_anchor=(1, 0.08))
    return made


def claims(ds):
    """Agreement with relaxed energies, exponents, the limit of the modulus, designs and populations."""
    return [*_of_equations(ds), *_exponents(ds), _third(ds), *_of_networks(ds)]


def _third(ds):
    """The modulus at the transition over B_0 for κ → 0."""
    kappas = np.array(parameters(ds)["kappas"])
    order = np.argsort(kappas)
    parts = (ds.onset_modulus / ds.transition_modulus).values[:, :, order].reshape(-1, len(kappas))
    known = parts[np.isfinite(parts[:, :3]).all(axis=1)]  # those of the limit
    limit = limit_of_smallest(known, np.sort(kappas))
    return Claim.tested(
        "weak-third", "as κ → 0 the modulus at the transition tends to B_0/3, in every population", "",
        f"{spread(limit)} B_0 in the limit, {spread(known[:, 0], 3)} B_0 at κ = {kappas.min():.0e}",
        len(known) > 0 and abs(float(np.mean(limit)) - 1 / 3) <= THIRD, "corrections are not powers of κ^(1/3)",
        criterion=f"mean of the limit within {THIRD} of 1/3", sample=plural(len(known), "configuration"),
    )  # fmt: skip


def _of_equations(ds):
    """Tensions of both equations against those of relaxed energies, measured."""
    kappas = np.array(parameters(ds)["kappas"])
    at = f"at κ = {', '.join(f'{k:.0e}' for k in kappas)}"
    ok = (ds.tension_status == cf.Status.ok) & np.isfinite(ds.relaxed)
    ratio = (np.abs(ds.relaxed - ds.full) / ds.full_error_bound).where(ok)
    full, cubic = (np.abs(ds.relaxed / ds[name] - 1)[:, :, ONSET] for name in ("full", "cubic"))
    return [
        Claim(
            "weak-onset", "deviations of the full equation at the transition from relaxed energies", "",
            f"medians {_percent(full.median('seed'))}, largest {_percent(full.max('seed'))} {at}: terms beyond the "
            "equation grow as κ^(1/3)", "measured",
        ),
        Claim(
            "weak-error", "deviations of the full equation over its stated error", "",
            f"largest {float(ratio.max()):.2f}, median {float(ratio.median()):.2f}", "measured",
            sample=plural(int(ok.sum()), "tension"),
        ),
        Claim(
            "weak-cubic", "deviations of the cubic equation at the transition", "",
            f"medians {_percent(cubic.median('seed'))} {at}", "measured",
        ),
    ]  # fmt: skip


def _percent(values):
    return ", ".join(f"{100 * float(x):.2g} %" for x in values)


def _exponents(ds):
    """Apparent exponents and those of mean field."""
    kappas = np.array(parameters(ds)["kappas"])
    apparent = ds.tension_exponent.values[:, np.argsort(kappas)]
    tension, below = limit_of_smallest(apparent, np.sort(kappas)), ds.limit_exponent.values
    n_below = int(np.isfinite(below).all(axis=1).sum())
    return [
        Claim.tested(
            "weak-tension-exponent", "the tension at the transition grows as κ^(2/3) for κ → 0", "2/3",
            f"{spread(tension, 5)}; {spread(apparent[:, 0])} at κ = {kappas.min():.0e}",
            abs(float(np.nanmean(tension)) - TENSION_EXPONENT) <= 0.0005, "corrections are not powers of κ^(1/3)",
            criterion="mean of the limit within 0.0005, half of the last digit of 0.667",
        ),
        Claim.tested(
            "weak-modulus-exponent", "below the transition M ∝ κ|γ|^(-φ), φ = 3/2, for κ → 0 and then γ → 0", "3/2",
            ", ".join(f"{spread(row)} at |γ| = {-part * WINDOW[1]:.0e} to {-part * WINDOW[0]:.0e}"
                      for row, part in zip(below.T, WINDOWS, strict=True)) + f", κ = {LEAST_KAPPA:.0e}",
            abs(float(np.nanmean(below[:, -1])) - MODULUS_EXPONENT) <= 0.005,
            "the weak Hessian stiffens floppy motions at all κ",
            criterion="mean of the last window within 0.005, half of the last digit of 1.50",
            sample=plural(n_below, "network"),
        ),
    ]  # fmt: skip


def _of_networks(ds):
    """Designs and populations."""
    kappas = np.array(parameters(ds)["kappas"])
    raised = (ds.design_modulus[:, 1] / ds.design_modulus[:, 0]).values
    known = finite(raised)
    moduli = np.nan_to_num(ds.onset_modulus.mean("seed").values)
    stiffest = [NAMES[PAPER_POPULATIONS[n]] for n in moduli.argmax(axis=0)]
    return [
        Claim.tested(
            "weak-design", f"networks designed for {RAISED} × the modulus of max B_0 at κ = {kappas.max():.0e} have it",
            f"{RAISED}", f"relaxed energies {spread(raised)}",
            bool((np.abs(known - RAISED) <= 0.05).all()) if known.size else None,
            "the design follows the full equation, whose terms left out grow with κ",
            criterion="ratio of relaxed moduli within 0.05, every network", sample=plural(len(known), "network"),
        ),
        Claim(
            "weak-stiffest", "the population with the largest mean modulus at the transition, where the theory holds",
            "", ", ".join(f"{name} at {kappa:.0e}" for name, kappa in zip(stiffest, kappas, strict=True)), "measured",
        ),
    ]  # fmt: skip


GRID, LIST = ("seed", "kappa", "place"), ("seed", "kappa")

study = network_study(
    name="weak_forces",
    title="Weak bending at the transition",
    references=SOURCES,
    n=30,
    parameters={"n_vertices": 60, "kappas": (1e-7, 1e-6, 1e-5, 1e-4, 1e-3)},
    coordinates=(Coordinate("kappa", "kappas", "strength of the angle springs"),),
    case=case,
    check=voronoi_check(),
    variables=(
        *numbers(
            GRID,
            relaxed="tension of the relaxed energy",
            full="tension by the full equation",
            cubic="tension by the cubic equation",
            full_error_bound="stated error of the full equation, an estimate",
            cubic_error_bound="difference of both equations and the error of the full one",
        ),
        *outcomes(GRID, tension_status="outcome of the full equation"),
        *numbers(
            LIST,
            unit="tension of the cubic equation at the transition",
            tension_exponent="d ln τ/d ln κ at the transition",
            onset_exponent="d ln M/d ln κ at the transition",
            below_exponent="−d ln M/d ln |γ| below the transition",
        ),
        *numbers(
            ("seed", "window"), limit_exponent="−d ln M/d ln |γ| far above the crossover, at ever smaller strains"
        ),
        *numbers(("seed", "population", "kappa"), onset_modulus="modulus along dilation at the transition"),
        *numbers(("seed", "population"), transition_modulus="modulus along dilation past it, without weak forces"),
        *numbers(("seed", "network"), design_modulus="relaxed modulus along dilation of max B_0 and of the design"),
        *outcomes(("seed",), design_status="outcome of the design"),
    ),
    figures={"weak_forces": figure, "populations": population_figure},
    claims=claims,
)
