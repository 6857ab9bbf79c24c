"""Weak forces on a critical network: its tension, stress and moduli above, at and below the transition, without a fit.

A weak energy κU, κ ≪ 1, acts on a critical configuration with one self-stress σ.  With τ the amplitude of the stress,
f = −∂U/∂x and H = ∂²U/∂x² there, and strain γ counted from the transition along F(γ), the work of the self-stress on
the change of lengths and the balance of the floppy motions v are

    D τ + (3/2) Q τ² = c γ + ½ g γ² + ½ vᵀP v,     [[τP + κH, Rᵀ], [R, 0]] (v, λ) = (κ(f − γ r), 0)

    c = Σ σ L·A L,  D = Σ σ²|L|²/k,  Q = Σ σ³|L|²/k²,  g = Σ σ(|L̇|² + L·F''L)     along x = F(γ) x_c + γ u
and r = d(∂U/∂x)/dγ.  Terms with g, Q and r are the growth of the elastic response (`stiffening`); the others, with
H = 0, give D τ³ − c γ τ² − ½ κ² fᵀZ(ZᵀPZ)⁻¹Zᵀf = 0, the scaling function with exponents f = 0, φ = 3/2.  Steps:

    1. P on the floppy motions, c, D, Q, g, r of the configuration, once
    2. v as a function of s = τ/κ for all tensions, from about twenty bordered systems (`weak_model`)
    3. one scalar equation for each γ and κ, by bisection and Newton's method, on the branch of positive τP + κH
    4. stress and moduli as derivatives of the same energy: with m = −dΦ/ds, Φ = ½ vᵀP v, and c̃ = c + γ g − dv·r
       V σ_γ = τ(c + γ g) + κ dU/dγ,   V M_ab = c̃_a c̃_b/(D + 3Qτ + m/κ) + τ g_ab + κ (d²U/da db − r_a(sP + H)⁻¹r_b)
    5. errors by a few steps of the whole energy from each solution, a factorisation each (`weak_correction`)
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from critflow.arguments import floats, of_kind, shown
from critflow.calls import running
from critflow.deformation import Deformable, Deformation
from critflow.manifold import CriticalConfiguration
from critflow.networks import Array
from critflow.result import InputError, Record, Solution, Stats, Status
from critflow.self_stress import stabilises
from critflow_extras.weak.soft_spectrum import require_floppy_motions, soft_eigenvalues
from critflow_extras.weak.weak_correction import WeakCorrection
from critflow_extras.weak.weak_derivatives import PLACES, STEP, WeakDerivatives
from critflow_extras.weak.weak_energies import ENERGIES, Temperature, WeakEnergy, WeakFunction, no_energy, weak_function
from critflow_extras.weak.weak_equilibrium import fixed_deformation
from critflow_extras.weak.weak_model import Modes, ThermalModel, WeakModel
from critflow_extras.weak.weak_system import WeakStrain, WeakSystem

LARGEST_ERROR = 0.1  # of the tension, beyond which values are NaN
NO_WORK = 1e-9  # part of Σσ|L||AL| below which a strain does no work on the self-stress
# Distances from the end of the branch, in units of tr H/tr P: the first nodes, and the closest that are solved.
_FIRST_NODES, _CLOSEST = (0.5, 8.0), 1e-6
_BISECTIONS, _NEWTON_STEPS = 60, 4
# Nodes extend by this factor beyond the requested distances: at their edges the model has half of its digits.
_MARGIN = 4.0
_MOST_EXTENSIONS = 12  # of the nodes, until they span all requested tensions


@dataclass(frozen=True, eq=False)
class WeakState:
    """Solutions of the scalar equation, arrays of one shape."""

    strain: Array
    kappa: Array
    s: Array  # τ/κ of the stress amplitude τ
    load: Array  # f − γ r on the modes, (..., m)
    resistance: Array
    error: Array  # estimate of the error of s by interpolation; of `_judged`: that of the tension
    status: NDArray[np.int64]  # codes of `Status`


@dataclass(frozen=True, eq=False, repr=False)
class WeakForces(Record):
    """Response of a critical configuration to strain γ under a weak energy κU.

    Methods take arrays of strains, counted from the transition, and of κ > 0, which broadcast; values are NaN where
    `status` is not ok.

    work, compliance, softening, growth  c, D, Q and g of the module's docstring
    """

    critical: CriticalConfiguration
    deformation: Deformation
    work: float
    compliance: float
    softening: float
    growth: float
    _energy: WeakFunction = field(repr=False)
    _path: WeakStrain = field(repr=False)
    _model: WeakModel | ThermalModel = field(repr=False)
    _correction: WeakCorrection | None = field(default=None, repr=False)
    _full: WeakForces | None = field(default=None, repr=False)
    # Errors by quantity, strain and κ, each of which costs a few factorisations.
    _found: dict[tuple[str, float, float], float] = field(default_factory=dict, repr=False)

    def tension(self, strain: ArrayLike, kappa: ArrayLike) -> Array:
        """τ: the tension of edge α is τ σ_α|L_α| with Σσ² = N_b, and what the weak forces add; units of k."""
        state = self._judged(strain, kappa)
        return self._valid(state, self._tension(state))

    def error(self, strain: ArrayLike, kappa: ArrayLike) -> Array:
        """Error (estimate) of the tension: what steps of the whole energy change it by (`weak_correction`)."""
        return self._judged(strain, kappa).error[()]

    def status(self, strain: ArrayLike, kappa: ArrayLike) -> NDArray[np.int64]:
        """Codes of `Status`: ok; unstable where the branch ends; out_of_range where the error exceeds a tenth.

        The error is relative to the tension.  The branch ends where the stiffness τP + κH of a floppy motion vanishes.
        The cubic equation has values everywhere.
        """
        return self._judged(strain, kappa).status[()]

    def stress(self, strain: ArrayLike, kappa: ArrayLike) -> Array:
        """(1/V) dE/dγ with V of the strained network, of springs and weak energy together."""
        state = self._judged(strain, kappa)
        return self._valid(state, self._stress(state) / self._volume(state))

    def stress_error(self, strain: ArrayLike, kappa: ArrayLike) -> Array:
        """Error (estimate) of the stress, as that of the tension; it may exceed the stress where that changes sign."""
        state = self._judged(strain, kappa)
        if self._full is not None:
            difference = np.abs(self.stress(strain, kappa) - self._full.stress(strain, kappa))
            return np.asarray(difference + self._full.stress_error(strain, kappa))[()]
        if self._correction is None:
            change = self._stress(self._shifted(state)) - self._stress(state)
        else:
            change = self._corrected("stress", state, self._stress(state))
        return np.asarray(np.abs(change) / self._volume(state))[()]

    def modulus(self, strain: ArrayLike, kappa: ArrayLike, deformation: Deformable | None = None) -> Array:
        """(1/V) d²E/dγ² along the path, or (1/V) d²E/dε² of another deformation, with V of the strained network."""
        state = self._judged(strain, kappa)
        return self._valid(state, self._modulus(state, deformation) / self._volume(state))

    def modulus_error(self, strain: ArrayLike, kappa: ArrayLike, deformation: Deformable | None = None) -> Array:
        """Error (estimate) of the modulus, as that of the tension."""
        state = self._judged(strain, kappa)
        if self._full is not None:
            difference = self.modulus(strain, kappa, deformation) - self._full.modulus(strain, kappa, deformation)
            return np.asarray(np.abs(difference) + self._full.modulus_error(strain, kappa, deformation))[()]
        if self._correction is None:
            change = self._modulus(self._shifted(state), deformation) - self._modulus(state, deformation)
        else:
            change = self._corrected("modulus", state, self._modulus(state, deformation), deformation)
        return np.asarray(np.abs(change) / self._volume(state))[()]

    def modulus_derivatives(self, strain: float, kappa: float) -> tuple[Array, ...]:
        """Derivatives of `modulus` along the path by σ (N_b,), L (N_b, d), free coordinates (n_free, d) and k (N_b,).

        Each is at constant others (`weak_derivatives`), with errors of about 1e-7 of the largest.
        """
        if self._full is not None:
            raise InputError("derivatives of the modulus are those of the full equation: choose order='full'")
        here = self._solve(strain, kappa)
        reach = float(kappa * here.resistance * (here.s - self.branch_end) / abs(self.work))
        strains = np.asarray(strain + STEP * reach * PLACES, dtype=float)
        derivatives = WeakDerivatives(self._model.system, self._path, self._energy, kappa)
        volume = float(self._volume(here))
        return tuple(each / volume for each in derivatives.second(strains, self._solve(strains, kappa).s))

    def displacement(self, strain: ArrayLike, kappa: ArrayLike) -> Array:
        """Displacements (..., N_v, d) of the vertices from F(γ) x_c."""
        state = self._judged(strain, kappa)
        floppy = self._model.modes.amplitudes(state.s, state.load) @ self._model.modes.vectors.T
        return self._on_vertices(state, state.strain[..., None] * self._path.motion + floppy)

    def nonaffinity(self, strain: ArrayLike, kappa: ArrayLike) -> Array:
        """(1/N_v) Σ|du/dγ|² of the displacements u, in units of length squared."""
        state, modes = self._judged(strain, kappa), self._model.modes
        moving = modes.amplitudes(state.s, state.load, 2)
        pulled = np.sum(modes.loads[1] * moving, axis=-1)  # −dΦ/dγ at constant s
        rate = (self.work + self.growth * state.strain - pulled) / (state.kappa * state.resistance)
        slope = -rate[..., None] * moving
        slope = slope - modes.amplitudes(state.s, modes.loads[1])
        moved = self._on_vertices(state, self._path.motion + slope @ modes.vectors.T)
        return np.sum(moved**2, axis=(-2, -1)) / self.critical.network.n_vertices

    def crossover(self, kappa: ArrayLike) -> Array:
        """D τ/c at the transition: the strain that alone would give the tension of the weak forces there."""
        return self.compliance / self.work * self.tension(0.0, kappa)

    def soft_eigenvalues(self, n: int) -> Array:
        """The n least eigenvalues (n,) of P on the floppy motions: those of the soft band of springs, per tension τ."""
        return soft_eigenvalues(self._model.system, n)

    @property
    def branch_end(self) -> float:
        """τ/κ at which the stiffness τP + κH of a floppy motion vanishes; above it the branch is stable."""
        return self._model.end

    @property
    def cubic(self) -> bool:
        """Whether the equation is that of the leading order; its error is the difference to the full one."""
        return self._full is not None

    # Values of a solution of the scalar equation

    def _tension(self, state: WeakState) -> Array:
        stress = state.kappa * state.s
        return np.asarray(stress * (1 + self.softening / self.compliance * stress))

    def _stress(self, state: WeakState) -> Array:
        """dE/dγ."""
        amplitude, gamma, path = state.kappa * state.s, state.strain, self._path
        weak = path.weak_rate + gamma * path.weak_curvature
        weak = weak + np.sum(self._model.modes.loads[1] * self._model.modes.amplitudes(state.s, state.load), axis=-1)
        return np.asarray(amplitude * (self.work + self.growth * gamma) + state.kappa * (not self.cubic) * weak)

    def _modulus(self, state: WeakState, deformation: Deformable | None) -> Array:
        """d²E/dε²."""
        other, modes = self._path, self._model.modes
        load, growth = modes.loads[1], self.deformation.second_rate(0.0)
        mixed = growth
        if deformation is not None:
            path = fixed_deformation(deformation, self.critical.network.dimension)
            other, growth = WeakStrain(self._model.system, self._energy, path), path.second_rate(0.0)
            mixed = other.strain @ self._path.strain
        if self._full is not None:
            return np.asarray(other.work**2 / state.resistance)
        if deformation is not None:
            modes = self._model.extended(other.weak_load)
            load = modes.loads[2]
        forces = modes.loads[0] - state.strain[..., None] * modes.loads[1]
        work = other.work + state.strain * other.turning(self._path, mixed)
        work = work - np.sum(load * modes.amplitudes(state.s, forces, 2), axis=-1)
        weak = other.weak_curvature - np.sum(load * modes.amplitudes(state.s, load), axis=-1)
        geometric = state.s * other.turning(other, growth) + weak
        return np.asarray(work**2 / state.resistance + state.kappa * geometric)

    # Their errors

    def _judged(self, strain: ArrayLike, kappa: ArrayLike) -> WeakState:
        """The solutions with errors of the tension and statuses."""
        state = self._solve(strain, kappa)
        if self._full is not None:  # the cubic equation
            full = self._full._judged(strain, kappa)
            error = np.abs(self._full._tension(full) - self._tension(state)) + full.error
            return replace(state, error=error, status=np.full(state.s.shape, int(Status.ok)))
        if isinstance(self._model, ThermalModel):
            left_out = np.abs(self._model.neglected_slopes(state.s, state.kappa)).sum(axis=-1)
            elastic = 0.5 * np.abs(self.growth * state.strain / self.work)
            elastic = elastic + 1.5 * np.abs(self.softening / self.compliance * state.kappa * state.s)
            error = left_out / state.resistance + state.kappa * elastic**2 * np.abs(state.s)
        else:
            error = self._corrected("tension", state, self._tension(state))
        error = error + state.kappa * state.error
        excessive = ~(error <= LARGEST_ERROR * np.abs(self._tension(state)))
        status = np.where(excessive & (state.status == Status.ok), int(Status.out_of_range), state.status)
        return replace(state, error=error, status=status)

    def _shifted(self, state: WeakState) -> WeakState:
        """The state with a tension that is larger by its error."""
        s = state.s + state.error / state.kappa
        return replace(state, s=s, resistance=self._resistance(state.kappa, s, state.load, self._model.modes))

    def _corrected(
        self, quantity: str, state: WeakState, values: Array, deformation: Deformable | None = None
    ) -> Array:
        """Errors of values (...) by steps of the whole energy; infinite where the branch has ended."""
        assert self._correction is not None
        path = None
        if deformation is not None:
            path = fixed_deformation(deformation, self.critical.network.dimension)
        result, modes = np.full(state.s.shape, np.inf), self._model.modes
        for n in np.ndindex(state.s.shape):
            if state.status[n] == Status.unstable:
                continue
            key = quantity, float(state.strain[n]), float(state.kappa[n])
            error = self._found.get(key) if path is None else None
            if error is None:
                floppy = modes.vectors @ modes.amplitudes(state.s[n], state.load[n])
                tau = float(state.kappa[n] * state.s[n])
                error = _error(self._correction.steps(*key, tau, floppy, path), float(values[n]))
            if path is None:
                self._found[key] = error
            result[n] = error
        return result

    # The scalar equation

    def _solve(self, strain: ArrayLike, kappa: ArrayLike) -> WeakState:
        gamma, kappa_ = np.broadcast_arrays(_numbers(strain, "strain"), _numbers(kappa, "kappa"))
        if not (kappa_ > 0).all():
            raise InputError(f"kappa must be positive, or the temperature, not {kappa_.min()}: leave out zero")
        model, closest = self._model, _CLOSEST * self._model.scale
        for _ in range(_MOST_EXTENSIONS):
            x = self._roots(gamma, kappa_, model.modes, model.end)
            low, high = model.covered
            inside = x[x > closest]
            if not inside.size or (inside.min() >= _MARGIN * low and _MARGIN * inside.max() <= high):
                break
            model.cover(min(low, inside.min() / _MARGIN), max(high, _MARGIN * inside.max()))
        coarse = self._roots(gamma, kappa_, model.coarse, model.end)
        return self._state(gamma, kappa_, x, coarse, model.modes)

    def _balance(self, gamma: Array, kappa: Array, s: Array, load: Array, modes: Modes) -> Array:
        """(D τ + (3/2) Q τ² − c γ − ½ g γ² − Φ)/κ, which grows with s."""
        elastic = self.compliance * s + 1.5 * self.softening * kappa * s**2
        return elastic - (self.work * gamma + 0.5 * self.growth * gamma**2 + modes.work(s, load)) / kappa

    def _roots(self, gamma: Array, kappa: Array, modes: Modes, end: float) -> Array:
        """Distances s − s_end of the solutions; below the closest where there is none."""
        load = modes.loads[0] - gamma[..., None] * modes.loads[1]
        scale = self._model.scale
        reach = np.abs(self.work * gamma) + 0.5 * np.abs(self.growth) * gamma**2
        reach = reach + modes.work(np.full(gamma.shape, end + scale), load)
        low = np.full(gamma.shape, np.log(0.01 * _CLOSEST * scale))
        high = np.log(2 * (scale + abs(end) + reach / (kappa * self.compliance)))
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            above = self._balance(gamma, kappa, end + np.exp(middle), load, modes) > 0
            low, high = np.where(above, low, middle), np.where(above, middle, high)
        x = np.exp(0.5 * (low + high))
        for _ in range(_NEWTON_STEPS):
            s = end + x
            slope = self._resistance(kappa, s, load, modes)
            step = -self._balance(gamma, kappa, s, load, modes) / slope
            x = np.where(np.abs(step) < 1e-3 * x, x + step, x)
        return x

    def _resistance(self, kappa: Array, s: Array, load: Array, modes: Modes) -> Array:
        """D + 3Qτ + m/κ."""
        return self.compliance + 3 * self.softening * kappa * s + modes.work_slope(s, load) / kappa

    def _state(self, gamma: Array, kappa: Array, x: Array, coarse: Array, modes: Modes) -> WeakState:
        s, load = self.branch_end + x, modes.loads[0] - gamma[..., None] * modes.loads[1]
        resistance = self._resistance(kappa, s, load, modes)
        status = np.where(x < _CLOSEST * self._model.scale, int(Status.unstable), int(Status.ok))
        return WeakState(gamma, kappa, s, load, resistance, np.abs(coarse - x), status)

    def _volume(self, state: WeakState) -> Array:
        """V det F(γ) of the strained network."""
        factors = [np.linalg.det(self.deformation.gradient(strain)) for strain in state.strain.flat]
        return self.critical.network.volume * np.reshape(factors, state.strain.shape)

    def _valid(self, state: WeakState, value: Array) -> Array:
        return np.where(state.status == Status.ok, value, np.nan)[()]

    def _on_vertices(self, state: WeakState, motion: Array) -> Array:
        network = self.critical.network
        u = np.zeros((*state.s.shape, network.n_vertices, network.dimension))
        u[..., network.free, :] = motion.reshape(*state.s.shape, -1, network.dimension)
        u[state.status != Status.ok] = np.nan
        return u


@running("weak_forces")
def weak_forces(
    critical: CriticalConfiguration,
    energy: WeakEnergy,
    deformation: Deformable = "dilation",
    *,
    order: str = "full",
    throw: bool = True,
) -> Solution[WeakForces]:
    """Tension, stress, moduli and displacements under strain and a weak energy κU, from the configuration alone.

    The module's docstring has the equations: all constants are exact at the critical configuration, nothing is fitted.

    energy       `AngleSprings`, `SoftSprings`, `PointForces`, a function x (N_v, d), F (d, d) → U, ∂U/∂x (N_v, d) and
                 ∂²U/∂x∂x sparse (d·N_v)², or a list of these; or `Temperature()` alone: κ is T (`ThermalModel`)
    deformation  what `deformation_of` accepts, with a fixed cell
    order        "full", or "cubic": the leading order, D τ³ − c γ τ² − ½κ²F = 0, without H and without growth; of
                 temperature D τ² − c γ τ − ½N_f T = 0

    `Status.unstable` where the self-stress does not stabilise the floppy motions, `Status.undecided` where rounding
    hides whether it does, `Status.floppy` where the strain does no work on the self-stress.
    Raises `InputError` for several self-stresses, slack edges, and networks without floppy motions.

    >>> import critflow as cf
    >>> import critflow_extras as ce
    >>> from critflow_extras.weak.weak_energies import AngleSprings
    >>> critical = cf.optimize(cf.voronoi_network(n_vertices=20, seed=1), 'B_0').value
    >>> weak = ce.weak_forces(critical, AngleSprings()).value
    >>> weak.tension([-0.001, 0.0, 0.001], 1e-5).shape
    (3,)
    """
    critical = of_kind(CriticalConfiguration, critical=critical)
    of_kind(*ENERGIES, energy=energy)
    of_kind(str, order=order)
    of_kind(bool, throw=throw)
    if order not in ("full", "cubic"):
        raise InputError(f"the order of weak forces is 'full' or 'cubic', not {shown(order)}")
    network, sigma = critical.network, critical.sigma
    path = fixed_deformation(deformation, network.dimension)
    require_floppy_motions(critical, "remove edges until one is left, or relax all with weak_equilibrium()")
    thermal = isinstance(energy, Temperature)
    U = no_energy if thermal else weak_function(energy, network)
    if (failed := _failure(critical, path)) is not None:
        return _refused(*failed, throw)
    force, hessian = _of_free_vertices(U, critical)
    system = WeakSystem(critical, hessian)
    strain = WeakStrain(system, U, path)
    loads = np.array([force, strain.weak_load])
    model: WeakModel | ThermalModel = ThermalModel(system, strain) if thermal else WeakModel(system, loads)
    if not np.isfinite(model.end):
        note = "the end of the stable branch was not found: scale the weak energy, or relax it with weak_equilibrium()"
        return _refused(Status.stalled, note, throw)
    model.cover(*(place * model.scale for place in _FIRST_NODES))
    growth = strain.turning(strain, path.second_rate(0.0))
    softening = float(np.sum(sigma**2 * system.flexible_stress / network.stiffness))
    correction = None if thermal else WeakCorrection(system, U, strain, path)
    value = WeakForces(critical, path, strain.work, system.compliance, softening, growth, U, strain, model, correction)
    if order == "cubic":
        value = replace(value, softening=0.0, growth=0.0, _model=model.leading(), _full=value)  # type: ignore[arg-type]
    return Solution(value, Status.ok, Stats("weak forces", len(model.modes.theta)))


def _of_free_vertices(U: WeakFunction, critical: CriticalConfiguration) -> tuple[Array, sp.csr_array]:
    """Forces −∂U/∂x and ∂²U/∂x∂x of the free vertices, (n,) and (n, n), at the configuration."""
    network = critical.network
    _, gradient, hessian = U(critical.coordinates, np.eye(network.dimension))
    rows = np.arange(gradient.size).reshape(gradient.shape)[network.free].ravel()
    force = -gradient[network.free].ravel()
    if not (np.isfinite(force).all() and np.isfinite(hessian.data).all()):
        raise InputError("the weak energy has no finite forces at the critical configuration: correct its function")
    return force, sp.csr_array(hessian)[rows][:, rows]


def _refused(status: Status, note: str, throw: bool) -> Solution[WeakForces]:
    solution: Solution[WeakForces] = Solution(None, status, Stats("weak forces"), note)  # type: ignore[arg-type]
    return solution.or_raise("no theory of weak forces") if throw else solution


def _error(steps: Array, value: float) -> float:
    """|X_n − X_0| + |X_n − X_{n−1}| of values after steps (n,) and X_0."""
    last, before = steps[-1], steps[-2] if len(steps) > 1 else value
    return float(abs(last - value) + abs(last - before)) if np.isfinite(last) else np.inf


def _numbers(values: ArrayLike, name: str) -> Array:
    array = floats(values, name)
    if not np.isfinite(array).all():
        raise InputError(f"{name} must be finite: leave out the values that are not")
    return array


def _failure(critical: CriticalConfiguration, path: Deformation) -> tuple[Status, str] | None:
    """The status, and a note, of a configuration that the theory does not cover."""
    sigma, L = critical.sigma, critical.bond_vectors
    stable = stabilises(critical.network, critical.coordinates, L, sigma)
    if stable is False:
        return Status.unstable, "the stress does not stabilise all floppy motions"
    if not stable:
        return Status.undecided, ""
    affine = L @ path.rate(0.0).T
    work = abs(float(sigma @ np.einsum("ad,ad->a", L, affine)))
    if not work > NO_WORK * float(np.sum(np.abs(sigma) * critical.lengths * np.linalg.norm(affine, axis=1))):
        return Status.floppy, "the strain does no work on the self-stress: choose another one"
    return None
