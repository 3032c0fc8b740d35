"""The local model (3)-(4): which nodes it has, and what forces it gives them."""

import numpy as np
import pytest
from scipy.optimize import root

from setups import scene
from stickslip_reference import local_model
from stickslip_reference import network as net

# Forces at x0, v0 against the network's, relative. Measured: 0.
SAME_FORCE = 1e-13
# Observed order of the linearisation error, 2: halving the displacement quarters it. Measured: 0.012 off.
ORDER_TOLERANCE = 0.1


def moving_block(rng, **sections):
    network = net.block(scene(mesh={"nodes": [5, 5, 4]}, **sections))
    x = network.nodes + 0.001 * rng.normal(size=network.nodes.shape)
    v = np.where(network.fixed[:, None], 0.0, 0.1 * rng.normal(size=network.nodes.shape))
    return network, np.where(network.fixed[:, None], network.nodes, x), v


def model_of(network, x, v, **options):
    anchor = x[network.triangles[~network.fixed[network.triangles].any(axis=1)][0]].mean(axis=0)
    return local_model.build(network, scene(local=options)["local"], x, v, 0, anchor, ())


def patch_at(network, anchor, rings, contact_nodes=()):
    return local_model.select_patch(network, local_model.centre_node(network, network.nodes, anchor), rings, contact_nodes)


def test_patch_of_a_top_node_has_fourteen_nodes():
    network = net.block(scene())
    patch = patch_at(network, np.array([0.001, 0.001, 0.0]), 1)
    centre = np.linalg.norm(network.nodes, axis=1).argmin()
    assert len(patch) == 14 and centre in patch
    assert set(patch) - {centre} == {int(n) for pair in network.ends if centre in pair for n in pair} - {centre}


def test_patch_takes_the_lowest_of_equally_near_nodes():
    network = net.block(scene())
    a, b = np.flatnonzero(network.nodes[:, 2] == 0.0)[[40, 41]]
    middle = 0.5 * (network.nodes[a] + network.nodes[b])
    assert set(patch_at(network, middle, 0)) == {min(a, b)}


def test_patch_passes_fixed_nodes_over_but_hops_through_them():
    network = net.block(scene(mesh={"nodes": [5, 1, 2], "stencil": "structural", "fixed": {"nodes": [6, 7, 8]}}))
    # On the line of top nodes 5..9 only the ends are free; the anchor is nearest to fixed 6, then to free 5.
    object.__setattr__(network, "triangles", np.array([[5, 6, 7], [7, 8, 9]]))
    anchor = network.nodes[6] + [-0.001, 0.0, 0.0]
    assert patch_at(network, anchor, 0).tolist() == [5]
    assert patch_at(network, anchor, 1).tolist() == [0, 5]
    assert 1 in patch_at(network, anchor, 2)  # 5 - 6 (fixed) - 1, and 5 - 0 - 1
    assert 9 in patch_at(network, anchor, 4)  # only through 6, 7 and 8


def test_patch_includes_the_contact_triangle_and_all_takes_every_free_node():
    network = net.block(scene())
    far = network.triangles[np.flatnonzero((network.nodes[network.triangles, 2] == 0.0).all(axis=1))[-1]]
    patch = patch_at(network, np.zeros(3), 1, far)
    assert set(far) <= set(patch)
    assert patch_at(network, np.zeros(3), "all").tolist() == np.flatnonzero(~network.fixed).tolist()


@pytest.mark.parametrize("linearization", ["tangent", "none"])
def test_fixed_exterior_stands_still(within, linearization):
    """f0 is taken with the exterior's velocity zero; taking it along would be a wall that moves."""
    rng = np.random.default_rng(1)
    network, x, v = moving_block(rng, material={"gravity": [0.0, 0.0, -9.81], "drag": 0.2})
    model = model_of(network, x, v, linearization=linearization)
    still = np.where(model.moves[:, None], v, 0.0)
    assert np.abs(model.v0 - still).max() == 0.0
    f, expected, wrong = (model.forces(model.x0, model.v0, 0.0), net.forces(network, x, still)[model.patch],
                          net.forces(network, x, v)[model.patch])
    within("force of the local model at its start", np.abs(f - expected).max() / np.abs(expected).max(), SAME_FORCE)
    assert np.abs(f - wrong).max() > 1e-3 * np.abs(wrong).max()


@pytest.mark.parametrize("exterior", ["fixed", "drifting"])
def test_tangent_is_right_to_second_order(within, exterior):
    """Against the springs themselves, the exterior at x0 + t v0: the error is quadratic in the changes and in time."""
    rng = np.random.default_rng(2)
    network, x, v = moving_block(rng)
    linear = model_of(network, x, v, exterior=exterior)
    springs = model_of(network, x, v, exterior=exterior, linearization="none")
    dx, dv = (np.where(linear.moves[:, None], rng.normal(size=x.shape), 0.0) for _ in range(2))
    errors = []
    for size in (1e-4, 5e-5):
        elapsed = size
        at = linear.x0 + size * dx + np.where(linear.moves[:, None], 0.0, elapsed * linear.v0)
        speed = linear.v0 + 10.0 * size * dv
        errors.append(np.linalg.norm(linear.forces(at, speed, elapsed) - springs.forces(at, speed, elapsed)))
    within(f"order of the tangent, {exterior} exterior", abs(np.log2(errors[0] / errors[1]) - 2.0), ORDER_TOLERANCE)


def test_drifting_exterior_keeps_its_velocity():
    rng = np.random.default_rng(3)
    network, x, v = moving_block(rng)
    model = model_of(network, x, v, exterior="drifting")
    assert (model.v0 == v).all() and np.abs(model.drift).max() > 1e-3
    fixed = model_of(network, x, v)
    assert np.abs(fixed.drift).max() == 0.0


@pytest.mark.parametrize("linearization", ["tangent", "none"])
def test_condensed_exterior_follows_in_equilibrium(within, linearization):
    """Against the network with its exterior brought to rest by a root finder, to second order in the displacement."""
    rng = np.random.default_rng(4)
    network = net.block(scene(mesh={"nodes": [4, 4, 3]}))
    still = np.zeros_like(network.nodes)
    model = model_of(network, network.nodes, still, exterior="condensed", linearization=linearization)
    outer = np.flatnonzero(~network.fixed & ~model.moves)
    direction = np.where(model.moves[:, None], rng.normal(size=still.shape), 0.0)
    errors = []
    for size in (2e-4, 1e-4):
        x = network.nodes + size * direction

        def unbalanced(offset):
            moved = x.copy()
            moved[outer] += offset.reshape(-1, 3)
            return net.forces(network, moved, still)[outer].ravel()
        solution = root(unbalanced, np.zeros(3 * len(outer)), tol=1e-13)
        assert np.abs(solution.fun).max() <= 1e-9
        settled = x.copy()
        settled[outer] += solution.x.reshape(-1, 3)
        expected = net.forces(network, settled, still)[model.patch]
        errors.append(np.linalg.norm(model.forces(x, still, 0.0) - expected))
    assert errors[1] > 0.0
    within(f"order of the condensed exterior, {linearization}", abs(np.log2(errors[0] / errors[1]) - 2.0), ORDER_TOLERANCE)


def test_condensation_is_symmetric_and_softens(within):
    network = net.block(scene(mesh={"nodes": [5, 5, 4]}))
    still = np.zeros_like(network.nodes)
    fixed, condensed, near = (model_of(network, network.nodes, still, **options) for options in (
        {}, {"exterior": "condensed"}, {"exterior": "condensed", "condense_rings": 2}))
    C = condensed.K - fixed.K
    within("condensation, symmetry", np.abs(C - C.T).max() / np.abs(C).max(), SAME_FORCE)
    softest = [-np.linalg.eigvalsh(0.5 * (model.K + model.K.T)).max() for model in (fixed, near, condensed)]
    assert softest[0] > softest[1] > softest[2] > 0.0
