"""Semi-implicit Euler in numpy, float64: what vectorised Python does without a compiler."""

import numpy as np
from protocol import serve


class Simulation:
    """v <- v + h M^-1 f(x, v), x <- x + h v."""

    def __init__(self, network):
        self.network = network
        self.inverse_mass = network.inverse_mass[:, None]
        self.lower, self.upper = (np.ascontiguousarray(ends) for ends in network.ends.T)
        self.reset()

    def reset(self):
        self.x, self.v = self.network.x.copy(), self.network.v.copy()

    def forces(self):
        network, n = self.network, len(self.x)
        d = self.x[self.upper] - self.x[self.lower]
        length = np.sqrt(np.einsum("sa,sa->s", d, d))
        rate = np.einsum("sa,sa->s", self.v[self.upper] - self.v[self.lower], d) / length
        tension = network.stiffness * (length - network.rest_length) + network.damping * rate
        d *= (tension / length)[:, None]
        f = np.empty((n, 3))
        for axis in range(3):
            f[:, axis] = np.bincount(self.lower, d[:, axis], n) - np.bincount(self.upper, d[:, axis], n)
        return f

    def run(self, steps):
        h = self.network.step
        for _ in range(steps):
            self.v += h * (self.forces() * self.inverse_mass)
            self.x += h * self.v

    def positions(self):
        return self.x


if __name__ == "__main__":
    serve(Simulation)
