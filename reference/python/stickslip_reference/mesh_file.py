"""Networks over mesh files: MSH 2.2 as text only, which is enough to hold a run's network against."""

import itertools
from pathlib import Path

import numpy as np

from .network import Network
from .scene import SceneError

CORNERS = {2: 3, 4: 4}  # Gmsh's triangle and tetrahedron
ROUNDING = 1e-12  # of positions, masses and lengths, relative to the largest


def read(path):
    """Positions (n, 3), tetrahedra (t, 4) and triangles (s, 3) by index."""
    try:
        sections = Path(path).read_text(encoding="utf-8").split("$")
        nodes = np.array([line.split() for line in lines(sections, "Nodes")], dtype=float)
        number = {int(row[0]): index for index, row in enumerate(nodes)}
        cells = {2: [], 4: []}
        for line in lines(sections, "Elements"):
            words = [int(word) for word in line.split()]
            if words[1] in cells:
                cells[words[1]].append([number[node] for node in words[3 + words[2]:]])
        return nodes[:, 1:], *(np.array(cells[kind], dtype=int).reshape(-1, CORNERS[kind]) for kind in (4, 2))
    except (OSError, ValueError, KeyError, IndexError, StopIteration) as error:
        raise SceneError(f"{path}: no MSH 2.2 as text: {error!r}") from None


def lines(sections, name):
    """Those of a section, without the count at its beginning."""
    section = next(section for section in sections if section.startswith(name + "\n"))
    return section.splitlines()[2:]


def network(scene):
    """The network of a scene with `mesh.kind = "file"`: a solid of tetrahedra, or a shell below triangles."""
    mesh, material = scene["mesh"], scene["material"]
    nodes, tetrahedra, triangles = read(scene.folder / mesh.path)
    nodes = nodes * mesh.scale
    if len(tetrahedra):
        nodes, tetrahedra = used(nodes, tetrahedra)
        edges, triangles, volumes = solid(nodes, tetrahedra)
        anchored = np.zeros(len(nodes), bool)
    else:
        nodes, triangles = used(nodes, triangles)
        layers = mesh.layers or 1
        nodes, edges, volumes = shell(nodes, triangles, layers, mesh.layer_depth)
        anchored = np.arange(len(nodes)) >= len(nodes) // (layers + 1) * layers
        anchored &= mesh.anchor is not False
    held = fixed(nodes, mesh.fixed or ("none" if anchored.any() else "bottom")) | anchored
    lengths = np.linalg.norm(nodes[edges[:, 1]] - nodes[edges[:, 0]], axis=1)
    mass = material.node_mass if material.density is None else material.density * volumes
    return Network(nodes, np.broadcast_to(np.asarray(mass, dtype=float), len(nodes)).copy(), held, edges,
                   np.full(len(edges), float(material.stiffness)), np.full(len(edges), float(material.damping)), lengths,
                   triangles, np.array(material.gravity, dtype=float), float(material.drag))


def used(nodes, cells):
    """Only the nodes that cells have, in their order."""
    kept, cells = np.unique(cells, return_inverse=True)
    return nodes[kept], cells.reshape(-1, cells.shape[-1] if cells.ndim > 1 else 1)


def solid(nodes, tetrahedra):
    """Edges, outward faces of only one tetrahedron, and a quarter of every volume for each of its nodes."""
    edges = np.concatenate([tetrahedra[:, pair] for pair in itertools.combinations(range(4), 2)])
    volumes = np.zeros(len(nodes))
    faces = {}
    for cell in tetrahedra:
        centre = nodes[cell].mean(axis=0)
        volumes[cell] += abs(np.linalg.det(nodes[cell[1:]] - nodes[cell[0]])) / 24
        for leave in range(4):
            face = np.delete(cell, leave)
            a, b, c = nodes[face]
            outward = np.cross(b - a, c - a) @ (a - centre) > 0
            faces.setdefault(tuple(sorted(face)), []).append(face if outward else face[::-1])
    return (np.unique(np.sort(edges, axis=1), axis=0),
            np.array([face[0] for face in faces.values() if len(face) == 1]), volumes)


def shell(outer, triangles, count, depth):
    """Nodes and springs of `count` layers below a closed outward surface, and the wall that each node stands for."""
    cross = np.cross(outer[triangles[:, 1]] - outer[triangles[:, 0]], outer[triangles[:, 2]] - outer[triangles[:, 0]])
    normals = np.zeros_like(outer)
    np.add.at(normals, triangles.ravel(), np.repeat(cross, 3, axis=0))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    sides = np.unique(np.sort(np.concatenate([triangles[:, pair] for pair in ([0, 1], [1, 2], [2, 0])]), axis=1), axis=0)
    n, nodes, edges, volumes = len(outer), [], [], []
    for layer in range(count + 1):
        copy = outer - layer * depth * normals
        a, b, c = (copy[triangles[:, corner]] for corner in range(3))
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
        share = np.zeros(n)
        np.add.at(share, triangles.ravel(), np.repeat(area / 3, 3))
        volumes.append(share * depth * (0.5 if layer in (0, count) else 1.0))
        nodes.append(copy)
        edges.append(sides + layer * n)
        if layer < count:
            down = np.array([layer * n, (layer + 1) * n])
            edges += [np.arange(n)[:, None] + down, sides + down, sides[:, ::-1] + down]
    return np.concatenate(nodes), np.concatenate(edges), np.concatenate(volumes)


def fixed(nodes, which):
    if which == "bottom":
        return nodes[:, 2] <= nodes[:, 2].min() + 1e-6 * np.linalg.norm(np.ptp(nodes, axis=0))
    if which == "none":
        return np.zeros(len(nodes), bool)
    if "below_z" in which:
        return nodes[:, 2] < which["below_z"]
    return np.isin(np.arange(len(nodes)), which["nodes"])


def check_same(own, other):
    """That two networks are the same but for the order of springs and triangles, and rounding."""
    def springs(net):
        ends = np.sort(net.ends, axis=1)
        order = np.lexsort(ends.T[::-1])
        return ends[order], np.stack([net.stiffness, net.damping, net.rest_length], axis=1)[order]

    def surface(net):
        return sorted(tuple(np.roll(triangle, -triangle.argmin())) for triangle in net.triangles)

    if len(own.nodes) != len(other.nodes) or not np.array_equal(own.fixed, other.fixed):
        raise SceneError("the run's nodes are not those of the mesh's file")
    if not np.array_equal(springs(own)[0], springs(other)[0]) or surface(own) != surface(other):
        raise SceneError("the run's springs or triangles are not those of the mesh's file")
    compared = [("positions", own.nodes, other.nodes), ("masses", own.mass, other.mass)]
    compared += zip(("stiffnesses", "dampings", "rest lengths"), springs(own)[1].T, springs(other)[1].T)
    for name, one, two in compared:
        off = np.abs(one - two).max() / np.abs(two).max()
        if not off <= ROUNDING:
            raise SceneError(f"the run's {name} differ from those of the mesh's file by {off:.1e} of the largest")
