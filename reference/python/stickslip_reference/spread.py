"""A contact spread over the surface within a radius: its weights on the rest surface, and the surface that is then felt.

The pressure is sqrt(1 - |y - p|^2 / a^2) over the part of the rest surface that is within the distance a of its point p and
connected to p there. The weights are integrals of the surface's basis functions times the pressure. The surface is divided
into flat facets, on which the basis functions are polynomials and the part within a is a disc cut by three lines. The integral
over a facet is a signed sum of three, one for each side: over the triangle between the disc's centre and the side, cut by the
circle.
"""

import functools
from dataclasses import dataclass

import numpy as np

from .limit_surface import Found, LimitSurface
from .scene import SceneError
from .surface import Point, Surface, cross

# Gauss's rule per arc or chord, and along each radius. Substitutions leave the integrands analytic.
AROUND, AROUND_SHARES = np.polynomial.legendre.leggauss(12)
OUTWARDS, OUTWARDS_SHARES = np.polynomial.legendre.leggauss(8)
DIVISIONS = (8, 16)  # of curved triangles into facets; the error, of second order, is extrapolated away
PATCH_DEGREE = 4  # of the regular patch of the limit surface
FLAT = 1e-12  # of an edge: a triangle of the limit surface that is no further from an affine map is one facet


@dataclass(frozen=True)
class Facets:
    """Flat pieces of a triangle, corners (f, 3, 3); `values` (f, m, k) are coefficients of the basis functions of k nodes in
    the m monomials of a piece's beta and gamma; the integral over the triangle is that over the pieces times `share` (f,)."""

    corners: np.ndarray
    nodes: np.ndarray
    values: np.ndarray
    share: np.ndarray


@dataclass(frozen=True)
class Spread:
    """Nodes under a contact, weights (k,), their derivatives by u and v (2, k); rest point and its derivatives (2, 3)."""

    nodes: np.ndarray
    weights: np.ndarray
    by_place: np.ndarray
    rest: np.ndarray
    rest_by_place: np.ndarray


class FeltSurface(LimitSurface):
    """p = s_rest + sum w_i (x_i - x_rest,i) over points of the rest surface, `faceted` or the limit surface.

    Points are control triangles and barycentrics, as on the surface beneath. The nearest point is found by the
    Gauss-Newton method, which crosses a crease of the rest surface but does not follow it.
    """

    def __init__(self, kind, triangles, rest, radius):
        Surface.__init__(self, triangles)
        self.base = LimitSurface(triangles) if kind == "subdivision" else Surface(triangles)
        self.limit = kind == "subdivision"
        self.degree = PATCH_DEGREE if self.limit else 1
        self.borders()
        self.rest, self.radius = rest, radius
        self.facets, self.known = {}, {}
        steps = np.linspace(0.0, 1.0, 9 if self.limit else 2)[:, None]
        sides = [(1.0 - steps) * np.eye(3)[(c + 1) % 3] + steps * np.eye(3)[(c + 2) % 3] for c in range(3)]
        self.sides = np.array([[[self.base.position(Point(t, w), rest) for w in side] for side in sides]
                               for t in range(len(self.triangles))])

    def below(self, triangle, weights):
        """Rest point and its derivatives by u and v."""
        if self.limit:
            basis = self.base.subdivision.basis(triangle, weights)
            control = self.rest[basis.nodes]
            return basis.value @ control, basis.first @ control
        corners = self.rest[self.triangles[triangle]]
        return weights @ corners, corners[1:] - corners[0]

    def spread(self, triangle, weights):
        key = int(triangle), tuple(weights)
        if key not in self.known:
            if len(self.known) > 20000:
                self.known.clear()
            self.known[key] = self.integrated(*key)
        return self.known[key]

    def integrated(self, triangle, weights):
        p, tangents = self.below(triangle, np.array(weights))
        within = self.connected(triangle, p)
        nodes = np.unique(np.concatenate([self.pieces(t).nodes for t in within]))
        value, gradient = np.zeros(len(nodes)), np.zeros((3, len(nodes)))
        pieces = [self.pieces(t) for t in within]
        owner = np.repeat(np.arange(len(pieces)), [len(each.corners) for each in pieces])
        first = np.searchsorted(owner, np.arange(len(pieces)))
        reached, *found = integrals(np.concatenate([each.corners for each in pieces]), p, self.radius, self.degree)
        for number, each in enumerate(pieces):
            of = owner[reached] == number
            facets = reached[of] - first[number]
            one, by_p = (each.share[facets].reshape(-1, *[1] * (part.ndim - 1)) * part[of] for part in found)
            at, values = np.searchsorted(nodes, each.nodes), each.values[facets].reshape(-1, len(each.nodes))
            value[at] += one.ravel() @ values
            gradient[:, at] += by_p.transpose(1, 0, 2).reshape(3, -1) @ values
        whole = value.sum()
        w = value / whole
        by_place = tangents @ (gradient - np.outer(gradient.sum(axis=1), w)) / whole
        return Spread(nodes, w, by_place, p, tangents)

    def connected(self, triangle, p):
        """Triangles that the ball around p reaches from `triangle`, over edges that it reaches."""
        reached, queue = {triangle}, [triangle]
        while queue:
            t = queue.pop()
            for other, distance in zip(self.neighbours[t].tolist(), distance_to_lines(p, self.sides[t]).tolist()):
                if other >= 0 and other not in reached and distance < self.radius:
                    reached.add(other)
                    queue.append(other)
        return sorted(reached)

    def pieces(self, triangle):
        """A flat triangle as it is; else two divisions with shares that cancel their errors of second order."""
        if triangle not in self.facets:
            if not self.limit or self.is_affine(triangle):
                divisions = [(1.0, [np.eye(3)])]
            else:
                coarse, fine = DIVISIONS
                ratio = (fine / coarse) ** 2
                divisions = [(-1.0 / (ratio - 1.0), divided(coarse)), (ratio / (ratio - 1.0), divided(fine))]
            share = np.concatenate([np.full(len(pieces), share) for share, pieces in divisions])
            nodes = self.base.subdivision.patch(triangle)[0] if self.limit else self.triangles[triangle]
            lattice = barycentric_lattice(self.degree)
            powers = monomials(lattice[:, 1], lattice[:, 2], self.degree)
            samples = self.basis_values(triangle, lattice @ np.concatenate([pieces for _, pieces in divisions]))
            corners = samples[:, lattice.argmax(axis=0)] @ self.rest[nodes]
            self.facets[triangle] = Facets(corners, nodes, np.linalg.solve(powers, samples), share)
        return self.facets[triangle]

    def basis_values(self, triangle, samples):
        """Of the samples (f, m, 3) of facets, (f, m, k); neighbours have samples in common."""
        if not self.limit:
            return samples
        rounded = np.round(samples.reshape(-1, 3), 12)
        _, first, number = np.unique(rounded[:, 1:], axis=0, return_index=True, return_inverse=True)
        each = [self.base.subdivision.basis(triangle, weights).value for weights in samples.reshape(-1, 3)[first]]
        return np.array(each)[number.ravel()].reshape(*samples.shape[:2], -1)

    def is_affine(self, triangle):
        lattice = barycentric_lattice(self.degree)
        places = np.array([self.below(triangle, weights)[0] for weights in lattice])
        corners = np.array([self.below(triangle, weights)[0] for weights in np.eye(3)])
        _, neighbourhood = self.base.subdivision.patch(triangle)
        edge = np.linalg.norm(corners[1] - corners[0])
        return neighbourhood.is_regular() and np.abs(places - lattice @ corners).max() <= FLAT * edge

    # The surface that is felt.

    def support(self, point):
        found = self.spread(point.triangle, point.weights)
        return found.nodes, found.weights

    def frame(self, triangle, weights, x):
        found = self.spread(triangle, weights)
        moved = (x - self.rest)[found.nodes]
        first = found.rest_by_place + found.by_place @ moved
        return found.rest + found.weights @ moved, first, np.zeros((3, 3)), np.linalg.norm(first[0])

    def nearest_found(self, q, x):
        """The nearest of the points found from the two triangles of the mesh whose centres are nearest."""
        centres = x[self.triangles].mean(axis=1)
        first = np.argsort(np.linalg.norm(centres - q, axis=1), kind="stable")[:2]
        found = [self.descend(q, Point(int(t), np.full(3, 1.0 / 3.0)), x) for t in first]
        least = min(found, key=lambda each: each.squared)
        found = [least] + [Found(point, q - self.position(point, x), least.off) for point in self.beside(least.point)]
        return min(found, key=lambda each: each.point.triangle)


def surface(contact, network):
    """The surface that a scene's [contact] names."""
    if contact.radius > 0.0 and not network.fixed.any():
        raise SceneError("contact.radius on a body that nothing holds: the reference does not turn the rest offset with it")
    return surface_of(contact.surface, float(contact.radius), np.asarray(network.triangles, dtype=np.int64).tobytes(),
                      network.nodes.tobytes() if contact.radius > 0.0 else b"")


@functools.lru_cache(maxsize=8)
def surface_of(kind, radius, triangles, rest):
    """Surfaces hold nothing of a run: those on the same mesh share one, and with it what it has found out about the mesh."""
    triangles = np.frombuffer(triangles, dtype=np.int64).reshape(-1, 3)
    if radius > 0.0:
        return FeltSurface(kind, triangles, np.frombuffer(rest).reshape(-1, 3), radius)
    return LimitSurface(triangles) if kind == "subdivision" else Surface(triangles, shaded=kind == "shaded")


def divided(count):
    """Barycentrics of the corners of count^2 triangles."""
    def at(i, j):
        return np.array([count - i - j, i, j]) / count
    up = [np.array([at(i, j), at(i + 1, j), at(i, j + 1)]) for i in range(count) for j in range(count - i)]
    down = [np.array([at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]) for i in range(count) for j in range(count - 1 - i)]
    return up + down


def distance_to_lines(p, points):
    """The distances of p from lines of straight pieces, points (lines, points of a line, 3)."""
    start, along = points[:, :-1], points[:, 1:] - points[:, :-1]
    share = np.clip(((p - start) * along).sum(axis=2) / (along * along).sum(axis=2), 0.0, 1.0)
    return np.linalg.norm(p - start - share[..., None] * along, axis=2).min(axis=1)


def barycentric_lattice(degree):
    return np.array([(degree - i - j, i, j) for i, j in powers(degree)]) / degree


def monomials(beta, gamma, degree):
    """beta^i gamma^j, i + j up to the degree, in the order of `powers`; stacked last."""
    by_beta, by_gamma = [np.ones_like(beta)], [np.ones_like(gamma)]
    for _ in range(degree):
        by_beta.append(by_beta[-1] * beta)
        by_gamma.append(by_gamma[-1] * gamma)
    return np.stack([by_beta[i] * by_gamma[j] for i, j in powers(degree)], axis=-1)


def powers(degree):
    return [(i, j) for i in range(degree + 1) for j in range(degree + 1 - i)]


def integrals(corners, p, a, degree):
    """Integrals over facets, corners (f, 3, 3), of monomials of beta and gamma, k of them: numbers of the facets that the
    ball reaches, then for these the integrals times K = sqrt(1 - |y - p|^2 / a^2), (f, k), and times dK/dp, (f, 3, k)."""
    origin = corners[:, 0]
    e, g = corners[:, 1] - origin, corners[:, 2] - origin
    n = cross(e, g)
    n /= np.linalg.norm(n, axis=1)[:, None]
    height = ((p - origin) * n).sum(axis=1)
    one = e / np.linalg.norm(e, axis=1)[:, None]
    axes = np.stack([one, cross(n, one)], axis=1)
    to_centre = -height[:, None] * n  # from p
    flat = (corners - (p + to_centre)[:, None]) @ axes.transpose(0, 2, 1)
    R = np.sqrt(np.maximum(a * a - height * height, 0.0))
    reached = np.flatnonzero((R > 0.0) & (distance_of_origin(flat) < R))
    flat, R, axes, to_centre = flat[reached], R[reached], axes[reached], to_centre[reached]

    number, y, area, cosine = sectors(flat, R)
    edges = np.stack([flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]], axis=2)
    place = (y - flat[number, :1]) @ np.linalg.inv(edges).transpose(0, 2, 1)[number]
    values = monomials(place[..., 0], place[..., 1], degree)
    by_p = y @ axes[number] + to_centre[number][:, None]  # y - p; dK/dp = (y - p) / (a^2 K)
    # The area is `area` times the cosine, and K is R / a times it.
    value, gradient = np.zeros((len(R), values.shape[-1])), np.zeros((len(R), 3, values.shape[-1]))
    scale = R[number] / a
    np.add.at(value, number, ((area * cosine**2)[:, None] @ values)[:, 0] * scale[:, None])
    np.add.at(gradient, number, (area[:, None] * by_p.transpose(0, 2, 1)) @ values / (a * a * scale)[:, None, None])
    return reached, value, gradient


def distance_of_origin(flat):
    """From triangles (f, 3, 2), counter-clockwise; 0 inside."""
    start, along = flat, np.roll(flat, -1, axis=1) - flat
    outside = start[..., 0] * along[..., 1] - start[..., 1] * along[..., 0] < 0.0
    share = np.clip(-(start * along).sum(axis=2) / (along * along).sum(axis=2), 0.0, 1.0)
    distance = np.linalg.norm(start + share[..., None] * along, axis=2).min(axis=1)
    return np.where(outside.any(axis=1), distance, 0.0)


def sectors(flat, R):
    """Points of the triangles between 0 and each side of `flat` (f, 3, 2), cut by the circles R, a row for every part:
    numbers of the facets, places, areas over cos, and cos.

    cos is sqrt(1 - r^2 / R^2): areas divided by it are finite where it is zero. They are positive where the side goes round
    counter-clockwise.
    """
    start, end = flat.reshape(-1, 2), np.roll(flat, -1, axis=1).reshape(-1, 2)
    number, R = np.repeat(np.arange(len(flat)), 3), np.repeat(R, 3)
    along = end - start
    along = along / np.linalg.norm(along, axis=1)[:, None]
    away = np.stack([along[:, 1], -along[:, 0]], axis=1)  # outwards of a counter-clockwise triangle
    D, first, last = (start * away).sum(axis=1), (start * along).sum(axis=1), (end * along).sum(axis=1)
    chord = np.sqrt(np.maximum(R * R - D * D, 0.0))
    parts = []

    def points(kept, across, forwards, area, cosine):
        place = across[..., None] * away[kept, None, None] + forwards[..., None] * along[kept, None, None]
        count = AROUND.size * OUTWARDS.size
        parts.append((number[kept], place.reshape(len(kept), count, 2), area.reshape(len(kept), count),
                      np.broadcast_to(cosine, area.shape).reshape(len(kept), count)))

    for left, right in ((first, np.minimum(last, -chord)), (np.maximum(first, chord), last)):  # outside the circle: arcs
        kept = np.flatnonzero((right > left) & (D != 0.0))
        sign = np.sign(D[kept])[:, None, None]
        low, high = (np.arctan(place[kept] / np.abs(D[kept]))[:, None, None] for place in (left, right))
        angle = 0.5 * (low + high) + 0.5 * (high - low) * AROUND[:, None]
        chi = 0.25 * np.pi * (1.0 + OUTWARDS)
        r = R[kept, None, None] * np.sin(chi)
        area = sign * 0.5 * (high - low) * AROUND_SHARES[:, None] * 0.25 * np.pi * OUTWARDS_SHARES * R[kept, None, None] * r
        points(kept, sign * np.cos(angle) * r, np.sin(angle) * r, area, np.cos(chi))

    left, right = np.clip(first, -chord, chord), np.clip(last, -chord, chord)
    kept = np.flatnonzero((right > left) & (D != 0.0))
    half, D, R = (each[kept, None, None] for each in (chord, D, R))
    low, high = (np.arcsin(place[kept, None, None] / half) for place in (left, right))
    psi = 0.5 * (low + high) + 0.5 * (high - low) * AROUND[:, None]
    t = half * np.sin(psi)
    reach = np.sqrt(D * D + t * t)  # from the centre to the side
    most = np.arcsin(np.minimum(reach / R, 1.0))
    chi = 0.5 * most * (1.0 + OUTWARDS)
    share = R / reach * np.sin(chi)  # of the way to the side; the area is D dt share dshare
    area = (D * 0.5 * (high - low) * AROUND_SHARES[:, None] * half * np.cos(psi)
            * share * (R / reach) * 0.5 * most * OUTWARDS_SHARES)
    points(kept, D * share, t * share, area, np.cos(chi))
    return tuple(np.concatenate(each) for each in zip(*parts))
