#!/usr/bin/env python3
"""Make the meshes in fixtures/meshes: make.py SHAPE NODES FILE, or make.py alone for the ones that are kept.

Shapes: `ellipsoid`, semi-axes 60, 45 and 30 mm; `liver`, 160 mm wide, with two lobes, a notch between them and a flat
underside. Both are given to Gmsh as a closed surface of triangles, which it fills with tetrahedra; coordinates are m,
z points up. NODES is what is aimed at; the edge's length is searched for.
"""

import sys
from pathlib import Path

import gmsh
import meshio
import numpy as np

HERE = Path(__file__).resolve().parent
KEPT = HERE.parent.parent / "fixtures" / "meshes"


def ellipsoid(unit):
    """From the unit sphere."""
    return unit * [0.060, 0.045, 0.030]


def liver(unit):
    """A large right lobe (x < 0) and a flatter left one, a notch in the front edge between them, the underside flat."""
    x, y, z = unit.T
    side = 0.5 + 0.5 * np.tanh(2.5 * x)  # 0 in the right lobe, 1 in the left
    width = 0.080 * x
    notch = 1.0 - 0.35 * np.exp(-((x - 0.15) / 0.2) ** 2) * np.clip(-y, 0.0, 1.0) ** 2
    length = (0.055 - 0.018 * side) * y * notch
    height = (0.038 - 0.014 * side) * np.where(z > 0.0, z, 0.35 * z)
    return np.stack([width, length, height], axis=1)


SHAPES = {"ellipsoid": ellipsoid, "liver": liver}
# Edges along the side of bars.
BARS = (4, 6, 8)
# From so many nodes on HXT fills the surface. Gmsh's default places one node after the other where a tetrahedron is
# worst; in fine meshes of these surfaces it finds no place for most of them, leaves flat tetrahedra behind, and at
# 50,000 did not come to an end in a quarter of an hour. The kept meshes are the default's.
LARGE = 20_000
HXT = 10


def mesh(shape, edge, is_large):
    """Nodes and tetrahedra with edges of about `edge` on the unit sphere, before it is deformed."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("General.NumThreads", 1)
    gmsh.option.setNumber("Mesh.RandomSeed", 1)
    gmsh.option.setNumber("Mesh.MeshSizeMin", edge)
    gmsh.option.setNumber("Mesh.MeshSizeMax", edge)
    gmsh.model.occ.addSphere(0, 0, 0, 1)
    gmsh.model.occ.synchronize()
    gmsh.model.mesh.generate(2)
    tags, positions, _ = gmsh.model.mesh.getNodes()
    _, corners = gmsh.model.mesh.getElementsByType(2)
    positions = shape(positions.reshape(-1, 3))

    gmsh.clear()
    surface = gmsh.model.addDiscreteEntity(2)
    gmsh.model.mesh.addNodes(2, surface, tags, positions.ravel())
    gmsh.model.mesh.addElementsByType(surface, 2, [], corners)
    gmsh.model.geo.addVolume([gmsh.model.geo.addSurfaceLoop([surface])])
    gmsh.model.geo.synchronize()
    gmsh.option.setNumber("Mesh.MeshSizeMin", 0)
    gmsh.option.setNumber("Mesh.MeshSizeMax", 1)
    gmsh.option.setNumber("Mesh.MeshSizeFromPoints", 0)
    if is_large:
        gmsh.option.setNumber("Mesh.Algorithm3D", HXT)
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.optimize("Netgen")
    tags, positions, _ = gmsh.model.mesh.getNodes()
    _, corners = gmsh.model.mesh.getElementsByType(4)
    gmsh.finalize()
    order = np.argsort(tags)
    index = np.searchsorted(tags[order], corners)
    used, corners = np.unique(index, return_inverse=True)
    return positions.reshape(-1, 3)[order][used], corners.reshape(-1, 4)


def search(shape, count):
    """The mesh whose number of nodes is nearest to `count`, after a few trials."""
    edge, best = (4.0 / count) ** (1 / 3) * 1.6, None
    for _ in range(6):
        nodes, tetrahedra = mesh(shape, edge, count >= LARGE)
        if best is None or abs(len(nodes) - count) < abs(len(best[0]) - count):
            best = nodes, tetrahedra
        if abs(len(nodes) - count) <= 0.05 * count:
            break
        edge *= (len(nodes) / count) ** 0.4
    return best


def write(nodes, tetrahedra, path):
    """By its ending: .msh is 4.1 in bytes, .vtu compressed."""
    made = meshio.Mesh(nodes, {"tetra": tetrahedra})
    if Path(path).suffix == ".msh":
        meshio.write(path, made, file_format="gmsh", binary=True)
    else:
        meshio.write(path, made)
    print(f"{path}: {len(nodes)} nodes, {len(tetrahedra)} tetrahedra")


def bar(cells, path):
    """100 × 100 × 200 mm with `cells` edges along its side: what `verify::elasticity` pulls, shears and pushes."""
    side, length = 0.1, 0.2
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("General.NumThreads", 1)
    gmsh.option.setNumber("Mesh.MeshSizeMin", side / cells)
    gmsh.option.setNumber("Mesh.MeshSizeMax", side / cells)
    box = gmsh.model.occ.addBox(0, 0, -length, side, side, length)
    gmsh.model.occ.synchronize()
    # Only what is in a physical group is written: tetrahedra.
    gmsh.model.addPhysicalGroup(3, [box])
    gmsh.model.mesh.generate(3)
    gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
    gmsh.option.setNumber("Mesh.Binary", 1)
    gmsh.write(str(path))
    count = len(gmsh.model.mesh.getNodes()[0])
    gmsh.finalize()
    print(f"{path}: {count} nodes")


def main(arguments):
    if not arguments:
        for cells in BARS:
            bar(cells, KEPT / f"bar-{cells}.msh")
        for name, shape in SHAPES.items():
            write(*search(shape, 500), KEPT / f"{name}-500.msh")
            write(*search(shape, 5000), KEPT / f"{name}-5000.vtu")
        return 0
    if len(arguments) != 3 or arguments[0] not in SHAPES:
        print(__doc__, file=sys.stderr)
        return 2
    write(*search(SHAPES[arguments[0]], int(arguments[1])), arguments[2])
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
