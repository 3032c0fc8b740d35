"""One free tick of the linear model by each local integrator, and its answer to an impulse spread over the tick.

M dv/dt = f0 + K (x - x0) + D (v - v0) + (t - t_k) g + F with dx/dt = v, g = K_LE v_E0 and a constant force F = impulse / h.
All are over the m nodes of the patch, stacked (3m,). The time of the drift is that of the forces: the tick's end for
implicit Euler, its middle for the midpoint, all of it for the exponential.
"""

import numpy as np
from scipy.linalg import expm


class LinearStep:
    """x and v after a tick: affine in those before it and in the impulse.

    `by_impulse_v` and `by_impulse_x` (3m, 3m) are what an impulse on the nodes adds to v and x at the end of the tick.
    """

    def __init__(self, model, h):
        self.model, self.h = model, h
        self.M = np.diag(np.repeat(model.network.mass[model.patch], 3))
        self.K, self.D = model.K, model.D
        self.constant = model.f0.ravel() - self.K @ model.x0[model.patch].ravel() - self.D @ model.v0[model.patch].ravel()
        self.drift = model.drift.ravel()

    def predict(self, x, v, elapsed):
        """(x, v) of the patch at the end of a free tick, (3m,) each, from those of all nodes, (n, 3)."""
        return self.free(x[self.model.patch].ravel(), v[self.model.patch].ravel(), elapsed)


class ImplicitEuler(LinearStep):
    """M (v1 - v) = h f(x1, v1, t + h) + impulse, x1 = x + h v1."""

    def __init__(self, model, h):
        super().__init__(model, h)
        self.A = self.M - h * self.D - h**2 * self.K
        self.by_impulse_v = np.linalg.inv(self.A)
        self.by_impulse_x = h * self.by_impulse_v

    def free(self, x, v, t):
        h = self.h
        v1 = np.linalg.solve(self.A, self.M @ v + h * (self.constant + self.K @ x + (t + h) * self.drift))
        return x + h * v1, v1


class ImplicitMidpoint(LinearStep):
    """M (v1 - v) = h f((x + x1) / 2, (v + v1) / 2, t + h / 2) + impulse, x1 = x + h (v + v1) / 2."""

    def __init__(self, model, h):
        super().__init__(model, h)
        self.A = self.M - h / 2 * self.D - h**2 / 4 * self.K
        self.by_impulse_v = np.linalg.inv(self.A)
        self.by_impulse_x = h / 2 * self.by_impulse_v

    def free(self, x, v, t):
        h = self.h
        explicit = self.constant + self.K @ (x + h / 4 * v) + self.D @ v / 2 + (t + h / 2) * self.drift
        v1 = np.linalg.solve(self.A, self.M @ v + h * explicit)
        return x + h / 2 * (v + v1), v1


class Exponential(LinearStep):
    """The solution itself: e^(Fh) of the system in (x, v, acceleration by constant forces, acceleration that grows)."""

    def __init__(self, model, h):
        super().__init__(model, h)
        n = len(self.constant)
        # The eigenvalues of the system are far smaller than its norm if x is counted in metres: x is counted in
        # units in which both of its blocks are of one size.
        by_mass = 1.0 / np.diag(self.M)[:, None]
        unit = 1.0 / np.sqrt(max(np.abs(by_mass * self.K).sum(axis=1).max(), 1.0 / h**2))
        zero, one = np.zeros((n, n)), np.eye(n)
        F = np.block([[zero, one / unit, zero, zero], [by_mass * self.K * unit, by_mass * self.D, one, zero],
                      [zero, zero, zero, one], [zero, zero, zero, zero]])
        E = expm(h * F)
        self.from_x, self.from_v, self.from_a, self.from_growth = (E[:2 * n, i * n:(i + 1) * n] for i in range(4))
        for block in (self.from_x, self.from_v, self.from_a, self.from_growth):
            block[:n] *= unit
        self.from_x = self.from_x / unit
        self.by_mass = by_mass.ravel()
        answer = self.from_a * self.by_mass / h
        self.by_impulse_x, self.by_impulse_v = answer[:n], answer[n:]

    def free(self, x, v, t):
        a = self.by_mass * (self.constant + t * self.drift)
        both = self.from_x @ x + self.from_v @ v + self.from_a @ a + self.from_growth @ (self.by_mass * self.drift)
        return both[:len(x)], both[len(x):]


CLASSES = {"implicit-euler": ImplicitEuler, "implicit-midpoint": ImplicitMidpoint, "exponential": Exponential}
