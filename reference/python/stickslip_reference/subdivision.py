"""Basis functions of the Loop limit surface: which nodes carry a point of the surface, with which weights and derivatives.

A point is a control triangle and barycentrics (alpha, beta, gamma) of its corners, in their order; u = beta, v = gamma.
The parametrisation is the dyadic one: the four children of a midpoint split cover the four quarters of their parent. The
surface around a triangle depends on the triangles that touch it. Where these are regular the patch is a polynomial, the
quartic box spline. Elsewhere they are subdivided, and the child that holds the point is looked at in the same way: only
the corners of irregular vertices are left over after a step, and at such a vertex itself its limit masks are used.
"""

from dataclasses import dataclass, field

import numpy as np

# Barycentrics this small count as zero: a vertex is at most this many halvings away.
HALVINGS = 80


@dataclass(frozen=True)
class Basis:
    """Nodes, and per node value (k,), first (2, k) by u, v and second (3, k) derivatives by uu, uv, vv.

    At an irregular vertex the dyadic derivatives vanish or have no bound. There `first` are those of a chart that maps
    the triangles around onto a regular polygon, or half of one at a border, and `second` is zero.
    """

    nodes: np.ndarray
    value: np.ndarray
    first: np.ndarray
    second: np.ndarray


def vertex_weight(n):
    """Loop's weight of each of the n neighbours of an interior vertex."""
    return (5.0 / 8.0 - (3.0 / 8.0 + np.cos(2.0 * np.pi / n) / 4.0) ** 2) / n


# The regular patch. Corners lie at (0, 0), (1, 0), (0, 1) of a lattice with the neighbours +-(1, 0), +-(0, 1), +-(1, -1).
LATTICE = ((0, 0), (1, 0), (0, 1), (1, -1), (1, 1), (-1, 1), (0, -1), (-1, 0), (2, -1), (2, 0), (0, 2), (-1, 2))


def box_spline():
    """Per lattice point the quartic in the barycentrics, {powers: coefficient}, times 12."""
    def term(**powers):
        return tuple(powers.get(name, 0) for name in "ijk")

    corner = {term(i=4): 6, term(i=3, j=1): 24, term(i=3, k=1): 24, term(i=2, j=2): 24, term(i=2, k=2): 24,
              term(i=1, j=3): 8, term(i=1, k=3): 8, term(j=4): 1, term(k=4): 1, term(i=2, j=1, k=1): 60,
              term(i=1, j=2, k=1): 36, term(i=1, j=1, k=2): 36, term(j=1, k=3): 6, term(j=3, k=1): 6, term(j=2, k=2): 12}
    across = {term(i=4): 1, term(i=3, j=1): 6, term(i=2, j=2): 12, term(i=1, j=3): 6, term(j=4): 1,
              term(i=3, k=1): 2, term(i=2, j=1, k=1): 6, term(i=1, j=2, k=1): 6, term(j=3, k=1): 2}
    outer = {term(i=4): 1, term(i=3, j=1): 2}
    # Corners; the points across the edges ij; and the points beyond corner i, beside the one across ij.
    shapes = [(corner, order) for order in ((0, 1, 2), (1, 2, 0), (2, 0, 1))]
    shapes += [(across, order) for order in ((0, 1, 2), (1, 2, 0), (2, 0, 1))]
    shapes += [(outer, order) for order in ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 1, 0), (2, 0, 1))]
    return [{tuple(powers[order.index(corner)] for corner in range(3)): coefficient
             for powers, coefficient in shape.items()} for shape, order in shapes]


def derivative(polynomial, towards):
    """By u (towards corner 1) or v (corner 2), at the expense of corner 0."""
    result = {}
    for powers, coefficient in polynomial.items():
        for corner, sign in ((towards, 1), (0, -1)):
            if powers[corner]:
                lower = tuple(power - (index == corner) for index, power in enumerate(powers))
                result[lower] = result.get(lower, 0) + sign * powers[corner] * coefficient
    return result


def coefficient_table():
    """Exponents, p of three, and coefficients (6, 12, p): the box splines, their derivatives by u, v, uu, uv, vv."""
    splines = box_spline()
    kinds = [splines, *([derivative(p, by) for p in splines] for by in (1, 2)),
             *([derivative(derivative(p, one), two) for p in splines] for one, two in ((1, 1), (1, 2), (2, 2)))]
    exponents = sorted({powers for kind in kinds for p in kind for powers in p})
    table = np.array([[[p.get(powers, 0) / 12.0 for powers in exponents] for p in kind] for kind in kinds])
    return exponents, table


EXPONENTS, COEFFICIENTS = coefficient_table()


def regular_values(weights):
    """(6, 12): value and derivatives by u, v, uu, uv, vv of the box splines of `LATTICE`."""
    a, b, c = ((1.0, w, w * w, w * w * w, w * w * w * w) for w in weights)
    return COEFFICIENTS @ [a[i] * b[j] * c[k] for i, j, k in EXPONENTS]


@dataclass
class Neighbourhood:
    """A triangle of some level, (0, 1, 2), first among all that touch it.

    `origin` plus `rows` gives its vertices by control nodes. The children at a corner have that corner's limit as origin:
    around an irregular vertex the rows shrink with the triangles and keep their digits.
    """

    faces: list
    rows: np.ndarray
    origin: np.ndarray
    children: dict = field(default_factory=dict)
    lattice: np.ndarray | None = None
    regular: bool | None = None

    def __post_init__(self):
        self.opposite = {}
        for face in self.faces:
            for corner in range(3):
                self.opposite[face[corner], face[(corner + 1) % 3]] = face[(corner + 2) % 3]

    def ring(self, vertex):
        """Neighbours of a corner, counter-clockwise, and whether it is inside; else from border to border."""
        after = {face[(face.index(vertex) + 1) % 3]: face[(face.index(vertex) + 2) % 3]
                 for face in self.faces if vertex in face}
        starts = set(after) - set(after.values())
        interior = not starts
        ring = [next(iter(after)) if interior else starts.pop()]
        while ring[-1] in after and len(ring) <= len(after):
            ring.append(after[ring[-1]])
        if interior:
            ring.pop()
        if starts or len(ring) != len(after) + (not interior):
            raise ValueError("the surface has a vertex at which it touches itself")
        return ring, interior

    def is_regular(self):
        """Whether every corner has six triangles, or three at a border."""
        if self.regular is None:
            self.regular = all(self.is_regular_at(corner) for corner in range(3))
        return self.regular

    def is_regular_at(self, corner):
        ring, interior = self.ring(corner)
        return len(ring) == (6 if interior else 4)

    def control(self):
        """(12, k): the box spline's control points, less the origin. Beyond a border edge lies b_i + b_i+1 - a_i."""
        if self.lattice is None:
            place, ghosts, seen, queue = {}, {}, set(), [((0, 0), 0, (1, 0), 1, (0, 1), 2)]
            while queue:
                face = queue.pop()
                places, vertices = face[::2], face[1::2]
                key = frozenset(places)
                if key in seen:
                    continue
                seen.add(key)
                place.update(zip(places, vertices))
                for corner in range(3):
                    a, b, c = ((places[(corner + step) % 3], vertices[(corner + step) % 3]) for step in range(3))
                    if a[1] > 2 and b[1] > 2:
                        continue  # an edge on the rim
                    beyond = tuple(np.add(a[0], b[0]) - c[0])
                    across = self.opposite.get((b[1], a[1]))
                    if across is None:
                        ghosts[beyond] = self.rows[a[1]] + self.rows[b[1]] - self.rows[c[1]]
                    else:
                        queue.append((*b, *a, beyond, across))
            self.lattice = np.array([self.rows[place[at]] if at in place else ghosts[at] for at in LATTICE])
        return self.lattice

    def child(self, which):
        """The neighbourhood of a child: 0, 1, 2 at the corners, 3 in the middle (its corners opposite the parent's)."""
        if which not in self.children:
            self.children[which] = self.subdivided(which)
        return self.children[which]

    def subdivided(self, which):
        points = {}  # of the next level, by the vertex or the edge they come from
        for corner in range(3):
            ring, interior = self.ring(corner)
            if interior:
                weight = vertex_weight(len(ring))
                points[corner] = (1.0 - len(ring) * weight) * self.rows[corner] + weight * self.rows[ring].sum(axis=0)
            else:
                points[corner] = 0.75 * self.rows[corner] + 0.125 * (self.rows[ring[0]] + self.rows[ring[-1]])
            for other in ring:
                points[frozenset((corner, other))] = self.edge_point(corner, other)
        faces = []
        for a, b, c in self.faces:
            ab, bc, ca = frozenset((a, b)), frozenset((b, c)), frozenset((c, a))
            faces += [(a, ab, ca), (ab, b, bc), (ca, bc, c), (bc, ca, ab)]  # the four children of the first face first
        middle = faces[which]
        around = [middle] + [face for face in faces if face != middle and set(face) & set(middle)]
        names = list(middle) + sorted({name for face in around for name in face} - set(middle), key=repr)
        number = {name: index for index, name in enumerate(names)}
        centre = np.zeros_like(self.origin) if which == 3 else self.at_vertex(which)[0]
        return Neighbourhood([tuple(number[name] for name in face) for face in around],
                             np.array([points[name] - centre for name in names]), self.origin + centre)

    def edge_point(self, a, b):
        sides = [self.opposite[pair] for pair in ((a, b), (b, a)) if pair in self.opposite]
        ends = self.rows[a] + self.rows[b]
        return 0.5 * ends if len(sides) == 1 else 0.375 * ends + 0.125 * self.rows[sides].sum(axis=0)

    def at_vertex(self, corner):
        """(6, k) at a corner by its limit masks: value less origin, the polygon chart's derivatives by u and v, zeros."""
        ring, interior = self.ring(corner)
        around = self.rows[ring]
        if interior:
            count = len(ring)
            weight = 1.0 / (count + 3.0 / (8.0 * vertex_weight(count)))
            value = (1.0 - count * weight) * self.rows[corner] + weight * around.sum(axis=0)
            angle = 2.0 * np.pi / count
            along, across = (2.0 / count * function(angle * np.arange(count)) @ around for function in (np.cos, np.sin))
        else:
            faces = len(ring) - 1
            value = 2.0 / 3.0 * self.rows[corner] + (around[0] + around[-1]) / 6.0
            along = 0.5 * (around[0] - around[-1])
            across = border_mask(faces) @ np.vstack([self.rows[corner], around])
            angle = np.pi / faces
            if faces == 1:  # a border that runs straight on: its two edges would point opposite ways
                angle, along, across = 0.5 * np.pi, *(0.5 * (across + sign * along) for sign in (1.0, -1.0))
        def towards(vertex):
            turn = angle * ring.index(vertex)
            return np.cos(turn) * along + np.sin(turn) * across
        following, last = towards((corner + 1) % 3), towards((corner + 2) % 3)
        by_u, by_v = ((following, last), (-last, following - last), (last - following, -following))[corner]
        return np.array([value, by_u, by_v, *np.zeros((3, len(value)))])


def border_mask(faces):
    """Weights of a border vertex and its neighbours from border to border: the surface's slope away from the border.

    An eigenvector of the subdivision around the vertex, scaled so that half a regular polygon has slope one.
    """
    if faces == 1:
        return np.array([-2.0, 1.0, 1.0])
    # Columns of the inner neighbours: 3/8 y_i + (y_i-1 + y_i+1) / 8 = e y_i, nothing coming from the border.
    angle = np.pi / faces
    eigenvalue = 3.0 / 8.0 + np.cos(angle) / 4.0
    inner = np.sin(angle * np.arange(1, faces))
    # Columns of a border neighbour, y / 2 + y_v / 8 + y_1 / 8 = e y, and of the vertex, 3/4 y_v + y + 3/8 sum = e y_v.
    vertex, end = np.linalg.solve([[1.0 / 8.0, 0.5 - eigenvalue], [0.75 - eigenvalue, 1.0]],
                                  [-inner[0] / 8.0, -3.0 / 8.0 * inner.sum()])
    return np.concatenate([[vertex, end], inner, [end]]) / (inner @ inner)


class Subdivision:
    """The limit surface of a triangle mesh: `basis` is all it offers. Neighbourhoods are kept for the next time."""

    def __init__(self, triangles):
        self.triangles = np.asarray(triangles)
        self.around = {}
        for number, nodes in enumerate(self.triangles.tolist()):
            for node in nodes:
                self.around.setdefault(node, []).append(number)
        self.patches = {}

    def patch(self, triangle):
        """Control nodes of a triangle, its own first, and its neighbourhood."""
        if triangle not in self.patches:
            own = self.triangles[triangle].tolist()
            touching = sorted({number for node in own for number in self.around[node]} - {triangle})
            faces = [own, *self.triangles[touching].tolist()]
            nodes = own + sorted({node for face in faces for node in face} - set(own))
            number = {node: index for index, node in enumerate(nodes)}
            local = [tuple(number[node] for node in face) for face in faces]
            self.patches[triangle] = np.array(nodes), Neighbourhood(local, np.eye(len(nodes)), np.zeros(len(nodes)))
        return self.patches[triangle]

    def basis(self, triangle, weights):
        """The Basis at barycentrics `weights` of a triangle."""
        nodes, values = self.derivatives(triangle, weights)
        return Basis(nodes, values[0], values[1:3], values[3:])

    def derivatives(self, triangle, weights):
        """Nodes (k,), and (6, k) of their basis functions: values, and derivatives by u, v, uu, uv, vv."""
        nodes, neighbourhood = self.patch(triangle)
        weights = [float(weight) for weight in weights]
        scale = 1.0
        for _ in range(HALVINGS):
            if neighbourhood.is_regular():
                values = regular_values(weights) @ neighbourhood.control()
                break
            largest = weights.index(max(weights))
            if weights[largest] >= 0.5:
                if weights[largest - 1] == weights[largest - 2] == 0.0 and not neighbourhood.is_regular_at(largest):
                    values, scale = neighbourhood.at_vertex(largest), 1.0
                    break
                neighbourhood = neighbourhood.child(largest)
                weights = [2.0 * weight for weight in weights]
                weights[largest] = 1.0 - (weights[largest - 1] + weights[largest - 2])
                scale *= 2.0
            else:
                neighbourhood = neighbourhood.child(3)
                weights = [1.0 - 2.0 * weight for weight in weights]
                scale *= -2.0
        else:
            values, scale = neighbourhood.at_vertex(largest), 1.0
        values[0] += neighbourhood.origin
        values[1:3] *= scale
        values[3:] *= scale * scale
        return nodes, values
