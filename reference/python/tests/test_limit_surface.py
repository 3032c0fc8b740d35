"""Contact geometry on the limit surface: nearest points, location, inside and outside, collision."""

import functools

import numpy as np
import pytest

from setups import scene
from stickslip_reference import network as net
from stickslip_reference.limit_surface import LimitSurface
from stickslip_reference.surface import Point
from test_subdivision import MESHES, lattice, refine, rough
from test_surface import deformed, random_motion, solid_angle

EDGE = 0.0125
# Places of centimetres, m. Measured: 2.1e-17.
PLACE_TOLERANCE = 1e-15
# The offset's part along the surface, of an edge. Measured: 2.2e-15.
STATIONARITY = 1e-12
# Weights of points found from different starts, and impact times. Measured: 2.4e-15.
WEIGHT_TOLERANCE = 1e-12
# Distances against a sampled surface, of an edge: samples are 1/16 apart, diagonals less. Measured: 1.2e-2.
SAMPLING = 0.05


@functools.cache
def block_surface():
    network = net.block(scene(mesh={"nodes": [4, 4, 3]}))
    return network, LimitSurface(network.triangles)


@pytest.mark.parametrize("name", MESHES)
def test_hulls_hold_their_triangles(name):
    """A search leaves out the triangles whose hull is further away than what it has: no point may be outside its hull's box."""
    x, triangles = rough(name)
    surface = LimitSurface(triangles)
    points = np.split(surface.hulls @ x, surface.hull_starts[1:])
    for triangle, hull in enumerate(points):
        for weights in (*np.eye(3), *np.random.default_rng(triangle).dirichlet([0.5, 0.5, 0.5], 5)):
            p = surface.position(Point(triangle, weights), x)
            assert (p >= hull.min(axis=0) - PLACE_TOLERANCE / EDGE).all() and (p <= hull.max(axis=0) + PLACE_TOLERANCE / EDGE).all()
    assert np.ptp(points[0], axis=0).max() < np.ptp(x[surface.subdivision.patch(0)[0]], axis=0).max()


def sampled(surface, x, intervals=16):
    shares = [(i, j) for i in range(intervals + 1) for j in range(intervals + 1 - i)]
    weights = np.array([(intervals - i - j, i, j) for i, j in shares]) / intervals
    return np.array([surface.position(Point(t, w), x) for t in range(len(surface.triangles)) for w in weights])


@pytest.mark.parametrize("size", [0.0, 0.3])
def test_nearest_against_sampling(within, size):
    rng = np.random.default_rng(1)
    network, surface = block_surface()
    x = deformed(network, rng, size)
    points = sampled(surface, x)
    for _ in range(30):
        q = rng.uniform(-0.03, 0.03, 3) - [0.0, 0.0, EDGE]
        found = surface.nearest_found(q, x)
        distance = np.sqrt(found.squared)
        least = np.linalg.norm(points - q, axis=1).min()
        assert found.point.weights.min() >= 0.0 and not found.off
        within("nearest distance above the sampled one, m", distance - least, PLACE_TOLERANCE)
        within("nearest distance, relative to an edge", (least - distance) / EDGE, SAMPLING)
        across = np.cross(found.offset, surface.normal(found.point, x))
        within("offset along the surface, of an edge", np.linalg.norm(across) / EDGE, STATIONARITY)


def test_nearest_does_not_depend_on_the_start(within):
    """From every sample of the triangle and its neighbours the same point is found."""
    rng = np.random.default_rng(2)
    network, surface = block_surface()
    x = deformed(network, rng, 0.15)
    for _ in range(5):
        triangle = int(rng.integers(len(surface.triangles)))
        point = Point(triangle, rng.dirichlet([1.0, 1.0, 1.0]))
        q = surface.position(point, x) + rng.uniform(-0.001, 0.001) * surface.normal(point, x)
        for start in {triangle, *surface.neighbours[triangle].tolist()}:
            for weights in surface.starts:
                found = surface.descend(q, Point(start, weights), x)
                gap = surface.position(found.point, x) - surface.position(point, x)
                within("point found from another start, of an edge", np.linalg.norm(gap) / EDGE, WEIGHT_TOLERANCE)


def test_nearest_takes_the_lowest_triangle_of_an_edge_and_of_a_vertex():
    network, surface = block_surface()
    x = network.nodes
    for node in (int(network.triangles.max()), 37):
        around = np.flatnonzero((network.triangles == node).any(axis=1))
        vertex = Point(int(around[-1]), (network.triangles[around[-1]] == node).astype(float))
        q = surface.position(vertex, x) + 1e-4 * surface.normal(vertex, x)
        assert surface.nearest(q, x).triangle == around.min()
    triangle = 20
    across = int(surface.neighbours[triangle, 0])
    edge = Point(triangle, np.array([0.0, 0.4, 0.6]))
    q = surface.position(edge, x) + 1e-4 * surface.normal(edge, x)
    assert surface.nearest(q, x).triangle == min(triangle, across)


def test_outside_against_the_winding_number():
    rng = np.random.default_rng(3)
    network, surface = block_surface()
    x = deformed(network, rng, 0.3)
    fine, triangles = x, network.triangles
    for _ in range(3):
        fine, triangles = refine(fine, triangles)
    seen = set()
    for _ in range(100):
        q = sampled_near(surface, x, rng)
        distance, _ = surface.signed_distance(q, x)
        if abs(distance) > 0.03 * EDGE:  # further than the finer mesh is from its limit
            outside = solid_angle(q, fine, triangles) < 0.5
            assert surface.outside(q, x) == outside == (distance > 0.0)
            seen.add(outside)
    assert seen == {True, False}


def sampled_near(surface, x, rng):
    point = Point(int(rng.integers(len(surface.triangles))), rng.dirichlet([1.0, 1.0, 1.0]))
    return surface.position(point, x) + 0.3 * EDGE * rng.normal(size=3)


def test_signed_distance_along_the_normal(within):
    rng = np.random.default_rng(4)
    network, surface = block_surface()
    x = deformed(network, rng, 0.1)
    for _ in range(30):
        point = Point(int(rng.integers(len(surface.triangles))), rng.dirichlet([1.0, 1.0, 1.0]))
        height = rng.uniform(-0.0005, 0.0005)
        distance, _ = surface.signed_distance(surface.position(point, x) + height * surface.normal(point, x), x)
        within("signed distance along the normal, m", abs(distance - height), PLACE_TOLERANCE)


def test_contacts_follow_the_tip_from_patch_to_patch(within):
    """Once round the block, over corners and edges: the local search stays with the nearest point."""
    network, surface = block_surface()
    x = network.nodes
    middle = x.mean(axis=0)
    angles = np.linspace(0.0, 2.0 * np.pi, 120)
    tips = middle + np.stack([0.03 * np.cos(angles), 0.03 * np.sin(angles), 0.02 * np.sin(2.0 * angles)], axis=1)
    point = surface.nearest(tips[0], x)
    visited = set()
    for q in tips:
        point = surface.follow(q, point, x)
        gap = surface.position(point, x) - surface.position(surface.nearest(q, x), x)
        within("following against the nearest point, m", np.linalg.norm(gap), PLACE_TOLERANCE * 10)
        visited.add(point.triangle)
    assert len(visited) > 20


def test_open_borders():
    """A sheet: the contact ends where the tip leaves its border, and a tip beside it does not collide."""
    x, triangles = lattice(7, 7)
    surface = LimitSurface(triangles)
    middle = surface.nearest(np.array([4.5, 2.6, 1.0]), x)
    rim = np.array([4.5, 0.2, -0.1])  # the lowest row of nodes is the border y = 0
    inside = surface.follow(rim, middle, x)
    assert np.abs(surface.position(inside, x) - rim * [1.0, 1.0, 0.0]).max() <= 1e-12
    assert surface.follow(rim * [1.0, -1.0, 1.0], inside, x) is None
    beside = surface.nearest_found(rim * [1.0, -1.0, 1.0], x)
    assert beside.off and np.abs(surface.position(beside.point, x) - [4.5, 0.0, 0.0]).max() <= 1e-12
    above, below = np.array([4.5, -0.2, 0.5]), np.array([4.5, -0.2, -0.5])
    assert surface.collide(above, below, x, x) is None
    assert surface.collide(below, np.array([4.5, 1.0, -0.5]), x, x) is None
    assert surface.collide(above + [0.0, 1.0, 0.0], below + [0.0, 1.0, 0.0], x, x) is not None
    # Along the whole border, round corners of one and of two triangles.
    outer = x[triangles].reshape(-1, 3)
    for way in np.linspace(0.0, 2.0 * np.pi, 40):
        q = outer.mean(axis=0) + 20.0 * np.array([np.cos(way), np.sin(way), 0.0])
        found = surface.nearest_found(q, x)
        points = np.array([surface.position(Point(t, w), x) for t in range(len(triangles)) for w in np.eye(3)])
        assert found.off and np.sqrt(found.squared) <= np.linalg.norm(points - q, axis=1).min() + 1e-12


def test_a_tip_off_a_bent_border_is_nearest_to_a_point_on_it(within):
    """Offset across the border, outwards and up: the search goes along the border to the point it was offset from, and stays."""
    x, triangles = lattice(7, 7)
    x = x + 0.1 * np.random.default_rng(8).normal(size=x.shape)
    surface = LimitSurface(triangles)
    for triangle, corner in surface.border_from.values():
        one, other = np.eye(3)[(corner + 1) % 3], np.eye(3)[(corner + 2) % 3]
        for share in (0.2, 0.7):
            point = Point(triangle, (1.0 - share) * one + share * other)
            p, normal = surface.position(point, x), surface.normal(point, x)
            tangent = (other - one)[1:] @ surface.frame(triangle, point.weights, x)[1]
            outwards = np.cross(tangent, normal) / np.linalg.norm(tangent)
            found = surface.descend(p + 0.1 * outwards + 0.05 * normal, Point(triangle, 0.5 * (one + other)), x)
            assert found.off
            within("point on a border, of an edge", np.linalg.norm(surface.position(found.point, x) - p), WEIGHT_TOLERANCE)


def test_collision_with_a_moving_sheet(within):
    """A flat lattice rises with a tilt: the time is that of its plane, the weights those of the triangle below."""
    x, triangles = lattice(9, 9)
    surface = LimitSurface(triangles)
    tip, below, above = np.array([6.1, 3.4, 0.0]), 0.4, 0.1
    x0, x1 = x - [0.0, 0.0, below], x + [0.0, 0.0, above]
    tau, point = surface.collide(tip, tip, x0, x1)
    within("impact time, rising sheet", abs(tau - below / (below + above)), WEIGHT_TOLERANCE)
    at = (1.0 - tau) * x0 + tau * x1
    gap = point.weights @ at[triangles[point.triangle]] - tip
    within("impact place, rising sheet", np.abs(gap).max(), WEIGHT_TOLERANCE)
    assert surface.collide(tip, tip, x1, x0) is None  # out of the surface, not into it
    tilted = x1 + np.outer(x[:, 0] - tip[0], [0.0, 0.0, 0.2])
    tau, point = surface.collide(tip + [0.0, 0.0, 0.3], tip, x0, tilted)
    within("impact time, tilting sheet", abs(tau - 0.7 / 0.8), WEIGHT_TOLERANCE)
    assert surface.collide(tip + [0.0, 0.0, 1.0], tip + [0.0, 0.0, 0.5], x, x) is None


def test_a_tip_on_the_surface_collides_at_once_when_it_goes_in():
    x, triangles = lattice(9, 9)
    surface = LimitSurface(triangles)
    tip, down = np.array([6.1, 3.4, 0.0]), np.array([0.0, 0.0, 0.1])
    tau, _ = surface.collide(tip, tip - down, x, x)
    assert tau == 0.0
    assert surface.collide(tip, tip + down, x, x) is None


@pytest.mark.parametrize("left", [-5e-16, 0.0, 5e-16])
def test_a_tick_that_ends_on_the_surface_to_round_off_has_not_passed_it(left):
    """The next one has, from its start on: no sign of a zero decides which."""
    x, triangles = lattice(9, 9)
    surface = LimitSurface(triangles)
    on, down = np.array([6.1, 3.4, left]), np.array([0.0, 0.0, 0.1])
    assert surface.collide(on + down, on, x, x) is None
    tau, _ = surface.collide(on, on - down, x, x)
    assert 0.0 <= tau <= 1e-14
    tau, _ = surface.collide(on + down, on - down, x, x)  # also where a half of a tick ends there
    assert abs(tau - 0.5) <= 1e-14


@functools.cache
def collision(seed):
    """A random motion of block and tip, and where it collides."""
    network, surface = block_surface()
    q0, q1, x0, x1 = random_motion(network, seed)
    q0, q1 = q0 - [0.0, 0.0, 0.008], q1 - [0.0, 0.0, 0.008]
    return surface, (q0, q1, x0, x1), surface.collide(q0, q1, x0, x1)


@pytest.mark.parametrize("seed", range(8))
def test_collision_against_brute_force(within, seed):
    """Random motions of block and tip, against the sign at finely sampled times."""
    surface, (q0, q1, x0, x1), hit = collision(seed)
    times = np.linspace(0.0, 1.0, 31)
    signs = [surface.signed_distance((1 - t) * q0 + t * q1, (1 - t) * x0 + t * x1)[0] for t in times]
    passes = [t for t, before, after in zip(times[1:], signs, signs[1:]) if before > 0.0 >= after]
    if hit is None:
        assert not passes
        return
    tau, point = hit
    assert passes and passes[0] - 1.0 / 30 <= tau <= passes[0]
    at, tip = (1.0 - tau) * x0 + tau * x1, (1.0 - tau) * q0 + tau * q1
    within("tip on the surface at impact, m", np.linalg.norm(surface.position(point, at) - tip), PLACE_TOLERANCE)


def test_brute_force_cases_include_hits_and_misses():
    assert 2 <= sum(collision(seed)[2] is not None for seed in range(8)) <= 8
