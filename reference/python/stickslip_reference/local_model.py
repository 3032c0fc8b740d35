"""The low-order local model (3)-(4): patch, forces and exterior; and the full network behind the same interface."""

import numpy as np

from . import network as net


class LocalModel:
    """What a tick needs between two hand-overs.

    x0, v0 are (n, 3) over all nodes: the state the model was built from, with the exterior's velocity as the model has it.
    `patch` holds the free nodes that move, `tick` the boundary at which x0, v0 were taken.
    """

    integrator = "semi-implicit-euler"
    step = None  # of an integrator that is not explicit, once built

    def __init__(self, network, patch, x0, v0, tick):
        self.network, self.patch, self.x0, self.v0, self.tick = network, patch, x0, v0, tick
        self.springs = net.select_springs(network, patch)
        self.inverse_mass = network.inverse_mass[patch][:, None]
        self.moves = np.zeros(len(x0), bool)
        self.moves[patch] = True

    def forces(self, x, v, elapsed):
        """Forces on the patch nodes, (m, 3), N; `elapsed` is the time since x0, v0."""
        raise NotImplementedError

    def energies(self, x, v):
        """Energies of the patch and of the springs that touch it, the exterior where the model holds it."""
        return net.energies(self.springs, x, v, self.patch)


class TangentModel(LocalModel):
    """f = f0 + K (x - x0) + D (v - v0) of (3), plus (t - t_k) K_LE v_E0 of a drifting exterior, C in K if condensed."""

    def __init__(self, network, patch, x0, v0, tick, stabilised, condensed=None):
        super().__init__(network, patch, x0, v0, tick)
        K, D = net.jacobians(self.springs, x0, v0, stabilised)
        local = components(patch)
        self.f0 = net.forces(self.springs, x0, v0)[patch]
        self.K = K[local][:, local].toarray()
        if condensed is not None:
            self.K += condensed
        self.D = D[local][:, local].toarray()
        exterior_velocity = np.where(self.moves[:, None], 0.0, v0).ravel()
        self.drift = (K[local] @ exterior_velocity).reshape(-1, 3)

    def forces(self, x, v, elapsed):
        dx = (x[self.patch] - self.x0[self.patch]).ravel()
        dv = (v[self.patch] - self.v0[self.patch]).ravel()
        return self.f0 + (self.K @ dx + self.D @ dv).reshape(-1, 3) + elapsed * self.drift


class NonlinearModel(LocalModel):
    """The springs of the patch as they are, x and v holding the exterior, and C (x - x0) when that is condensed."""

    def __init__(self, network, patch, x0, v0, tick, condensed=None):
        super().__init__(network, patch, x0, v0, tick)
        self.condensed = condensed

    def forces(self, x, v, elapsed):
        f = net.forces(self.springs, x, v)[self.patch]
        if self.condensed is None:
            return f
        return f + (self.condensed @ (x[self.patch] - self.x0[self.patch]).ravel()).reshape(-1, 3)


class FullModel(NonlinearModel):
    """The whole network at the local rate."""

    def __init__(self, network):
        patch = np.flatnonzero(~network.fixed)
        super().__init__(network, patch, network.nodes.copy(), np.zeros_like(network.nodes), 0)
        self.springs = network

    def energies(self, x, v):
        return net.energies(self.network, x, v)


def components(nodes):
    """Numbers of the coordinates of `nodes` in a stacked vector."""
    return (3 * np.asarray(nodes)[:, None] + np.arange(3)).ravel()


def centre_node(network, x, anchor):
    """The free surface node nearest to `anchor`, the lowest on a tie; none if every surface node is fixed."""
    surface = np.unique(network.triangles)
    surface = surface[~network.fixed[surface]]
    squared = ((x[surface] - anchor) ** 2).sum(axis=1)
    return surface[[squared.argmin()]] if len(surface) else surface  # argmin takes the first


def within_hops(network, start, rings):
    """Mask of the nodes within `rings` spring hops of `start`; hops may pass through fixed nodes."""
    reached = np.zeros(len(network.nodes), bool)
    reached[start] = True
    for _ in range(rings):
        touched = reached[network.ends].any(axis=1)
        reached[network.ends[touched].ravel()] = True
    return reached


def select_patch(network, centre, rings, contact_nodes):
    """Free nodes within `rings` spring hops of the centre, and those that carry the contact point."""
    if rings == "all":
        return np.flatnonzero(~network.fixed)
    reached = within_hops(network, centre, rings)
    reached[list(contact_nodes)] = True
    return np.flatnonzero(reached & ~network.fixed)


def condensation(network, patch, centre, x0, rings, stabilised):
    """C = -K_LE K_EE^-1 K_EL of an exterior that follows the patch quasi-statically, from the elastic Jacobian alone."""
    K, _ = net.jacobians(network, x0, np.zeros_like(x0), stabilised)
    exterior = ~network.fixed if rings == "all" else within_hops(network, centre, rings) & ~network.fixed
    exterior[patch] = False
    local, outer = components(patch), components(np.flatnonzero(exterior))
    return -K[local][:, outer].toarray() @ np.linalg.solve(K[outer][:, outer].toarray(), K[outer][:, local].toarray())


def build(network, options, x0, v0, tick, anchor, contact_nodes):
    """Local model from the global state at a cycle boundary; `options` is the scene's [local]."""
    centre = centre_node(network, x0, anchor)
    patch = select_patch(network, centre, options.rings, contact_nodes)
    v0 = v0.copy()
    if options.exterior != "drifting":
        exterior = np.ones(len(x0), bool)
        exterior[patch] = False
        v0[exterior] = 0.0
    stabilised = options.tangent == "stabilised"
    condensed = None
    if options.exterior == "condensed":
        condensed = condensation(network, patch, centre, x0, options.condense_rings, stabilised)
    if options.linearization == "none":
        return NonlinearModel(network, patch, x0, v0, tick, condensed)
    model = TangentModel(network, patch, x0, v0, tick, stabilised, condensed)
    model.integrator = options.integrator
    return model
