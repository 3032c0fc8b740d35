"""The full model: forces, Jacobians, the block and its free motion."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from setups import lumps, scene
from stickslip_reference import cycle, equilibrium, stability
from stickslip_reference import network as net

# Relative to the largest entry; both derivatives are exact to round-off. Measured: 2.6e-16.
JACOBIAN_TOLERANCE = 1e-14
# Sum of the internal forces over their largest entry; every spring adds +F and -F. Measured: 1.5e-16.
MOMENTUM_TOLERANCE = 1e-14
# Volume of the surface over that of the box; sums of a few hundred products. Measured: 0.
VOLUME_TOLERANCE = 1e-13
# Eigenvalues over the largest |eigenvalue|: what round-off may leave of a zero. Measured: 1.5e-16.
EIGENVALUE_TOLERANCE = 1e-14
# Observed order of convergence, off 4 and 1. Measured: 0.03 and 6e-4.
# Radau's own tolerance, 1e-9 of positions of 10 mm, which move by less; measured 4e-10.
RADAU_TOLERANCE = 1e-8
ORDER_TOLERANCE = {"rk4": 0.2, "semi-implicit-euler": 0.1}
# Formula against the eigenvalues, relative. The eigenvalues meet at -1 there, which costs digits. Measured: 2.2e-13.
LIMIT_TOLERANCE = 1e-11

# Displacements of 1e-7 of nodes 1e-2 apart: the springs are linear to about 1e-5. Measured: 1.0e-5.
LINEAR_TOLERANCE = 5e-5


def moving(network, rng):
    x = network.nodes + 0.1 * rng.normal(size=network.nodes.shape)
    return x, rng.normal(size=network.nodes.shape)


def test_jacobians_equal_complex_steps(within):
    rng = np.random.default_rng(1)
    network = lumps(rng)
    x, v = moving(network, rng)
    for analytic, stepped in zip(net.jacobians(network, x, v), net.complex_step_jacobians(network, x, v)):
        scale = np.abs(stepped).max()
        within("Jacobians against complex steps", np.abs(analytic.toarray() - stepped).max() / scale, JACOBIAN_TOLERANCE)


def test_damping_part_is_not_symmetric_and_not_dropped():
    rng = np.random.default_rng(2)
    network = lumps(rng)
    x, v = moving(network, rng)
    moved, still = (net.jacobians(network, x, speed)[0].toarray() for speed in (v, 0.0 * v))
    assert np.abs(moved - moved.T).max() > 1e-3
    assert np.abs(still - still.T).max() <= JACOBIAN_TOLERANCE * np.abs(still).max()


def test_stabilised_tangent_is_negative_semidefinite_under_compression_and_the_exact_one_is_not(within):
    network = net.block(scene(mesh={"nodes": [3, 3, 3]}))
    x, v = 0.7 * network.nodes, np.zeros_like(network.nodes)
    largest = {}
    for stabilised in (False, True):
        eigenvalues = np.linalg.eigvalsh(net.jacobians(network, x, v, stabilised)[0].toarray())
        largest[stabilised] = eigenvalues.max() / np.abs(eigenvalues).max()
    within("largest eigenvalue of the stabilised tangent", largest[True], EIGENVALUE_TOLERANCE)
    assert largest[False] > 1e-3


def test_internal_forces_keep_momentum(within):
    rng = np.random.default_rng(3)
    network = lumps(rng)
    x, v = moving(network, rng)
    external = network.mass[:, None] * network.gravity - network.drag * v
    internal = net.forces(network, x, v) - external
    within("sum of internal forces", np.abs(internal.sum(axis=0)).max() / np.abs(internal).max(), MOMENTUM_TOLERANCE)


def test_block_counts_and_order():
    network = net.block(scene())
    nx, ny, nz = 9, 9, 4
    axis = (nx - 1) * ny * nz + nx * (ny - 1) * nz + nx * ny * (nz - 1)
    diagonal = 2 * ((nx - 1) * (ny - 1) * nz + (nx - 1) * ny * (nz - 1) + nx * (ny - 1) * (nz - 1))
    body = 4 * (nx - 1) * (ny - 1) * (nz - 1)
    for stencil, count in (("structural", axis), ("shear", axis + diagonal), ("full", axis + diagonal + body)):
        ends = net.block(scene(mesh={"stencil": stencil})).ends
        assert len(ends) == len({tuple(pair) for pair in ends.tolist()}) == count
    ix, iy, iz = 2, 5, 3
    expected = [(ix - 4) * 0.0125, (iy - 4) * 0.0125, 0.0]
    assert network.nodes[(iz * ny + iy) * nx + ix].tolist() == expected
    assert network.fixed.sum() == nx * ny and network.nodes[network.fixed, 2].max() == network.nodes[:, 2].min()


def test_block_surface_is_closed_and_outward(within):
    network = net.block(scene())
    edges = {(int(t[a]), int(t[b])) for t in network.triangles for a, b in ((0, 1), (1, 2), (2, 0))}
    assert len(edges) == 3 * len(network.triangles) and edges == {(b, a) for a, b in edges}
    a, b, c = (network.nodes[network.triangles[:, corner]] for corner in range(3))
    volume = (np.cross(a, b) * c).sum() / 6.0
    box = np.prod(np.ptp(network.nodes, axis=0))
    within("volume of the block's surface", abs(volume - box) / box, VOLUME_TOLERANCE)


def test_density_gives_the_mass_of_the_box(within):
    network = net.block(scene(material={"density": 1000.0, "node_mass": None}))
    mass = 1000.0 * np.prod(np.ptp(network.nodes, axis=0))
    within("mass of the block", abs(network.mass.sum() - mass) / mass, VOLUME_TOLERANCE)
    assert network.mass[0] == 1000.0 * 0.0125**3 / 8


@pytest.mark.parametrize("integrator, order", [("rk4", 4), ("semi-implicit-euler", 1)])
def test_free_network_converges_to_dop853(within, integrator, order):
    rng = np.random.default_rng(4)
    network = net.block(scene(mesh={"nodes": [3, 3, 3]}, material={"gravity": [0.0, 0.0, -9.81], "drag": 0.01}))
    start = network.nodes, np.where(network.fixed[:, None], 0.0, 0.2 * rng.normal(size=network.nodes.shape))
    duration, shape = 0.2, network.nodes.shape

    def derivative(_, state):
        x, v = state.reshape(2, *shape)
        return np.concatenate([v, network.inverse_mass[:, None] * net.forces(network, x, v)], axis=None)

    solution = solve_ivp(derivative, (0.0, duration), np.concatenate(start, axis=None), "DOP853", rtol=1e-13, atol=1e-15)
    exact = solution.y[:, -1].reshape(2, *shape)
    errors = []
    steps = [200, 400, 800] if integrator == "rk4" else [4000, 8000, 16000]
    for count in steps:
        state = SimpleNamespace(x=start[0], v=start[1])
        for _ in range(count):
            cycle.integrate(network, state, duration / count, integrator)
        errors.append(np.linalg.norm(np.stack([state.x, state.v]) - exact))
    orders = [np.log2(coarse / fine) for coarse, fine in itertools.pairwise(errors)]
    within(f"order of {integrator} against DOP853", abs(orders[-1] - order), ORDER_TOLERANCE[integrator])


def test_stiff_network_agrees_with_radau(within):
    """A network a hundred times stiffer and heavily damped: RK4 at small steps against an implicit method."""
    network = net.block(scene(mesh={"nodes": [3, 3, 2]}, material={"stiffness": 1e4, "damping": 5.0}))
    rng = np.random.default_rng(5)
    v = np.where(network.fixed[:, None], 0.0, 0.2 * rng.normal(size=network.nodes.shape))
    shape, duration, count = network.nodes.shape, 0.02, 2000

    def derivative(_, state):
        x, v = state.reshape(2, *shape)
        return np.concatenate([v, network.inverse_mass[:, None] * net.forces(network, x, v)], axis=None)

    solution = solve_ivp(derivative, (0.0, duration), np.concatenate((network.nodes, v), axis=None), "Radau", rtol=1e-9, atol=1e-12)
    state = SimpleNamespace(x=network.nodes, v=v)
    for _ in range(count):
        cycle.integrate(network, state, duration / count, "rk4")
    moved = np.abs(state.x - network.nodes).max()
    within("stiff network, RK4 against Radau, of its motion",
           np.abs(state.x - solution.y[:, -1].reshape(2, *shape)[0]).max() / moved, RADAU_TOLERANCE)


@pytest.mark.parametrize("damping", [0.0, 0.5, 5.0])
def test_step_limit_equals_the_formula_for_proportional_damping(within, damping):
    stiffness = 100.0
    network = net.block(scene(mesh={"nodes": [3, 3, 3]}, material={"stiffness": stiffness, "damping": damping}))
    K, D, inverse_mass = stability.free_tangent(network, network.nodes, np.zeros_like(network.nodes))
    omega_max = np.sqrt(np.linalg.eigvals(-inverse_mass[:, None] * K).real.max())
    formula = stability.proportional_limit(omega_max, damping * omega_max / (2.0 * stiffness))
    for integrator_h, stable in ((0.999 * formula, True), (1.001 * formula, False)):
        radius = stability.spectral_radius(stability.one_step_matrix(K, D, inverse_mass, integrator_h))
        # Undamped, the radius is 1 below the limit: eigenvalues on the unit circle.
        assert (radius <= 1.0 + LIMIT_TOLERANCE) == stable
    if damping > 0.0:
        limit = stability.step_limit(K, D, inverse_mass, (0.5 * formula, 2.0 * formula))
        within("step limit against the formula", abs(limit / formula - 1.0), LIMIT_TOLERANCE)


def test_step_matrix_is_the_step(within):
    rng = np.random.default_rng(5)
    network = net.block(scene(mesh={"nodes": [3, 3, 3]}))
    K, D, inverse_mass = stability.free_tangent(network, network.nodes, np.zeros_like(network.nodes))
    small = 1e-7 * rng.normal(size=2 * len(K))
    free, h = ~network.fixed, 1e-3
    for integrator in ("semi-implicit-euler", "rk4"):
        state = SimpleNamespace(x=network.nodes.copy(), v=np.zeros_like(network.nodes))
        state.x[free] += small[: len(K)].reshape(-1, 3)
        state.v[free] += small[len(K) :].reshape(-1, 3)
        cycle.integrate(network, state, h, integrator)
        after = np.concatenate([(state.x - network.nodes)[free], state.v[free]], axis=None)
        linear = stability.one_step_matrix(K, D, inverse_mass, h, integrator) @ small
        within("one-step matrix against a step", np.abs(after - linear).max() / np.abs(linear).max(), LINEAR_TOLERANCE)


# Sums of some hundred products, relative. Measured: 1e-16.
ELASTIC_TOLERANCE = 1e-13
# Of forces that balance to 1e-12 of a weight. Measured: 3e-13.
SAG_TOLERANCE = 1e-11


@pytest.mark.parametrize("stencil", ["shear", "full"])
def test_springs_of_a_material_store_the_energy_of_the_solid(within, stencil):
    E, rng = 5e3, np.random.default_rng(5)
    material = {"stiffness": None, "young_modulus": E}
    network = net.block(scene(mesh={"nodes": [3, 4, 5], "stencil": stencil}, material=material))
    gradient = rng.normal(size=(3, 3))
    d = (network.nodes @ gradient.T)[network.ends]
    along = network.nodes[network.ends[:, 1]] - network.nodes[network.ends[:, 0]]
    stretch = ((d[:, 1] - d[:, 0]) * along).sum(axis=1) / network.rest_length
    strain = (gradient + gradient.T) / 2.0
    volume = np.ptp(network.nodes, axis=0).prod()
    solid = 0.4 * E * volume * (np.trace(strain) ** 2 / 2.0 + (strain**2).sum())
    within("Energy of a lattice against Hooke's law", abs(0.5 * (network.stiffness * stretch**2).sum() / solid - 1.0),
           ELASTIC_TOLERANCE)


def test_a_settled_column_hangs_in_equilibrium(within):
    table = {"stiffness": None, "young_modulus": 5e4, "density": 1000.0, "node_mass": None, "damping": None,
             "damping_ratio": 0.1, "gravity": [0.0, 0.0, -9.81]}
    network = net.block(scene(mesh={"nodes": [2, 2, 6], "fixed": {"nodes": [20, 21, 22, 23]}}, material=table))
    x = equilibrium.settle(network)
    force = net.forces(network, x, np.zeros_like(x))[~network.fixed]
    within("Force left after settling, over a weight", np.abs(force).max() / (network.mass.max() * 9.81), SAG_TOLERANCE)
    held = -net.forces(network, x, np.zeros_like(x))[network.fixed].sum(axis=0)[2]
    weight = 9.81 * network.mass.sum()
    within("Force on the ground against the weight", abs(held / weight - 1.0), SAG_TOLERANCE)
