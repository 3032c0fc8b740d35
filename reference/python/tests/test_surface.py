"""Contact geometry: collision, location, nearest points, inside and outside."""

import numpy as np
import pytest

from setups import scene
from stickslip_reference import network as net
from stickslip_reference import surface as geometry
from stickslip_reference.surface import Point, Surface

# Impact times, of 1. Roots are bisected to the last bit; the cubic's own rounding remains. Measured: 0.
TIME_TOLERANCE = 1e-12
# Places of millimetres, m. Measured: 1.1e-17.
PLACE_TOLERANCE = 1e-15
# A brute-force search samples time this finely; passages closer together than that are left out.
SAMPLES = 4000
# Weights of projections, of 1; the offset's Newton steps end at round-off. Measured: 2.6e-16.
WEIGHT_TOLERANCE = 1e-12
# Nearest distances against a sampled triangle, relative to its edges: sampling finds a point at most this much further.
# Measured: 9e-4.
SAMPLING = 5e-3


def block_surface(shaded=False):
    network = net.block(scene(mesh={"nodes": [4, 4, 3]}))
    return network, Surface(network.triangles, shaded)


def deformed(network, rng, size):
    return network.nodes + size * 0.0125 * rng.uniform(-1.0, 1.0, network.nodes.shape)


def random_motion(network, seed):
    """Tip and block over a tick: from above to somewhere about the top, while every node moves."""
    rng = np.random.default_rng(seed)
    x0, x1 = deformed(network, rng, 0.5), deformed(network, rng, 0.5)
    q0 = np.array([*rng.uniform(-0.02, 0.02, 2), 0.02])
    return q0, np.array([*rng.uniform(-0.02, 0.02, 2), rng.uniform(-0.01, 0.01)]), x0, x1


def solid_angle(q, x, triangles):
    """Winding number of a closed surface around q: 1 inside, 0 outside."""
    a, b, c = (x[triangles[:, corner]] - q for corner in range(3))
    la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    volume = (np.cross(a, b) * c).sum(axis=1)
    below = la * lb * lc + (a * b).sum(axis=1) * lc + (b * c).sum(axis=1) * la + (c * a).sum(axis=1) * lb
    return 2.0 * np.arctan2(volume, below).sum() / (4.0 * np.pi)


def test_collision_with_a_translating_triangle(within):
    """Corners at z from -a to +b, the tip at rest at z = 0: tau = a / (a + b)."""
    surface = Surface([[0, 1, 2]])
    flat = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    tip, below, above = np.array([0.2, 0.3, 0.0]), 0.4, 0.1
    tau, point = surface.collide(tip, tip, flat - [0, 0, below], flat + [0, 0, above])
    within("impact time, translating triangle", abs(tau - below / (below + above)), TIME_TOLERANCE)
    within("impact weights, translating triangle", np.abs(point.weights - [0.5, 0.2, 0.3]).max(), WEIGHT_TOLERANCE)


def test_collision_with_a_turning_triangle(within):
    """One corner swings from z = -1 to 1 while the tip moves along y: z_tip = (2 tau - 1) tau, a quadratic."""
    surface = Surface([[0, 1, 2]])
    down = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, -1.0]])
    up = down * [1.0, 1.0, -1.0]
    height = 0.1
    tau, point = surface.collide(np.array([0.1, 0.0, height]), np.array([0.1, 1.0, height]), down, up)
    expected = (1.0 + np.sqrt(1.0 + 8.0 * height)) / 4.0
    within("impact time, turning triangle", abs(tau - expected), TIME_TOLERANCE)
    error = np.abs(point.weights - [0.9 - expected, 0.1, expected]).max()
    within("impact weights, turning triangle", error, WEIGHT_TOLERANCE)


def test_collision_ignores_passages_from_inside_and_touches():
    surface = Surface([[0, 1, 2]])
    flat, tip = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), np.array([0.2, 0.3, 0.0])
    assert surface.collide(tip - [0, 0, 1], tip + [0, 0, 1], flat, flat) is None
    assert surface.collide(tip + [0, 0, 1], tip + [0, 0, 1e-9], flat, flat) is None
    assert surface.collide(tip + [1, 0, 1], tip + [1, 0, -1], flat, flat) is None
    assert surface.collide(tip + [0, 0, 1], tip - [0, 0, 1], flat, flat) is not None


def test_collision_takes_the_lower_triangle_of_a_shared_edge():
    x = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    surface = Surface([[0, 1, 2], [0, 2, 3]])
    tau, point = surface.collide(np.array([0.5, 0.5, 0.3]), np.array([0.5, 0.5, -0.7]), x, x)
    assert point.triangle == 0 and abs(tau - 0.3) <= TIME_TOLERANCE


@pytest.mark.parametrize("seed", range(20))
def test_collision_against_brute_force(within, seed):
    """Random motions of block and tip, against the sign of the volume at finely sampled times."""
    network, surface = block_surface()
    q0, q1, x0, x1 = random_motion(network, seed)
    times = np.linspace(0.0, 1.0, SAMPLES + 1)
    first = np.inf
    for nodes in network.triangles:
        a, b, c = ((1 - times)[:, None] * x0[node] + times[:, None] * x1[node] for node in nodes)
        q = (1 - times)[:, None] * q0 + times[:, None] * q1
        n = np.cross(b - a, c - a)
        height = ((q - a) * n).sum(axis=1)
        nn = (n * n).sum(axis=1)
        beta, gamma = (np.cross(q - a, c - a) * n).sum(axis=1) / nn, (np.cross(b - a, q - a) * n).sum(axis=1) / nn
        over = np.minimum(np.minimum(beta, gamma), 1 - beta - gamma) >= 0.0
        passes = np.flatnonzero((height[:-1] > 0.0) & (height[1:] <= 0.0) & (over[:-1] | over[1:]))
        if len(passes):
            first = min(first, times[passes[0]])
    hit = surface.collide(q0, q1, x0, x1)
    if hit is None:
        assert first == np.inf
    else:
        within("impact time, brute force, samples", [first - hit[0], hit[0] - first - 1.0 / SAMPLES], TIME_TOLERANCE)
        at = (1 - hit[0]) * x0 + hit[0] * x1
        tip = (1 - hit[0]) * q0 + hit[0] * q1
        within("tip on the surface at impact, m", np.linalg.norm(surface.position(hit[1], at) - tip), PLACE_TOLERANCE)


def test_brute_force_cases_include_hits_and_misses():
    network, surface = block_surface()
    hits = 0
    for seed in range(20):
        hits += surface.collide(*random_motion(network, seed)) is not None
    assert 5 <= hits <= 19


def test_nearest_against_sampling(within):
    rng = np.random.default_rng(7)
    network, surface = block_surface()
    x = deformed(network, rng, 0.3)
    shares = [(i, j) for i in range(201) for j in range(201 - i)]
    weights = np.array([(1 - (i + j) / 200, i / 200, j / 200) for i, j in shares])
    for _ in range(20):
        q = rng.uniform(-0.04, 0.04, 3)
        point = surface.nearest(q, x)
        distance = np.linalg.norm(surface.position(point, x) - q)
        sampled = min(np.linalg.norm(weights @ x[nodes] - q, axis=1).min() for nodes in network.triangles)
        assert point.weights.min() >= 0.0 and abs(point.weights.sum() - 1.0) <= WEIGHT_TOLERANCE
        within("nearest distance below the sampled one, m", distance - sampled, PLACE_TOLERANCE)
        within("nearest distance, relative to an edge", (sampled - distance) / 0.0125, SAMPLING)


def test_nearest_takes_the_lowest_triangle_on_a_tie():
    network, surface = block_surface()
    node = network.triangles.max()
    around = np.flatnonzero((network.triangles == node).any(axis=1))
    point = surface.nearest(network.nodes[node] + [0.001, 0.001, 0.001], network.nodes)
    assert point.triangle == around.min()


@pytest.mark.parametrize("size", [0.0, 0.3])
def test_outside_against_the_winding_number(size):
    rng = np.random.default_rng(8)
    network, surface = block_surface()
    x = deformed(network, rng, size)
    seen = set()
    for _ in range(300):
        # Near corners and edges, where a face's own normal gives the wrong sign.
        q = x[rng.integers(len(x))] + 0.01 * rng.normal(size=3)
        outside = solid_angle(q, x, network.triangles) < 0.5
        assert surface.outside(q, x) == outside
        seen.add(outside)
    assert seen == {True, False}


def test_pseudonormal_weighs_by_angle_not_by_triangles(within):
    """At a corner of a box the three faces count alike, whatever the number of triangles each sends there."""
    network, surface = block_surface()
    corner = int(np.flatnonzero((network.nodes == network.nodes.max(axis=0)).all(axis=1))[0])
    triangle = int(np.flatnonzero((network.triangles == corner).any(axis=1))[0])
    n = surface.pseudonormal(Point(triangle, (network.triangles[triangle] == corner).astype(float)), network.nodes)
    within("pseudonormal of a box corner", np.abs(n / np.linalg.norm(n) - np.sqrt(1 / 3)).max(), WEIGHT_TOLERANCE)


# One tetrahedron, apex up; between its two lower edges on the side of x = 0.04 the edge is convex.
TETRAHEDRON = np.array([[0.0, 0.0, 0.0], [0.04, 0.0, 0.0], [0.0, 0.04, 0.0], [0.03, 0.03, 0.02]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


@pytest.mark.parametrize("order", [(0, 1, 2, 3), (3, 2, 1, 0), (2, 0, 3, 1)])
def test_the_side_of_a_convex_edge_or_vertex_is_the_same_whichever_triangle_is_named(order):
    """Tenths of a nanometre off, where triangles tie and one triangle's own normal gives the wrong side."""
    surface, x = Surface(FACES[list(order)]), TETRAHEDRON
    centre = x.mean(axis=0)
    assert surface.outside(np.array([0.03499999993535752, 0.015000000151492561, 0.009999999740439913]), x)
    rng = np.random.default_rng(12)
    sides = {True: 0, False: 0}
    for _ in range(300):
        edge = rng.choice(4, 2, replace=False)
        share = rng.choice([0.0, rng.uniform()])
        p = (1.0 - share) * x[edge[0]] + share * x[edge[1]]
        q = p + rng.choice([2e-10, 7e-10, 5e-9]) * rng.normal(size=3)
        height = max((q - x[face[0]]) @ np.cross(x[face[1]] - x[face[0]], x[face[2]] - x[face[0]])
                     / np.linalg.norm(np.cross(x[face[1]] - x[face[0]], x[face[2]] - x[face[0]])) for face in FACES)
        if abs(height) < 1e-13:  # round-off of centimetres is 1e-17
            continue
        assert surface.outside(q, x) == (height > 0.0)
        sides[height > 0.0] += 1
    assert min(sides.values()) > 20 and not surface.outside(centre, x)


def test_features_are_told_within_a_nanometre():
    surface, x = Surface(FACES), TETRAHEDRON
    triangle = 2  # 1, 2, 3
    for weights, count in (([0.5, 0.2, 0.3], 3), ([0.5, 0.5, 0.0], 2), ([0.5, 0.5 - 1e-8, 1e-8], 2), ([0.5, 0.5 - 1e-6, 1e-6], 3),
                           ([1.0, 0.0, 0.0], 1), ([1.0 - 1e-8, 0.0, 1e-8], 1), ([1.0 - 1e-6, 0.0, 1e-6], 2)):
        assert len(surface.feature(Point(triangle, np.array(weights)), x)) == count


@pytest.mark.parametrize("shaded", [False, True])
def test_projection_is_along_the_normal(within, shaded):
    rng = np.random.default_rng(9)
    network, surface = block_surface(shaded)
    x = deformed(network, rng, 0.3)
    top = np.flatnonzero((network.nodes[network.triangles, 2] == 0.0).all(axis=1))
    for triangle in top:
        q = rng.dirichlet([2, 2, 2]) @ x[network.triangles[triangle]] + [0.0, 0.0, rng.uniform(-0.004, 0.001)]
        point = Point(triangle, surface.project(q, triangle, x))
        offset = q - surface.position(point, x)
        n = surface.normal(point, x)
        within("projection across the normal, of an edge", np.linalg.norm(np.cross(offset, n)) / 0.0125, WEIGHT_TOLERANCE)


def test_shaded_normals_do_not_jump_at_edges_and_faceted_ones_do(within):
    rng = np.random.default_rng(10)
    network, _ = block_surface()
    x = deformed(network, rng, 0.3)
    jumps = {}
    for shaded in (False, True):
        surface = Surface(network.triangles, shaded)
        triangle, corner = 0, 0
        across = surface.neighbours[triangle, corner]
        share = {surface.triangles[triangle, 1]: 0.3, surface.triangles[triangle, 2]: 0.7}
        sides = [Point(t, np.array([share.get(node, 0.0) for node in surface.triangles[t]])) for t in (triangle, across)]
        one, other = (surface.normal(side, x) for side in sides)
        jumps[shaded] = np.linalg.norm(one - other)
    within("jump of the shaded normal at an edge", jumps[True], WEIGHT_TOLERANCE)
    assert jumps[False] > 1e-3


@pytest.mark.parametrize("shaded", [False, True])
def test_walk_on_a_flat_top_finds_the_triangle_below(shaded):
    rng = np.random.default_rng(11)
    network, surface = block_surface(shaded)
    x = network.nodes
    top = np.flatnonzero((x[network.triangles, 2] == 0.0).all(axis=1))
    # Vertex normals of the rim lean outwards: stay on inner triangles when they count.
    reach = 0.006 if shaded else 0.018
    for _ in range(30):
        q = np.array([*rng.uniform(-reach, reach, 2), -0.001])
        point = surface.walk(q, int(rng.choice(top)), x)
        if not shaded:
            assert np.linalg.norm(surface.position(point, x)[:2] - q[:2]) <= PLACE_TOLERANCE
        assert point.weights.min() >= 0.0 and point.triangle in top


def test_walk_stops_in_a_valley_on_the_shared_edge():
    # Two triangles folded along the y axis with their outer sides facing each other; above the fold each sends q away.
    x = np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.5, 1.0], [-1.0, 0.5, 1.0]])
    surface = Surface([[1, 3, 0], [0, 2, 1]])
    q = np.array([0.0, 0.4, -0.2])
    for start in (0, 1):
        assert surface.project(q, start, x).min() < 0.0
        point = surface.walk(q, start, x)
        assert point.triangle == 0
        assert np.linalg.norm(surface.position(point, x) - [0.0, 0.4, 0.0]) <= PLACE_TOLERANCE


def test_walk_ends_at_an_open_border():
    x = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    surface = Surface([[0, 1, 2]])
    assert surface.walk(np.array([0.2, 0.2, -0.1]), 0, x) is not None
    assert surface.walk(np.array([0.8, 0.8, -0.1]), 0, x) is None


def test_inward_roots_of_known_cubics():
    roots = np.polynomial.polynomial.polyfromroots
    for cubic, expected in (
        (-roots([0.2, 0.5, 0.9]), [0.2, 0.9]),
        (roots([0.2, 0.5, 0.9]), [0.5]),
        (roots([0.3, 0.3, 2.0]), []),  # touches and turns back
        (-roots([0.4, 1.5, 3.0]), [0.4]),
        (np.array([0.3, -1.0, 0.0, 0.0]), [0.3]),
        (np.array([0.0, -1.0, 0.0, 0.0]), [0.0]),
        (np.array([-0.1, -1.0, 0.0, 0.0]), []),
    ):
        found = geometry.inward_roots(1e-9 * cubic)
        assert len(found) == len(expected) and np.allclose(found, expected, rtol=0.0, atol=TIME_TOLERANCE)
