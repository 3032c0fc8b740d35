"""Contacts spread within a radius: weights, the surface that is felt, and runs on it."""

import numpy as np
import pytest
from scipy.integrate import quad

from setups import scene
from stickslip_reference import cycle, spread, trace
from stickslip_reference import network as net
from stickslip_reference.scene import SceneError
from stickslip_reference.spread import FeltSurface
from stickslip_reference.surface import Point

# Integrals and weights against closed forms, of the whole. Measured: 3.3e-14.
QUADRATURE = 1e-11
# Weights from facets of curved parts against those from facets twice as wide, where the error is of fourth order and 16 times
# as large. Measured: 2.1e-5.
CURVED = 5e-5
# Derivatives against differences over 1e-5 of a triangle, of the largest. Measured: 1.2e-8.
DIFFERENCE = 1e-6
# Stationarity of the nearest point, of its distance. Measured: 2.0e-12.
STATIONARY = 1e-10
RADIUS = 0.01


def felt(kind, radius=RADIUS, nodes=(7, 7, 4)):
    network = net.block(scene(mesh={"nodes": list(nodes)}))
    return network, FeltSurface(kind, network.triangles, network.nodes, radius)


@pytest.fixture(scope="module", params=["faceted", "subdivision"])
def surface(request):
    return felt(request.param)


def top_points(network, reach, count, seed=1):
    """Points of the top face within `reach` of its middle."""
    rng = np.random.default_rng(seed)
    top = np.flatnonzero((network.nodes[network.triangles, 2] == 0.0).all(axis=1))
    points = []
    while len(points) < count:
        point = Point(int(rng.choice(top)), rng.dirichlet([1, 1, 1]))
        if np.abs(point.weights @ network.nodes[network.triangles[point.triangle]]).max() < reach:
            points.append(point)
    return points


def integral(corners, p, a=RADIUS):
    _, value, gradient = spread.integrals(np.array([corners], dtype=float), np.array(p, dtype=float), a, 1)
    return value[0], gradient[0]  # of 1, gamma, beta


def test_pressure_over_a_plane(within):
    """All of the ball's section: 2 pi a^2 / 3. Half: half. Cut off at a distance b, and off the plane by d."""
    a, d, b = RADIUS, 0.004, 0.003
    large = [[-1, -1, 0], [1, -1, 0], [0, 1, 0]]
    half = [[-1, 0, 0], [1, 0, 0], [0, 1, 0]]
    within("whole disc", abs(integral(large, [0, 0, 0])[0][0] / (2 * np.pi * a**2 / 3) - 1.0), QUADRATURE)
    within("half a disc", abs(integral(half, [1e-3, 0, 0])[0][0] / (np.pi * a**2 / 3) - 1.0), QUADRATURE)
    R = np.sqrt(a * a - d * d)
    within("disc off the plane", abs(integral(large, [0, 0, d])[0][0] / (2 * np.pi * R**3 / (3 * a)) - 1.0), QUADRATURE)
    segment, _ = quad(lambda y: np.pi / 2.0 * (1.0 - y * y / a**2) * a, b, a, epsabs=0.0, epsrel=1e-13)
    within("segment", abs(integral(half, [0, -b, 0])[0][0] / segment - 1.0), QUADRATURE)
    within("the rest of it", abs(integral(half, [0, b, 0])[0][0] / (2 * np.pi * a**2 / 3 - segment) - 1.0), QUADRATURE)


def test_pressure_over_small_triangles_adds_up(within):
    """A plane cut into random triangles: their integrals add up to those of the whole, whatever their shape."""
    rng = np.random.default_rng(2)
    from scipy.spatial import Delaunay
    places = np.concatenate([[[-0.03, -0.03], [0.03, -0.03], [0.03, 0.03], [-0.03, 0.03]], rng.uniform(-0.02, 0.02, (60, 2))])
    triangles = Delaunay(places).simplices
    corners = np.concatenate([places, np.zeros((len(places), 1))], axis=1)[triangles]
    clockwise = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] < 0.0
    corners[clockwise] = corners[clockwise][:, [0, 2, 1]]
    for _ in range(10):
        p = np.array([*rng.uniform(-0.01, 0.01, 2), rng.uniform(-0.005, 0.005)])
        R = np.sqrt(RADIUS**2 - p[2] ** 2)
        whole = 2 * np.pi * R**3 / (3 * RADIUS)
        _, value, gradient = spread.integrals(corners, p, RADIUS, 1)
        within("random triangles, pressure", abs(value[:, 0].sum() / whole - 1.0), QUADRATURE)
        by_height = -2 * np.pi * R * p[2] / RADIUS
        error = gradient[:, :, 0].sum(axis=0) - [0.0, 0.0, by_height]
        within("random triangles, derivative", np.abs(error).max() / (2 * np.pi * RADIUS), QUADRATURE)


def test_weights_reproduce_the_plane(within, surface):
    """On a flat part the weights are symmetric about p: sum w = 1, sum w x_rest = p, and its derivatives."""
    network, felt = surface
    for point in top_points(network, 0.0125 if felt.limit else 0.0275, 20):
        found = felt.spread(point.triangle, point.weights)
        rest = network.nodes[found.nodes]
        assert found.weights.min() >= -QUADRATURE
        within("sum of weights", abs(found.weights.sum() - 1.0), QUADRATURE)
        within("rest place of the weights, of the radius", np.abs(found.weights @ rest - found.rest).max() / RADIUS, QUADRATURE)
        within("its derivatives", np.abs(found.by_place @ rest - found.rest_by_place).max() / 0.0125, QUADRATURE)


def test_weights_against_sums_over_many_points(within, surface):
    """The definition itself, by the midpoint rule in polar coordinates about p."""
    network, felt = surface
    point = top_points(network, 0.01, 1, seed=5)[0]
    found = felt.spread(point.triangle, point.weights)
    count = 300 if felt.limit else 800
    r, angle = np.meshgrid((np.arange(count) + 0.5) / count, (np.arange(count // 3) + 0.5) / (count // 3) * 2 * np.pi)
    r = np.sin(0.5 * np.pi * r)  # finer where the pressure has its root
    share = (r * (1.0 - r * r)).ravel()  # r K dr, K = cos, dr = cos
    places = found.rest[:2] + RADIUS * np.stack([r * np.cos(angle), r * np.sin(angle)], axis=-1).reshape(-1, 2)
    total = np.zeros(len(network.nodes))
    for triangle in np.flatnonzero((network.nodes[network.triangles, 2] == 0.0).all(axis=1)):
        corners = network.nodes[network.triangles[triangle]][:, :2]
        weights = np.linalg.solve(np.vstack([corners.T, np.ones(3)]), np.vstack([places.T, np.ones(len(places))])).T
        inside = (weights >= 0.0).all(axis=1)
        if not felt.limit:
            total[network.triangles[triangle]] += share[inside] @ weights[inside]
            continue
        for weight, one in zip(weights[inside], share[inside]):
            basis = felt.base.subdivision.basis(triangle, weight)
            total[basis.nodes] += one * basis.value
    total /= share.sum()
    total[found.nodes] -= found.weights
    within("weights against sums", np.abs(total).max(), 1e-5)


@pytest.mark.parametrize("reach", [0.01, 0.036])
def test_derivatives_of_weights_and_place(within, surface, reach):
    network, felt = surface
    x = network.nodes + 0.002 * np.random.default_rng(3).normal(size=network.nodes.shape)
    step = 1e-5
    for point in top_points(network, reach, 3, seed=7):
        weights = np.maximum(point.weights, 0.01)
        weights /= weights.sum()
        found = felt.spread(point.triangle, weights)
        _, first, _, _ = felt.frame(point.triangle, weights, x)
        for axis in range(2):
            change = step * (np.eye(3)[axis + 1] - np.eye(3)[0])
            one, other = (felt.spread(point.triangle, weights + sign * change) for sign in (1.0, -1.0))
            slope = (one.weights - other.weights) / (2 * step)
            within("derivative of the weights", np.abs(slope - found.by_place[axis]).max() / np.abs(found.by_place).max(),
                   DIFFERENCE)
            one, other = (felt.frame(point.triangle, weights + sign * change, x)[0] for sign in (1.0, -1.0))
            within("derivative of the place", np.abs((one - other) / (2 * step) - first[axis]).max() / 0.0125, DIFFERENCE)


def test_curved_parts_converge(within, monkeypatch):
    """Next to the block's rim, where the limit surface bends: facets twice as wide change the weights little."""
    network, felt_surface = felt("subdivision", nodes=(5, 5, 4))
    points = top_points(network, 0.024, 3, seed=9)
    fine = [felt_surface.spread(point.triangle, point.weights) for point in points]
    monkeypatch.setattr(spread, "DIVISIONS", (4, 8))
    _, coarser = felt("subdivision", nodes=(5, 5, 4))
    for point, found in zip(points, fine):
        other = coarser.spread(point.triangle, point.weights)
        assert (other.nodes == found.nodes).all()
        within("weights on curved parts, two divisions", np.abs(other.weights - found.weights).max(), CURVED)


def test_only_the_connected_part_counts():
    """A thin block: its bottom lies within the radius of the top, but is not connected to it there."""
    network = net.block(scene(mesh={"nodes": [9, 9, 2], "spacing": 0.004}))
    surface = FeltSurface("faceted", network.triangles, network.nodes, 0.006)
    for point in top_points(network, 0.004, 5):
        nodes, _ = surface.support(point)
        assert (network.nodes[nodes, 2] == 0.0).all()
    rim = Point(*next((t, np.full(3, 1 / 3)) for t, corners in enumerate(network.nodes[network.triangles])
                      if (corners[:, 2] == 0.0).all() and corners[:, 0].max() > 0.0159))
    assert (network.nodes[surface.support(rim)[0], 2] < 0.0).any()  # round the edge


def test_a_translated_body_is_felt_translated(within, surface):
    network, felt = surface
    shift = np.array([0.01, -0.02, 0.005])
    for point in top_points(network, 0.03, 5):
        moved = felt.position(point, network.nodes + shift) - felt.position(point, network.nodes)
        within("translation, of the radius", np.abs(moved - shift).max() / RADIUS, QUADRATURE)
        rest = felt.position(point, network.nodes) - felt.below(point.triangle, point.weights)[0]
        within("rest surface", np.abs(rest).max(), 0.0)


def test_nearest_point_and_normal(within, surface):
    """The offset is along the normal, whichever side the tip is on; the sign tells it."""
    network, felt = surface
    rng = np.random.default_rng(4)
    x = network.nodes + 0.0005 * rng.normal(size=network.nodes.shape)
    for height in (0.002, -0.002):
        for point in top_points(network, 0.01, 3):
            q = felt.position(point, x) + height * felt.normal(point, x)
            distance, nearest = felt.signed_distance(q, x)
            within("nearest point, of the height", np.linalg.norm(felt.position(nearest, x) - felt.position(point, x))
                   / abs(height), STATIONARY)
            within("signed distance", abs(distance / height - 1.0), STATIONARY)
            assert felt.outside(q, x) == (height > 0.0)
            followed = felt.follow(q, nearest, x)
            assert np.abs(followed.weights - nearest.weights).max() <= STATIONARY


@pytest.mark.parametrize("kind", ["faceted", "subdivision"])
@pytest.mark.parametrize("scheme", ["geometric", "velocity", "massless"])
def test_a_run_feels_the_spread_contact(within, scheme, kind):
    """Full network, a patch of everything, and a patch of one ring, which takes in every node of the support."""
    waypoints = [[0.0, -0.003, 0.0013, 0.00051], [0.02, -0.003, 0.0013, -0.001], [0.05, -0.001, 0.0013, -0.001]]
    for local in ({"model": "full"}, {"linearization": "none", "rings": "all"}, {}):
        read = scene("sliding", duration=0.05, instrument={"waypoints": waypoints}, mesh={"nodes": [7, 7, 4]}, local=local,
                     contact={"scheme": scheme, "surface": kind, "radius": RADIUS})
        result = cycle.run(read, net.block(read))
        assert result.fault is None and result.inside_without_contact == 0
        columns = trace.table(result)
        assert (columns["mode"][10:] == "slide").mean() > 0.8 and columns["fz"].max() > 0.3
        if local == {"model": "full"}:
            full = columns
        elif local:
            within("patch of everything", np.abs(columns["fz"] - full["fz"]).max(), 1e-9)
        else:
            assert 0.0 < np.abs(columns["fz"] - full["fz"]).max() < full["fz"].max()
            assert not any(row.result.rigid for row in result.rows)


def test_refused():
    for contact in ({"radius": -0.01}, {"radius": float("inf")}, {"radius": "wide"}, {"radius": 0.01, "surface": "shaded"}):
        with pytest.raises(SceneError):
            scene("sliding", contact=contact)
    read = scene("sliding", contact={"radius": 0.01}, mesh={"fixed": "none"})
    with pytest.raises(SceneError):
        cycle.run(read, net.block(read))
