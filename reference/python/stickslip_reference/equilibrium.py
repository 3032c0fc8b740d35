"""Static equilibrium under gravity: Newton's method on the forces, downhill in the energy."""

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from . import local_model
from . import network as net
from .scene import SceneError

# The force left on a free node over the largest weight of one. Rounding of positions leaves less in scenes that sag visibly.
RESIDUAL = 1e-12
ITERATIONS = 100


def settle(network):
    """Positions at which nothing pulls on a free node."""
    x, still = network.nodes.copy(), np.zeros_like(network.nodes)
    free = local_model.components(np.flatnonzero(~network.fixed))
    if len(free) == 0:
        return x
    allowed = RESIDUAL * (network.mass[~network.fixed] * np.linalg.norm(network.gravity)).max()

    def energy(x):
        return sum(net.energies(network, x, still)[1:])

    for _ in range(ITERATIONS):
        force = net.forces(network, x, still).ravel()[free]
        if np.abs(force).max() <= allowed:
            return x
        K = net.jacobians(network, x, still)[0][free][:, free]
        try:
            step = splu(sparse.csc_matrix(-K)).solve(force)
        except RuntimeError:  # exactly singular
            break
        if not step @ force > 0.0:
            break
        share, trial, before = 1.0, x.copy(), energy(x)
        while share > 1e-6:
            trial.reshape(-1)[free] = x.ravel()[free] + share * step
            # The energy of a place next to the lowest one differs from it by less than rounding.
            if energy(trial) <= before + 1e-14 * abs(before):
                break
            share /= 2.0
        x = trial.copy()
    raise SceneError("no equilibrium under gravity was found to start from")
