"""The full model (1)-(2): block generator, node forces, their Jacobians (4) and energies."""

import itertools
import json
from dataclasses import dataclass, field

import numpy as np
from scipy import sparse

from .scene import SceneError


@dataclass(frozen=True)
class Network:
    """Nodes, springs and surface. n nodes, s springs, t triangles; SI units."""

    nodes: np.ndarray  # (n, 3) rest positions, m
    mass: np.ndarray  # (n,) kg
    fixed: np.ndarray  # (n,) bool
    ends: np.ndarray  # (s, 2) node numbers i, j
    stiffness: np.ndarray  # (s,) N/m
    damping: np.ndarray  # (s,) N s/m
    rest_length: np.ndarray  # (s,) m
    triangles: np.ndarray  # (t, 3) counter-clockwise seen from outside
    gravity: np.ndarray = field(default_factory=lambda: np.zeros(3))  # m/s^2
    drag: float = 0.0  # N s/m, on every node

    def __post_init__(self):
        n, s = len(self.nodes), len(self.ends)
        row = np.arange(s)
        signs = np.concatenate([np.ones(s), -np.ones(s)])
        incidence = sparse.csr_matrix((signs, (self.ends.T.ravel(), np.tile(row, 2))), shape=(n, s))
        # f_i = +F, f_j = -F for the spring force F of (1): the incidence matrix sums them onto the nodes.
        object.__setattr__(self, "incidence", incidence)
        object.__setattr__(self, "first", self.ends[:, 0].copy())
        object.__setattr__(self, "last", self.ends[:, 1].copy())
        object.__setattr__(self, "weight", self.mass[:, None] * self.gravity)
        object.__setattr__(self, "inverse_mass", np.where(self.fixed, 0.0, 1.0 / self.mass))

    @property
    def diagonal(self):
        """Diagonal of the bounding box of the rest mesh, m."""
        return np.linalg.norm(np.ptp(self.nodes, axis=0))


def select_springs(network, nodes):
    """The network with only the springs that touch one of `nodes`."""
    touched = np.zeros(len(network.nodes), bool)
    touched[nodes] = True
    keep = touched[network.ends].any(axis=1)
    return Network(network.nodes, network.mass, network.fixed, network.ends[keep], network.stiffness[keep],
                   network.damping[keep], network.rest_length[keep], network.triangles, network.gravity, network.drag)


def forces(network, x, v):
    """f(x, v) of (1), (n, 3). Written without norms, so that it also takes complex steps."""
    d, omega = differences(network, x), differences(network, v)
    length = np.sqrt(np.einsum("sa,sa->s", d, d))
    rate = np.einsum("sa,sa->s", omega, d) / length
    tension = network.stiffness * (length - network.rest_length) + network.damping * rate
    return network.incidence @ ((tension / length)[:, None] * d) + network.weight - network.drag * v


def differences(network, values):
    """Per spring the value at its end j less that at i; `take` is the fastest of numpy's ways to look rows up."""
    return values.take(network.last, axis=0) - values.take(network.first, axis=0)


def spring_jacobians(network, x, v, stabilised=False):
    """Per spring df_i/dd and df_i/d(omega), (s, 3, 3) each, for the blocks of (4).

    `stabilised` clamps the geometric factor 1 - L/l at zero, which keeps the elastic part negative semidefinite.
    """
    d, omega = differences(network, x), differences(network, v)
    length = np.sqrt((d * d).sum(axis=1))
    u = d / length[:, None]
    uu = u[:, :, None] * u[:, None, :]
    across = np.eye(3) - uu
    factor = 1.0 - network.rest_length / length
    if stabilised:
        factor = np.maximum(factor, 0.0)
    across_omega = np.einsum("sab,sb->sa", across, omega)
    rate = (omega * u).sum(axis=1)
    turning = u[:, :, None] * across_omega[:, None, :] + rate[:, None, None] * across
    by_d = (network.stiffness[:, None, None] * (uu + factor[:, None, None] * across)
            + (network.damping / length)[:, None, None] * turning)
    return by_d, network.damping[:, None, None] * uu


def assemble(network, blocks):
    """(3n, 3n) sparse matrix of spring blocks: +B at (i, j) and (j, i), -B at (i, i) and (j, j)."""
    i, j = network.ends.T
    rows = np.concatenate([i, j, i, j])
    columns = np.concatenate([j, i, i, j])
    values = np.concatenate([blocks, blocks, -blocks, -blocks])
    axis = np.arange(3)
    row = np.broadcast_to(3 * rows[:, None, None] + axis[:, None], values.shape)
    column = np.broadcast_to(3 * columns[:, None, None] + axis[None, :], values.shape)
    size = 3 * len(network.nodes)
    return sparse.coo_matrix((values.ravel(), (row.ravel(), column.ravel())), shape=(size, size)).tocsr()


def jacobians(network, x, v, stabilised=False):
    """K = df/dx and D = df/dv of (4), sparse (3n, 3n)."""
    by_d, by_omega = spring_jacobians(network, x, v, stabilised)
    D = assemble(network, by_omega)
    if network.drag:
        D = D - network.drag * sparse.identity(D.shape[0], format="csr")
    return assemble(network, by_d), D


def complex_step_jacobians(network, x, v, step=1e-30):
    """K and D by complex steps: no cancellation, so exact to round-off and independent of the formulas above."""
    def derivative(function, at):
        columns = np.empty((at.size, at.size))
        for column in range(at.size):
            moved = at.astype(complex).ravel()
            moved[column] += 1j * step
            columns[:, column] = function(moved.reshape(at.shape)).imag.ravel() / step
        return columns
    return derivative(lambda y: forces(network, y, v), x), derivative(lambda y: forces(network, x, y), v)


def energies(network, x, v, nodes=slice(None)):
    """Kinetic, elastic and gravitational energy, J: of `nodes`, and of the springs that `network` has."""
    d, moving = differences(network, x), v[nodes]
    stretch = np.sqrt(np.einsum("sa,sa->s", d, d)) - network.rest_length
    mass = network.mass[nodes]
    kinetic = 0.5 * (mass @ np.einsum("na,na->n", moving, moving))
    elastic = 0.5 * (network.stiffness @ stretch**2)
    gravitational = (mass * (x[nodes] @ -network.gravity)).sum()
    return kinetic, elastic, gravitational


def block(scene):
    """The network of a scene's block: node (ix, iy, iz) is (iz ny + iy) nx + ix, the top layer lies at z = 0."""
    mesh, material = scene["mesh"], scene["material"]
    if mesh.kind != "block":
        raise SceneError("this is no block")
    if mesh.nodes is None or mesh.spacing is None:
        raise SceneError("[mesh] needs nodes and spacing")
    if (material.stiffness is None) == (material.young_modulus is None):
        raise SceneError("[material] needs either stiffness or young_modulus")
    counts = np.array(mesh.nodes)
    iz, iy, ix = np.meshgrid(*(np.arange(c) for c in counts[::-1]), indexing="ij")
    grid = np.stack([ix, iy, iz], axis=-1).reshape(-1, 3)
    offset = np.array([(counts[0] - 1) / 2, (counts[1] - 1) / 2, counts[2] - 1])
    nodes = (grid - offset) * mesh.spacing
    ends = block_springs(grid, counts, mesh.stencil)
    lengths = np.linalg.norm(nodes[ends[:, 1]] - nodes[ends[:, 0]], axis=1)
    mass = block_masses(grid, counts, mesh, material)
    if material.young_modulus is None:
        stiffness = np.full(len(ends), float(material.stiffness))
    else:
        stiffness = elastic_springs(ends, counts, mesh, float(material.young_modulus))
    if material.damping_ratio is None:
        damping = np.full(len(ends), float(material.damping))
    else:
        i, j = ends.T
        damping = 2.0 * material.damping_ratio * np.sqrt(stiffness * mass[i] * mass[j] / (mass[i] + mass[j]))
    return Network(nodes, mass, block_fixed(nodes, grid, mesh.fixed), ends, stiffness, damping, lengths,
                   block_surface(counts), np.array(material.gravity, dtype=float), float(material.drag))


def node_number(grid, counts):
    return (grid[..., 2] * counts[1] + grid[..., 1]) * counts[0] + grid[..., 0]


def block_springs(grid, counts, stencil):
    reach = {"structural": 1, "shear": 2, "full": 3}[stencil]
    steps = [np.array(s) for s in itertools.product((-1, 0, 1), repeat=3)
             if s > (0, 0, 0) and 1 <= np.abs(s).sum() <= reach]
    pairs = []
    for step in steps:
        other = grid + step
        inside = ((other >= 0) & (other < counts)).all(axis=1)
        pairs.append(np.stack([node_number(grid[inside], counts), node_number(other[inside], counts)], axis=1))
    return np.sort(np.concatenate(pairs), axis=1)


# Of E a: what a spring along an edge, a face diagonal and a body diagonal has inside a lattice whose cells are isotropic.
ISOTROPIC = {"shear": (2 / 5, 2 / 5), "full": (3 / 5, 1 / 5, 3 / 20)}
CELLS_AROUND = (4, 2, 1)  # an edge, a face diagonal, a body diagonal


def elastic_springs(ends, counts, mesh, young_modulus):
    """Stiffness of a lattice's springs as the sum over its cells: each gives a spring what it has inside, over the number
    of cells that are around it there."""
    if mesh.stencil not in ISOTROPIC:
        raise SceneError("material.young_modulus needs a stencil that resists shear")
    stiffness = {(i, j): 0.0 for i, j in ends.tolist()}
    corners = np.array(list(itertools.product((0, 1), repeat=3)))
    for first in itertools.product(*(range(count - 1) for count in counts)):
        for a, b in itertools.combinations(corners, 2):
            kind = np.abs(b - a).sum() - 1
            if kind < len(ISOTROPIC[mesh.stencil]):
                pair = tuple(sorted(int(node_number(np.array(first) + corner, counts)) for corner in (a, b)))
                share = ISOTROPIC[mesh.stencil][kind] / CELLS_AROUND[kind]
                stiffness[pair] += share * young_modulus * mesh.spacing
    return np.array([stiffness[i, j] for i, j in ends.tolist()])


def block_masses(grid, counts, mesh, material):
    if material.density is not None:
        halvings = (grid == 0).sum(axis=1) + (grid == counts - 1).sum(axis=1)
        return material.density * mesh.spacing**3 * 0.5**halvings
    if material.node_mass is None:
        raise SceneError("[material] needs node_mass or density")
    return np.broadcast_to(np.asarray(material.node_mass, dtype=float), len(grid)).copy()


def block_fixed(nodes, grid, fixed):
    if fixed in (None, "bottom"):
        return grid[:, 2] == 0
    if fixed == "none":
        return np.zeros(len(grid), bool)
    if "below_z" in fixed:
        return nodes[:, 2] < fixed["below_z"]
    mask = np.zeros(len(grid), bool)
    mask[fixed["nodes"]] = True
    return mask


def block_surface(counts):
    """Closed, outward surface: every boundary quad cut along one diagonal."""
    triangles = []
    for axis in range(3):
        first, second = (axis + 1) % 3, (axis + 2) % 3
        for side in (0, counts[axis] - 1):
            for a, b in itertools.product(range(counts[first] - 1), range(counts[second] - 1)):
                corner = np.zeros((4, 3), int)
                corner[:, axis] = side
                corner[:, first] = [a, a + 1, a + 1, a]
                corner[:, second] = [b, b, b + 1, b + 1]
                quad = node_number(corner, counts)
                # first x second points along +axis, which is outward only on the far side.
                quad = quad if side else quad[::-1]
                triangles += [quad[[0, 1, 2]], quad[[0, 2, 3]]]
    return np.array(triangles)


def read(path, scene):
    """The network of a network.json; gravity and drag come from the scene."""
    try:
        with open(path) as file:
            data = json.load(file)
    except (OSError, ValueError) as error:
        raise SceneError(f"{path}: {error}") from None
    try:
        springs = np.array(data["springs"], dtype=float).reshape(-1, 5)
        network = Network(np.array(data["nodes"], dtype=float), np.array(data["mass"], dtype=float),
                          np.array(data["fixed"], dtype=bool), springs[:, :2].astype(int), springs[:, 2], springs[:, 3],
                          springs[:, 4], np.array(data["triangles"], dtype=int),
                          np.array(scene["material"].gravity, dtype=float), float(scene["material"].drag))
    except (ValueError, KeyError, TypeError, IndexError) as error:
        raise SceneError(f"{path}: not a network: {error!r}") from None
    return network


def write(network, path):
    """Write a network.json."""
    springs = [[int(i), int(j), k, c, length] for (i, j), k, c, length in
               zip(network.ends, network.stiffness.tolist(), network.damping.tolist(), network.rest_length.tolist())]
    data = {"nodes": network.nodes.tolist(), "mass": network.mass.tolist(), "fixed": network.fixed.tolist(),
            "springs": springs, "triangles": network.triangles.tolist()}
    with open(path, "w") as file:
        json.dump(data, file)


def check_material(network, scene):
    """Raises unless springs and masses are those that the scene's Young's modulus and damping ratio give."""
    own = block(scene)
    order, given = (np.lexsort(np.sort(one.ends, axis=1).T[::-1]) for one in (own, network))
    pairs = [(own.mass, network.mass)] + [(getattr(own, name)[order], getattr(network, name)[given])
                                          for name in ("stiffness", "damping", "rest_length")]
    for expected, actual in pairs:
        if expected.shape != actual.shape or not (np.abs(actual - expected) <= 1e-12 * np.abs(expected)).all():
            raise SceneError("the network's springs or masses are not those of the scene's material")
