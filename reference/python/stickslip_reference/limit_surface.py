"""Contact geometry on the Loop limit surface: location, normals, nearest points, inside and outside, collision."""

import math
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.optimize import brentq

from .subdivision import Subdivision, regular_values
from .surface import DISTANCE_TOLERANCE, Point, Surface, cross

STATIONARITY = 1e-12  # of a triangle's edge: the offset's part along the surface
POLISHING = 2  # Newton steps after that, which take it to round-off
STEPS = 200
SAMPLES = 4  # intervals per edge of the points that searches start from
ON_SURFACE = 1e-12  # m: a tip that is no further inside is on the surface to round-off
INSIDE = 1e-15  # m: round-off of positions of centimetres; a tip that ends a tick on the surface has not passed it
FINEST = 1.0 / 64.0  # of a tick: a tip that goes in and out again within it may be missed
BESIDE = 1e-6  # weights below this are looked at on the other side of their edge


@dataclass(frozen=True)
class Found:
    """A point at which no step along the surface comes nearer; `off` an open border if only the border holds it."""

    point: Point
    offset: np.ndarray  # q - p
    off: bool

    @property
    def squared(self):
        return self.offset @ self.offset


class LimitSurface(Surface):
    """The limit surface of a triangle mesh; the node positions come with every call.

    A Point's weights are barycentrics of its control triangle; `support` gives the nodes that carry it.
    """

    def __init__(self, triangles):
        super().__init__(triangles)
        self.subdivision = Subdivision(self.triangles)
        self.borders()
        counts = [(SAMPLES - i - j, i, j) for i in range(SAMPLES + 1) for j in range(SAMPLES + 1 - i)]
        self.starts = np.array(counts) / SAMPLES
        patches = [self.subdivision.patch(triangle) for triangle in range(len(self.triangles))]
        bases = [self.subdivision.basis(triangle, start) for start in self.starts for triangle in range(len(patches))]
        self.samples = self.rows([(basis.nodes, basis.value[None]) for basis in bases])
        values = np.array([regular_values(weights)[0] for weights in self.starts])
        bezier = np.linalg.solve([[bernstein(powers, weights) for powers in counts] for weights in self.starts], values)
        hulls = [(nodes, hull(neighbourhood, bezier)) for nodes, neighbourhood in patches]
        self.hulls, self.hull_starts = self.rows(hulls), np.cumsum([0] + [len(points) for _, points in hulls[:-1]])

    def rows(self, points):
        """Points, given as nodes and weights (p, k), as one matrix on the positions of all nodes."""
        counts = np.concatenate([np.full(len(weights), len(nodes)) for nodes, weights in points])
        nodes = np.concatenate([np.tile(nodes, len(weights)) for nodes, weights in points])
        return sparse.csr_matrix((np.concatenate([weights.ravel() for _, weights in points]), nodes,
                                  np.cumsum([0, *counts])), shape=(len(counts), int(self.triangles.max()) + 1))

    def borders(self):
        """The border edge that starts and that ends at a node, as (triangle, corner opposite)."""
        owners = [(t, c) for t in range(len(self.triangles)) for c in range(3) if self.neighbours[t, c] < 0]
        self.border_from = {int(self.triangles[t, (c + 1) % 3]): (t, c) for t, c in owners}
        self.border_to = {int(self.triangles[t, (c + 2) % 3]): (t, c) for t, c in owners}

    def support(self, point):
        basis = self.subdivision.basis(point.triangle, point.weights)
        return basis.nodes, basis.value

    def frame(self, triangle, weights, x):
        """The point, its first (2, 3) and second (3, 3) derivatives, and the length of an edge."""
        nodes, values = self.subdivision.derivatives(triangle, weights)
        control = x.take(nodes, axis=0)
        place = values @ control
        return place[0], place[1:3], place[3:], math.dist(control[0].tolist(), control[1].tolist())

    def position(self, point, x):
        return self.frame(point.triangle, point.weights, x)[0]

    def normal(self, point, x):
        n = cross(*self.frame(point.triangle, point.weights, x)[1])
        return n / np.linalg.norm(n)

    def follow(self, q, point, x):
        """The nearest point as one slides there from `point`; None off an open border."""
        found = self.descend(q, point, x)
        return None if found.off else found.point

    def descend(self, q, point, x):
        """Newton on the stationarity of |q - p|^2 / 2 from a point, from patch to patch, downhill all the way.

        In numbers of Python's own: arrays of two and three elements take ten times as long.
        """
        q = q.tolist()
        triangle, weights = int(point.triangle), point.weights.tolist()
        p, first, second, edge = self.numbers(triangle, weights, x)
        polished = resting = 0
        for _ in range(STEPS):
            offset = difference(q, p)
            by_u, by_v = first
            metric = dot(by_u, by_u), dot(by_u, by_v), dot(by_v, by_v)
            gradient = -dot(by_u, offset), -dot(by_v, offset)
            hessian = [size - dot(bend, offset) for size, bend in zip(metric, second)]
            if not (hessian[0] > 0.0 and determinant(hessian) > 1e-6 * determinant(metric)):
                hessian = metric
            du, dv = solution(hessian, gradient)
            change = [du + dv, -du, -dv]
            du, dv = solution(metric, gradient)
            residual = math.sqrt(gradient[0] * du + gradient[1] * dv)
            rim = [c for c in range(3) if weights[c] == 0.0 and change[c] < 0.0 and self.neighbours[triangle, c] < 0]
            for corner in rim:  # along the border only
                along = [0.0, 0.0, 0.0]
                along[corner - 2], along[corner - 1] = -1.0, 1.0
                _, u, v = along
                slope = gradient[0] * u + gradient[1] * v
                share = -slope / (hessian[0] * u * u + 2.0 * hessian[1] * u * v + hessian[2] * v * v)
                change = [share * way for way in along]
                residual = abs(slope) / math.hypot(*(u * one + v * other for one, other in zip(by_u, by_v)))
                if all(change[c] >= 0.0 for c in range(3) if weights[c] == 0.0):
                    break
            here = Found(Point(triangle, np.array(weights)), np.array(offset), bool(rim))
            if residual <= STATIONARITY * edge:
                polished += 1
                if polished > POLISHING:
                    return here

            reach = [weight / -way if way < 0.0 else math.inf for weight, way in zip(weights, change)]
            corner = reach.index(min(reach))
            whole = min(1.0, reach[corner])
            share, size, falls = whole, dot(offset, offset), gradient[0] * change[1] + gradient[1] * change[2]
            tried = None
            while share > 0.0 and residual > 1e-6 * edge:
                tried = self.numbers(triangle, moved(weights, change, share), x)
                further = difference(q, tried[0])
                if dot(further, further) <= size + 2e-4 * share * falls:
                    break
                share *= 0.5
                if share < 1e-12:
                    return here
            crosses = reach[corner] <= 1.0 and share == whole
            resting = resting + 1 if crosses and whole == 0.0 else 0
            if resting > 16:  # round a vertex and back: nothing to gain
                return here
            weights = moved(weights, change, share, corner if crosses else None)
            if crosses:
                triangle, weights = self.across(triangle, corner, weights)
            if tried is None or crosses:
                tried = self.numbers(triangle, weights, x)
            p, first, second, edge = tried
        return here

    def numbers(self, triangle, weights, x):
        """`frame` as lists of numbers."""
        *arrays, edge = self.frame(triangle, weights, x)
        return *(array.tolist() for array in arrays), edge

    def across(self, triangle, corner, weights):
        """A point on the edge opposite `corner` in the next triangle; at an end of a border edge, in the next one's."""
        other = int(self.neighbours[triangle, corner])
        nodes = self.triangles[triangle].tolist()
        if other < 0:
            node = nodes[weights.index(max(weights))]
            if max(weights) < 1.0:
                return triangle, weights
            one, two = self.border_from[node][0], self.border_to[node][0]
            other = two if one == triangle else one
        share = dict(zip(nodes, weights))
        return other, [share.get(node, 0.0) for node in self.triangles[other].tolist()]

    def nearest_found(self, q, x):
        """The nearest of the points found from every triangle whose hull could hold the nearest."""
        offsets = (self.samples @ x[: self.samples.shape[1]]).reshape(len(self.starts), -1, 3) - q
        squared = (offsets * offsets).sum(axis=2)
        beyond = self.beyond_hulls(q, x)
        starts, nearest = squared.argmin(axis=0), squared.min(axis=0)
        found, bound = [], nearest.min()
        for t in np.argsort(nearest, kind="stable").tolist():
            if beyond[t] <= bound * (1.0 + 1e-12) + DISTANCE_TOLERANCE:
                found.append(self.descend(q, Point(t, self.starts[starts[t]]), x))
                bound = min(bound, found[-1].squared)
        least = min(found, key=lambda each: each.squared)
        found += [Found(point, q - self.position(point, x), least.off) for point in self.beside(least.point)]
        same = [each for each in found if each.squared <= least.squared + DISTANCE_TOLERANCE]
        return min(same, key=lambda each: each.point.triangle)

    def beyond_hulls(self, q, x):
        """Squared distances (t,) of q from boxes round the triangles' hulls."""
        points = self.hulls @ x[: self.hulls.shape[1]]
        low, high = (bound.reduceat(points, self.hull_starts) for bound in (np.minimum, np.maximum))
        beyond = np.maximum(0.0, np.maximum(low - q, q - high))
        return (beyond * beyond).sum(axis=1)

    def beside(self, point):
        """A point close to an edge or a vertex, put onto it, in all other triangles there."""
        on = point.weights > BESIDE
        if on.all():
            return []
        share = dict(zip(self.triangles[point.triangle][on].tolist(), point.weights[on] / point.weights[on].sum()))
        touching = np.flatnonzero(np.isin(self.triangles, list(share)).sum(axis=1) == len(share))
        return [Point(int(t), np.array([share.get(node, 0.0) for node in self.triangles[t].tolist()]))
                for t in touching if t != point.triangle]

    def nearest(self, q, x):
        return self.nearest_found(q, x).point

    def signed_distance(self, q, x):
        """Distance to the surface, negative inside, by the true normal at the nearest point; and that point."""
        found = self.nearest_found(q, x)
        height = found.offset @ self.normal(found.point, x)
        return (np.copysign(np.sqrt(found.squared), height) if found.off else height), found.point

    def collide(self, q0, q1, x0, x1):
        """The earliest time at which the tip passes inwards while tip and nodes move linearly.

        Returns (tau, Point), or None. The distance changes no faster than the tip and the fastest node together.
        """
        def distance(tau):
            return self.signed_distance((1.0 - tau) * q0 + tau * q1, (1.0 - tau) * x0 + tau * x1)

        speed = np.linalg.norm(q1 - q0) + np.linalg.norm(x1 - x0, axis=1).max()
        start, point = distance(0.0)
        if start > speed:
            return None
        if -ON_SURFACE <= start <= 0.0:
            nodes, weights = self.support(point)
            if ((q1 - q0) - weights @ (x1 - x0)[nodes]) @ self.normal(point, x0) < 0.0:
                return 0.0, point
        intervals = [(0.0, start, 1.0, distance(1.0)[0])]
        while intervals:
            left, before, right, after = intervals.pop()
            if (before < -INSIDE) == (after < -INSIDE) and abs(before) + abs(after) > speed * (right - left):
                continue
            if right - left > FINEST:
                middle = 0.5 * (left + right)
                between = distance(middle)[0]
                intervals += [(middle, between, right, after), (left, before, middle, between)]
            elif before >= -INSIDE > after:
                tau = left if before <= 0.0 else brentq(lambda at: distance(at)[0], left, right, xtol=1e-15, rtol=1e-15)
                value, point = distance(tau)
                if abs(value) <= ON_SURFACE:  # else the nearest point went round an open border
                    return tau, point
        return None


def hull(neighbourhood, bezier, divisions=1):
    """Points (p, k) by control nodes whose convex hull holds a triangle: of the Bezier form of a quartic patch, for which
    `bezier` has those of the box splines; else of the triangle's quarters, and in the end all vertices of a neighbourhood."""
    if neighbourhood.is_regular():
        return neighbourhood.origin + bezier @ neighbourhood.control()
    if divisions == 0:
        return neighbourhood.origin + neighbourhood.rows
    return np.concatenate([hull(neighbourhood.child(which), bezier, divisions - 1) for which in range(4)])


def bernstein(powers, weights):
    """Bernstein's polynomial of the powers (i, j, k) of the barycentrics."""
    count = math.factorial(sum(powers)) // math.prod(map(math.factorial, powers))
    return count * math.prod(weight**power for weight, power in zip(weights, powers))


def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def difference(a, b):
    return [a[0] - b[0], a[1] - b[1], a[2] - b[2]]


def determinant(matrix):
    """Of a symmetric one, two by two, given as its elements 00, 01, 11."""
    return matrix[0] * matrix[2] - matrix[1] * matrix[1]


def solution(matrix, right):
    """x of matrix x = right, two by two and symmetric."""
    size = determinant(matrix)
    return ((matrix[2] * right[0] - matrix[1] * right[1]) / size, (matrix[0] * right[1] - matrix[1] * right[0]) / size)


def moved(weights, change, share, emptied=None):
    """Weights after a step, none of them negative, adding up to one."""
    result = [max(weight + share * way, 0.0) for weight, way in zip(weights, change)]
    if emptied is not None:
        result[emptied] = 0.0
    largest = result.index(max(result))
    result[largest] = 0.0
    result[largest] = 1.0 - sum(result)
    return result
