"""Statements on local responses: one source and all faces, capacity, limits of stress, reciprocity."""

import numpy as np
from critflow.studies.shared.populations import NAMES, PAPER_POPULATIONS
from critflow.studies.shared.reports import finite, parameters

from critflow.engine import Claim
from critflow.engine.study import plural

from .figures import thresholds
from .measurements import KINDS, NOISY_STRESS, REACHED, STRESSES, STYLES

FAR = 3  # the bin around four spacings, which every network has


def claims(ds):
    """One source commands all faces; capacity; limits of stress; reciprocity; transmitters."""
    return [*_of_training(ds), *_of_capacity(ds), *_of_limits(ds)]


def _of_training(ds):
    loads = parameters(ds)["loads"]
    every = int(np.argmax(loads))
    errors = ds.trained_error[:, STYLES.index("free"), every].values
    best = ds.largest.mean("seed").values
    far = ds.typical.mean("seed").values[:, FAR]
    return [
        Claim.tested(
            "allostery-faces", f"one source commands {loads[every]:.0%} of the other faces, +1 or −1 at random", "",
            f"{int((errors < REACHED).sum())} of {plural(len(errors), 'network')}, largest error {errors.max():.1e}",
            (errors < REACHED).all(), "a search that fails is no proof", criterion="1e-6 in every network",
        ),
        Claim(
            "allostery-untrained", "median response of untrained populations at four spacings", "",
            ", ".join(f"{NAMES[p]} {a:.2g} (largest {b:.2g})" for p, a, b
                      in zip(PAPER_POPULATIONS, far, best, strict=True)), "measured",
        ),
        Claim.tested(
            "allostery-reciprocity", "the product of the responses of two pairs to each other is at most 1", "",
            f"largest {finite(ds.reciprocity).max():.3g}", finite(ds.reciprocity).max() <= 1 + 1e-9,
            "the compliance is not positive", criterion="1e-9", kind="check",
        ),
    ]  # fmt: skip


def _of_capacity(ds):
    sizes, found = parameters(ds)["sizes"], thresholds(ds)
    signs = found[:, KINDS.index("signs")]
    known = np.isfinite(signs)
    text = "; ".join(
        f"{kind}: " + ", ".join(f"{one:.2f} at N_v = {size}" for size, one in zip(sizes, found[:, k], strict=True))
        for k, kind in enumerate(KINDS)
    )
    holds = None if known.sum() < 2 else bool(signs[known][-1] > 0.8 * signs[known][0])
    return [
        Claim.tested(
            "allostery-capacity", "the number of conditions that half of the networks meet grows in proportion to N_v",
            "slower than N in overconstrained networks (Rocks et al. 2019)",
            f"part of N_b − 1 at which half of the searches succeed: {text}", holds,
            "fewer than two sizes have a threshold in the range" if holds is None else "it grows more slowly",
            criterion="part at the largest size above 0.8 of that at the smallest",
            sample="searches, which prove no limit",
        ),
    ]  # fmt: skip


def _of_limits(ds):
    loads = parameters(ds)["loads"]
    reached = ds.trained_error < REACHED
    without = [s for s, style in enumerate(STYLES) if style != "stressed"]
    slope = finite(ds.past_slope.where(reached & (ds.limit > 100 * STRESSES[0]))[:, without])
    stressed_at = int(np.argmin(np.abs(STRESSES - NOISY_STRESS)))
    held = ds.past_error[:, STYLES.index("stressed"), :, stressed_at].values
    text = []
    for s in without:
        style = STYLES[s]
        for n, load in enumerate(loads):
            values = finite(ds.limit[:, s, n].where(reached[:, s, n]))
            text.append(
                f"{style}, {load:.0%}: {np.median(values):.1e}" if len(values) else f"{style}, {load:.0%}: none"
            )
    return [
        Claim.tested(
            "allostery-slope", "under small stress responses leave their limit linearly, with the predicted slope", "",
            f"largest deviation of the slope {slope.max():.1e}" if len(slope) else "no design holds so far",
            None if not len(slope) else slope.max() < 0.05, "terms of the next order",
            criterion="5 % where the limit holds to 1 % beyond a hundred times the stress", kind="check",
        ),
        Claim(
            "allostery-held", f"networks with designs of ±1 under the stress t = {NOISY_STRESS:g}", "",
            ", ".join(f"{load:.0%} of the faces: {int((held[:, n] < REACHED).sum())} of {len(held)}"
                      for n, load in enumerate(loads)), "measured",
        ),
        Claim(
            "allostery-stress", "stress t [k] at which trained responses deviate by 1 %, medians", "", "; ".join(text),
            "measured",
        ),
        Claim(
            "allostery-path", "stress within one spacing of the lines from the source to its targets: ratio of its "
            "geometric mean to that elsewhere, and alignment of the tensions with the lines; medians", "",
            "; ".join(_path(ds, n, load) for n, load in enumerate(loads)), "measured",
        ),
    ]  # fmt: skip


def _path(ds, n, load):
    reached = ds.trained_error[:, 0, n] < REACHED
    stress, aligned = (finite(ds[name][:, 0, n].where(reached)) for name in ("path_stress", "path_alignment"))
    if not len(stress):
        return f"{load:.0%}: none"
    return f"{load:.0%}: {np.exp(np.median(stress)):.2f}, {np.median(aligned):+.2f}"
