"""Springs with weak bending: equilibria at a sequence of volumetric strains, by Newton's method with dense matrices.

The energy is E = ½ Σ (|L| − ℓ)² + ½κ Σ (θ − θ₀)² over all pairs of edges that meet at a vertex, with their angle
0 ≤ θ ≤ π and θ₀ that of the network as made.  In the plane an angle changes by the difference of the rotations of its
edges.  With these differences B (n_pairs, N_b), the rotations J = ∂ψ/∂x, whose rows have the blocks εL/|L|² with the
quarter turn ε, and the moments m = κBᵀ(±(θ − θ₀)),
    ∂E/∂x = Rᵀσ + Jᵀm,      H = RᵀKR + P ⊗ 1 + κ JᵀBᵀBJ + Σ_a m_a ∂²ψ_a/∂x∂x.
"""

import numpy as np

BALANCED = 1e-13  # largest force, in units of stiffness times length
MOST_STEPS = 100
STRAIN_STEP = 0.0025  # most between two equilibria, the second of which starts at the first
SHORTEST = 1e-10  # part of a Newton step
ROUNDING = 1e-15  # of the energy


class BentNetwork:
    """Springs of the lengths of a critical configuration of a `Sample`, with bending of stiffness κ."""

    def __init__(self, sample, critical, kappa):
        self.sample, self.critical, self.kappa = sample, critical, kappa
        meets = np.abs(sample.g)
        first, second, vertex = np.nonzero(np.triu(np.ones((len(meets),) * 2), 1)[:, :, None] * meets[:, None] * meets)
        self.pairs, self.signs = (first, second), sample.g[first, vertex] * sample.g[second, vertex]
        one = np.eye(len(meets))
        self.B = one[second] - one[first]
        self.rest = np.abs(self.angles(sample.network.bond_vectors(sample.network.positions)))

    def pressures(self, strains):
        """dE/dV at volumetric strains γ from the transition (n,), of which the first stretches the network."""
        x, at, found = self.critical.coordinates, 0.0, []
        for strain in strains:
            steps = max(1, int(np.ceil(abs(strain - at) / STRAIN_STEP)))
            for there in np.linspace(at, strain, steps + 1)[1:]:
                x, at = self.relaxed(np.sqrt((1 + there) / (1 + at)) * x, there), there
            lengths = np.linalg.norm(self.bond_vectors(x, at), axis=1)
            # Dilation turns no edge, so that bending has no part in its work.
            work = (lengths - self.critical.lengths) @ lengths
            found.append(work / (2 * self.sample.network.volume * (1 + at)))
        return np.array(found)

    def relaxed(self, x, strain):
        """The equilibrium near coordinates x (N_v, 2); `ArithmeticError` where none is found."""
        for _ in range(MOST_STEPS):
            gradient, hessian = self.derivatives(x, strain)
            if np.abs(gradient).max() < BALANCED:
                return x
            # The first vertex stays in its place, and motions of negative stiffness lower the energy too.
            values, modes = np.linalg.eigh(hessian[2:, 2:])
            step = -modes @ ((modes.T @ gradient[2:]) / np.abs(values))
            u, slope = np.concatenate([[0.0, 0.0], step]).reshape(x.shape), gradient[2:] @ step
            part, highest = 1.0, self.energy(x, strain) + ROUNDING
            while self.energy(x + part * u, strain) > highest + 1e-4 * part * slope and part > SHORTEST:
                part /= 2
            x = x + part * u
        raise ArithmeticError(f"no equilibrium in {MOST_STEPS} steps")

    def energy(self, x, strain):
        L = self.bond_vectors(x, strain)
        extension, bent = np.linalg.norm(L, axis=1) - self.critical.lengths, np.abs(self.angles(L)) - self.rest
        return 0.5 * (extension @ extension + self.kappa * bent @ bent)

    def bond_vectors(self, x, strain):
        return self.sample.g @ x + np.sqrt(1 + strain) * self.sample.network.boundary_vectors

    def angles(self, L):
        """±θ (n_pairs,) from the first to the second edge of each pair, away from their vertex."""
        (ax, ay), (bx, by) = (L[edges].T for edges in self.pairs)
        return np.arctan2(self.signs * (ax * by - ay * bx), self.signs * (ax * bx + ay * by))

    def derivatives(self, x, strain):
        """∂E/∂x (2 N_v,) and H (2 N_v, 2 N_v)."""
        sample, L = self.sample, self.bond_vectors(x, strain)
        squares, turned = np.sum(L**2, axis=1), np.stack([-L[:, 1], L[:, 0]], axis=1)
        sigma, angles = 1 - self.critical.lengths / np.sqrt(squares), self.angles(L)
        R, J = sample.response(L), sample.response(turned / squares[:, None])
        moments = self.kappa * (angles - np.sign(angles) * self.rest) @ self.B
        H = R.T @ (((1 - sigma) / squares)[:, None] * R) + sample.laplacian(sigma)
        H += self.kappa * (self.B @ J).T @ (self.B @ J)
        # ∂²ψ/∂L∂L = −(L (εL)ᵀ + εL Lᵀ)/|L|⁴
        curved = L[:, :, None] * turned[:, None, :]
        blocks = -(moments / squares**2)[:, None, None] * (curved + curved.transpose(0, 2, 1))
        for i, j in np.ndindex(2, 2):
            H[i::2, j::2] += sample.g.T @ (blocks[:, i, j, None] * sample.g)
        return R.T @ sigma + J.T @ moments, H
