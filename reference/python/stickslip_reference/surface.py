"""Contact geometry on the triangle surface: location, normals, nearest points, inside/outside, collision."""

import math
import sys
from dataclasses import dataclass

import numpy as np

WEIGHT_TOLERANCE = 1e-9  # closed barycentric domain of a collision
TIME_TOLERANCE = 1e-12  # collisions this close count as simultaneous
DISTANCE_TOLERANCE = 1e-18  # m^2, squared distances this close count as equal
NEXT, LAST = (np.array(axes) for axes in ((1, 2, 0), (2, 0, 1)))  # of an axis, in turn
ON_FEATURE = 1e-9  # m: a point this close to a vertex or an edge counts as on it


@dataclass(frozen=True)
class Point:
    """A point on the surface: triangle number and barycentric weights."""

    triangle: int
    weights: np.ndarray


class Surface:
    """Topology of a triangle surface; the node positions come with every call."""

    def __init__(self, triangles, shaded=False):
        self.triangles = np.asarray(triangles)
        self.shaded = shaded
        self.neighbours = neighbours(self.triangles)

    def support(self, point):
        """The nodes that carry a point, and their weights."""
        return self.triangles[point.triangle], point.weights

    def position(self, point, x):
        """p = sum w_i x_i."""
        nodes, weights = self.support(point)
        return weights @ x[nodes]

    def face_crosses(self, x):
        a, b, c = (x[self.triangles[:, corner]] for corner in range(3))
        return cross(b - a, c - a)

    def vertex_normals(self, x, triangle):
        """Normalised sums of the cross products of the triangles around each corner of `triangle`, (3, 3)."""
        crosses = self.face_crosses(x)
        sums = np.array([crosses[(self.triangles == node).any(axis=1)].sum(axis=0) for node in self.triangles[triangle]])
        return sums / np.linalg.norm(sums, axis=1)[:, None]

    def normal(self, point, x):
        """Outward unit contact normal at a point."""
        if self.shaded:
            n = point.weights @ self.vertex_normals(x, point.triangle)
        else:
            a, b, c = x[self.triangles[point.triangle]]
            n = cross(b - a, c - a)
        return n / np.linalg.norm(n)

    def project(self, q, triangle, x):
        """Weights of q's projection on the plane of `triangle`, or along its normal field; they may leave the triangle."""
        corners = x[self.triangles[triangle]]
        if self.shaded:
            return project_along_field(q, corners, self.vertex_normals(x, triangle))
        return plane_weights(q, corners)

    def follow(self, q, point, x):
        """Where a contact goes from `point` with the tip at q. None off an open border."""
        return self.walk(q, point.triangle, x)

    def walk(self, q, start, x):
        """Project q on the surface from triangle `start`, crossing edges as needed. None off an open border."""
        triangle, visited = start, {start}
        while True:
            weights = self.project(q, triangle, x)
            if weights.min() >= 0.0:
                return Point(triangle, weights)
            corner = int(weights.argmin())
            across = self.neighbours[triangle, corner]
            if across < 0:
                return None
            if across in visited:
                return self.nearest_on_edge(q, triangle, corner, across, x)
            visited.add(across)
            triangle = across

    def nearest_on_edge(self, q, triangle, corner, across, x):
        """A valley: the nearest point of the edge shared by two triangles, given on the lower one."""
        nodes = self.triangles[triangle]
        first, second = nodes[(corner + 1) % 3], nodes[(corner + 2) % 3]
        along = x[second] - x[first]
        share = np.clip((q - x[first]) @ along / (along @ along), 0.0, 1.0)
        lower = min(triangle, across)
        weights = np.where(self.triangles[lower] == first, 1.0 - share, 0.0)
        return Point(int(lower), np.where(self.triangles[lower] == second, share, weights))

    def nearest_two(self, q, x):
        """The point nearest to q, and that of the lowest triangle whose squared distance is within the tolerance of it."""
        corners = x[self.triangles]
        weights = nearest_weights(q, corners)
        offset = q - np.einsum("tc,tca->ta", weights, corners)
        squared = (offset * offset).sum(axis=1)
        least = int(squared.argmin())
        lowest = int(np.flatnonzero(squared <= squared[least] + DISTANCE_TOLERANCE)[0])
        return Point(least, weights[least]), Point(lowest, weights[lowest])

    def nearest(self, q, x):
        """Surface point nearest to q: the lowest triangle whose squared distance is within the tolerance of the least."""
        return self.nearest_two(q, x)[1]

    def feature(self, point, x):
        """Nodes of the vertex, edge or face that a point lies on."""
        nodes = self.triangles[point.triangle]
        corners, p = x[nodes], self.position(point, x)
        distances = np.linalg.norm(corners - p, axis=1)
        if distances.min() <= ON_FEATURE:
            return nodes[[distances.argmin()]]
        edges = corners[LAST] - corners[NEXT]  # opposite each corner
        double_area = np.linalg.norm(cross(edges[0], edges[1]))
        heights = point.weights * double_area / np.linalg.norm(edges, axis=1)
        corner = int(heights.argmin())
        return np.delete(nodes, corner) if heights[corner] <= ON_FEATURE else nodes

    def pseudonormal(self, point, x):
        """Angle-weighted pseudonormal of the face, edge or vertex the point lies on (not normalised)."""
        crosses = self.face_crosses(x)
        normals = crosses / np.linalg.norm(crosses, axis=1)[:, None]
        on = self.feature(point, x)
        around = (self.triangles[:, :, None] == on).any(axis=2).sum(axis=1) == len(on)
        if len(on) > 1:
            return normals[around].sum(axis=0)
        total = np.zeros(3)
        for triangle in np.flatnonzero(around):
            nodes = self.triangles[triangle]
            corner = int(np.flatnonzero(nodes == on[0])[0])
            one, two = (x[nodes[(corner + step) % 3]] - x[on[0]] for step in (1, 2))
            total += np.arctan2(np.linalg.norm(cross(one, two)), one @ two) * normals[triangle]
        return total

    def signed_distance(self, q, x):
        """Distance to the closed surface, negative inside, and `nearest`. The sign is that of the nearest point's feature."""
        least, lowest = self.nearest_two(q, x)
        offset = q - self.position(least, x)
        return np.copysign(np.linalg.norm(offset), offset @ self.pseudonormal(least, x)), lowest

    def outside(self, q, x):
        """Whether q lies outside the closed surface."""
        return self.signed_distance(q, x)[0] > 0.0

    def collide(self, q0, q1, x0, x1):
        """First passage of the tip from the outer to the inner side while tip and nodes move linearly.

        Returns (tau, Point), or None. The tip lies in a moving triangle's plane at the roots of a cubic in tau.
        """
        found = []
        for triangle in self.candidates(q0, q1, x0, x1):
            nodes = self.triangles[triangle]
            for tau in inward_roots(plane_cubic(q0, q1, x0[nodes], x1[nodes])):
                corners = (1.0 - tau) * x0[nodes] + tau * x1[nodes]
                weights = plane_weights((1.0 - tau) * q0 + tau * q1, corners)
                if weights.min() >= -WEIGHT_TOLERANCE:
                    found.append((tau, Point(int(triangle), weights)))
                    break
        if not found:
            return None
        earliest = min(tau for tau, _ in found)
        # `found` is in triangle order, so the first simultaneous one is the lowest triangle.
        return next(hit for hit in found if hit[0] <= earliest + TIME_TOLERANCE)

    def candidates(self, q0, q1, x0, x1):
        """Triangles whose swept bounding box meets that of the tip."""
        corners = np.concatenate([x0[self.triangles], x1[self.triangles]], axis=1)
        low, high = corners.min(axis=1), corners.max(axis=1)
        margin = 1e-6 * (high - low).max()
        near = (low - margin <= np.maximum(q0, q1)) & (high + margin >= np.minimum(q0, q1))
        return np.flatnonzero(near.all(axis=1))


def cross(a, b):
    """The cross product of vectors, or of rows of vectors: numpy's own takes four times as long for a single one."""
    return a.take(NEXT, -1) * b.take(LAST, -1) - a.take(LAST, -1) * b.take(NEXT, -1)


def neighbours(triangles):
    """(t, 3): the triangle across the edge opposite each corner, -1 on an open border."""
    owner = {}
    for number, nodes in enumerate(triangles):
        for corner in range(3):
            owner[nodes[(corner + 1) % 3], nodes[(corner + 2) % 3]] = number
    return np.array([[owner.get((nodes[(corner + 2) % 3], nodes[(corner + 1) % 3]), -1) for corner in range(3)]
                     for nodes in triangles])


def plane_weights(q, corners):
    """Barycentric weights of the orthogonal projection of q on the plane of a triangle."""
    a, b, c = corners
    n = cross(b - a, c - a)
    beta = cross(q - a, c - a) @ n / (n @ n)
    gamma = cross(b - a, q - a) @ n / (n @ n)
    return np.array([1.0 - beta - gamma, beta, gamma])


def project_along_field(q, corners, normals):
    """Weights w with q - p(w) parallel to the interpolated normal n(w).

    p(w) + s n(w) = q puts q in the plane of the triangle offset by s along its vertex normals: a cubic in s. Its root of
    least magnitude is the offset; Newton on all three unknowns then takes the round-off of the cubic out.
    """
    scale = np.linalg.norm(corners[1] - corners[0])
    cubic = plane_cubic(q, q, corners, corners + scale * normals)
    roots = np.roots(cubic[::-1])
    real = roots[np.abs(roots.imag) <= 1e-6 * (1.0 + np.abs(roots))].real
    share = real[np.abs(real).argmin()]
    offset = scale * share
    weights = plane_weights(q, corners + offset * normals)
    for _ in range(3):
        direction = weights @ normals
        residual = q - weights @ corners - offset * direction
        moved = corners + offset * normals
        step = np.linalg.solve(np.column_stack([moved[1] - moved[0], moved[2] - moved[0], direction]), residual)
        weights = weights + np.array([-step[0] - step[1], step[0], step[1]])
        offset += step[2]
    return weights


def plane_cubic(q0, q1, corners0, corners1):
    """Coefficients c0..c3 in tau of (q - a).((b - a) x (c - a)), positive on the outer side."""
    d0, e0, g0 = q0 - corners0[0], corners0[1] - corners0[0], corners0[2] - corners0[0]
    d, e, g = q1 - corners1[0] - d0, corners1[1] - corners1[0] - e0, corners1[2] - corners1[0] - g0
    n0, n1, n2 = cross(e0, g0), cross(e0, g) + cross(e, g0), cross(e, g)
    return np.array([d0 @ n0, d0 @ n1 + d @ n0, d0 @ n2 + d @ n1, d @ n2])


def inward_roots(cubic):
    """Roots in [0, 1] at which the cubic falls from positive (or from zero at tau = 0) to negative, in order.

    Between its stationary points a cubic is monotone: bisection on each falling piece cannot miss or invent a passage.
    """
    def value(tau):
        return ((cubic[3] * tau + cubic[2]) * tau + cubic[1]) * tau + cubic[0]

    cubic = cubic.tolist()
    round_off = 4.0 * sys.float_info.epsilon * sum(map(abs, cubic))
    inner = [tau for tau in stationary_points(cubic) if 0.0 < tau < 1.0]
    knots = [0.0, *sorted(inner), 1.0]
    roots = []
    for left, right in zip(knots, knots[1:]):
        if not value(right) < -round_off:
            continue
        if value(left) > round_off:
            roots.append(bisect(value, left, right))
        elif left == 0.0 and value(left) >= -round_off:  # on the surface, going in; later such points only touch it
            roots.append(0.0)
    return roots


def stationary_points(cubic):
    a, b, c = 3.0 * cubic[3], 2.0 * cubic[2], cubic[1]
    discriminant = b * b - 4.0 * a * c
    if discriminant <= 0.0:
        return []
    # The larger root first, then the smaller from their product: no cancellation, and a = 0 needs no case.
    half = -0.5 * (b + math.copysign(math.sqrt(discriminant), b))
    return [top / bottom for top, bottom in ((half, a), (c, half)) if bottom != 0.0]


def bisect(value, left, right):
    """Root of a function that falls from left to right, to the last bit."""
    while True:
        middle = 0.5 * (left + right)
        if middle in (left, right):
            return middle
        if value(middle) > 0.0:
            left = middle
        else:
            right = middle


def nearest_weights(q, corners):
    """Weights of the point of each triangle (t, 3, 3) nearest to q: the inner projection, or the nearest edge point."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    n = cross(b - a, c - a)
    nn = (n * n).sum(axis=1)
    beta = (cross(q - a, c - a) * n).sum(axis=1) / nn
    gamma = (cross(b - a, q - a) * n).sum(axis=1) / nn
    weights = np.stack([1.0 - beta - gamma, beta, gamma], axis=1)
    outer = np.flatnonzero((weights < 0.0).any(axis=1))
    best = np.full(len(outer), np.inf)
    for first, second in ((0, 1), (1, 2), (2, 0)):
        start, along = corners[outer, first], corners[outer, second] - corners[outer, first]
        share = np.clip(((q - start) * along).sum(axis=1) / (along * along).sum(axis=1), 0.0, 1.0)
        offset = q - start - share[:, None] * along
        squared = (offset * offset).sum(axis=1)
        better = squared < best
        best = np.where(better, squared, best)
        edge = np.zeros((len(outer), 3))
        edge[:, first], edge[:, second] = 1.0 - share, share
        weights[outer[better]] = edge[better]
    return weights
