#!/usr/bin/env python3
"""Compare the reading of other programs' bodies with VTK's, and try what error messages advise: bodies.py PROGRAM OUT.

PROGRAM is the stickslip program, OUT a folder for files. The bodies come from the packages in requirements.txt, whose
licences allow their use, and none of them is kept here: PyVista's examples (MIT), the tutorials and examples of Gmsh (GPL),
meshed by Gmsh, and bodies made by VTK's filters. For each body, the numbers of nodes, edges and boundary triangles have to be
those that VTK counts, and the volume has to be the same.
"""

import contextlib
import io
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import gmsh
import meshio
import numpy as np
import pyvista
import vtk

EXAMPLES = Path(pyvista.__file__).parent / "examples"
GMSH = Path(sys.prefix) / "share" / "doc" / "gmsh"
# Tetrahedra of a cell that is cut, and its faces, by VTK's type.
TETRAHEDRA = {10: 1, 12: 6, 13: 3, 14: 2}
FACES = {10: 4, 12: 6, 13: 5, 14: 5}
# Largest relative difference of volumes: sums over some thousand elements in 64 bits (measured: 6e-15), or of coordinates
# that VTK reads in 32 bits from these formats, off by 6e-8 of their size (measured: 5e-8).
SAME_VOLUME = 1e-12
SAME_VOLUME_32 = 1e-6
READ_IN_32 = (".stl", ".obj", ".ply")

SCENE = """name = "body"
duration = 0.001
[mesh]
kind = "file"
path = "{path}"
fixed = "none"
{more}
[material]
node_mass = 1.0
stiffness = 1.0
damping = 0.1
[contact]
law = "sliding"
[instrument]
waypoints = [[0.0, 0.0, 0.0, {above}]]
"""


class Refused(Exception):
    """The program refuses a mesh: its message."""


class Reader:
    """The program, which reads a mesh and leaves its network."""

    def __init__(self, program, out):
        self.program, self.out = program, out

    def network(self, path, more=""):
        """What the program makes of a file. A closed surface gets one layer below it."""
        extent = 1.0
        with contextlib.suppress(Exception):
            extent = float(np.ptp(np.array(pyvista.read(path).bounds).reshape(3, 2), axis=1).max())
        for layer in ("", f"layer_depth = {1e-6 * extent}"):
            scene = self.out / "scene.toml"
            scene.write_text(SCENE.format(path=path, more=more + "\n" + layer, above=100 * extent + 1e11))
            run = subprocess.run([self.program, "run", scene, "--out", self.out / "run", "--quiet"], capture_output=True, text=True)
            if run.returncode == 0:
                return json.loads((self.out / "run" / "network.json").read_text())
            message = " ".join(re.sub("[│╭╰─]", " ", run.stderr).split())
            assert run.returncode == 2, f"{path}: exit code {run.returncode}: {message}"
            if "`mesh.layer_depth` is missing" not in message:
                raise Refused(message)
        raise AssertionError(path)


def read_here(network):
    """Nodes, edges and triangles of the body, and its volume. A shell is its outermost layer."""
    nodes, triangles = np.array(network["nodes"]), np.array(network["triangles"])
    count = len(nodes)
    springs = np.array([spring[:2] for spring in network["springs"]])
    # The layers of a shell have as many nodes each, and its surface is in the first.
    if triangles.max() < count // 2 and len(np.unique(triangles)) == count // 2:
        count //= 2
        springs = springs[(springs < count).all(axis=1)]
    # About a point of the body: far from the origin, digits would be lost.
    a, b, c = (nodes[triangles[:, i]] - nodes[0] for i in range(3))
    return count, len(springs), len(triangles), float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def read_by_vtk(path):
    """The same by VTK."""
    mesh = pyvista.read(path)
    if isinstance(mesh, pyvista.PolyData):
        mesh = mesh.triangulate()
        faces = mesh.regular_faces
        # Without the lines that merging leaves of flat triangles: vtkMassProperties takes them for faces.
        volume = pyvista.PolyData.from_regular_faces(mesh.points, faces).volume
        return len(np.unique(faces)), edges(faces), len(faces), volume
    solid = mesh.extract_cells(np.isin(mesh.celltypes, list(TETRAHEDRA)))
    surface = vtk.vtkDataSetSurfaceFilter()
    surface.SetInputData(solid)
    surface.Update()
    surface = pyvista.wrap(surface.GetOutput())
    boundary = surface.triangulate().n_cells
    kinds, counts = np.unique(solid.celltypes, return_counts=True)
    tetrahedra = sum(TETRAHEDRA[kind] * count for kind, count in zip(kinds, counts))
    faces = (sum(FACES[kind] * count for kind, count in zip(kinds, counts)) + surface.n_cells) // 2
    # Cells that are cut have more edges than VTK counts: by Euler's formula, as many as their tetrahedra and triangles require.
    euler = solid.n_points - solid.extract_all_edges().n_cells + faces - solid.n_cells
    triangles = (4 * tetrahedra + boundary) // 2
    volume = np.abs(solid.compute_cell_sizes(length=False, area=False)["Volume"]).sum()
    return solid.n_points, solid.n_points + triangles - tetrahedra - euler, boundary, volume


def edges(faces):
    pairs = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    return len(np.unique(pairs, axis=0))


def by_gmsh(source, out):
    """A body of Gmsh's tutorials and examples: as MSH, and as VTK, which VTK can read."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("General.NumThreads", 1)
    gmsh.open(str(GMSH / source))
    gmsh.model.mesh.generate(3)
    stem = out / Path(source).stem
    gmsh.write(f"{stem}.msh")
    gmsh.write(f"{stem}.vtk")
    gmsh.finalize()
    return Path(f"{stem}.msh"), Path(f"{stem}.vtk")


def bodies(out):
    """Name, file to read, and file of the same body that VTK reads."""

    def saved(mesh, name):
        mesh.save(out / name)
        return out / name

    for name in ("nut.ply", "sphere.ply", "hexbeam.vtk"):
        yield f"PyVista: {name}", EXAMPLES / name, EXAMPLES / name
    ant = saved(pyvista.read(EXAMPLES / "ant.ply").connectivity("largest"), "ant.vtp")
    yield "PyVista: largest piece of ant.ply", ant, ant
    wing = pyvista.read(EXAMPLES / "airplane.ply").connectivity("largest").fill_holes(1e9)
    wing = saved(wing, "airplane.stl")
    yield "PyVista: largest piece of airplane.ply, holes filled", wing, wing
    globe = pyvista.read(EXAMPLES / "globe.vtk")
    globe = saved(globe.clean(tolerance=1e-6 * globe.length).triangulate(), "globe.vtp")
    yield "PyVista: globe.vtk, nodes merged", globe, globe
    clip = saved(pyvista.read(EXAMPLES / "hexbeam.vtk").clip("x"), "clip.vtu")
    yield "PyVista: hexbeam.vtk, clipped by VTK", clip, clip
    yield "Gmsh: t13_data.stl", GMSH / "tutorials" / "t13_data.stl", GMSH / "tutorials" / "t13_data.stl"
    for source in ("examples/boolean/compsolid.geo", "examples/boolean/extrude2.geo"):
        yield f"Gmsh: {source}", *by_gmsh(source, out)
    _, both = by_gmsh("tutorials/t2.geo", out)
    one = pyvista.read(both)
    one = saved(one.extract_cells(one.celltypes == 10).connectivity("largest"), "t2.vtu")
    yield "Gmsh: largest piece of tutorials/t2.geo", one, one
    ellipsoid = saved(pyvista.ParametricEllipsoid(1, 2, 3, u_res=24, v_res=24, w_res=24).clean(), "ellipsoid.obj")
    yield "VTK: vtkParametricEllipsoid", ellipsoid, ellipsoid
    torus = saved(pyvista.ParametricTorus(u_res=24, v_res=24, w_res=24).clean(tolerance=1e-6), "torus.ply")
    yield "VTK: vtkParametricTorus", torus, torus
    cylinder = saved(pyvista.Cylinder().clean(), "cylinder.vtp")
    yield "VTK: vtkCylinderSource", cylinder, cylinder


def compare(reader, out):
    worst = {}
    for name, path, for_vtk in bodies(out):
        here, there = read_here(reader.network(path)), read_by_vtk(for_vtk)
        off = abs(here[3] / there[3] - 1)
        print(f"{name}: {here[0]} nodes, {here[1]} edges, {here[2]} triangles, volume {here[3]:.6g}, relative to VTK's {off:.1e}")
        assert here[:3] == there[:3], f"{name}: {here} here, {there} by VTK"
        limit = SAME_VOLUME_32 if path.suffix in READ_IN_32 else SAME_VOLUME
        assert off <= limit, f"{name}: volume {here[3]} here, {there[3]} by VTK"
        worst[limit] = max(worst.get(limit, 0.0), off)
    for limit, off in worst.items():
        bits = 64 if limit == SAME_VOLUME else 32
        print(f"RESIDUAL | bodies that VTK reads in {bits} bits | volume, relative | {limit} | {off:.1e}")


def tetrahedron(shift=0.0):
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float) + shift
    return pyvista.UnstructuredGrid({vtk.VTK_TETRA: np.array([[0, 1, 2, 3]])}, points)


def advised(message):
    """The commands that a message has in backquotes."""
    return re.findall(r"`([^`]+)`", message.split("help:")[1])


def refusal(reader, path, words, more=""):
    try:
        reader.network(path, more)
    except Refused as refused:
        assert words in str(refused), f"{path}: {words!r} is not in {refused}"
        return str(refused)
    raise AssertionError(f"{path} is taken")


def advice(reader, out):
    """Each way out, literally as its message has it where it is a command."""
    os.chdir(out)

    def by_python(source, mesh=None, **names):
        scope = {"pyvista": pyvista, "mesh": mesh, **names}
        return eval(source, scope)  # noqa: S307: the text of a message of our own

    # Another format.
    meshio.write("liver.inp", meshio.Mesh(np.array(tetrahedron().points), {"tetra": np.array([[0, 1, 2, 3]])}))
    command, = advised(refusal(reader, out / "liver.inp", "not a mesh file by its extension"))
    program, *arguments = command.split()
    subprocess.run([Path(sys.prefix) / "bin" / program, *arguments], check=True, capture_output=True)
    reader.network(out / "liver.vtu")

    # Another kind of VTK data.
    pyvista.ImageData(dimensions=(3, 3, 3)).save("liver.vtk")
    commands = advised(refusal(reader, out / "liver.vtk", "STRUCTURED_POINTS"))
    by_python(commands[-1])
    reader.network(out / "liver.vtu")

    # A shape that is not read.
    faces = [4, 3, 0, 2, 1, 3, 0, 1, 3, 3, 0, 3, 2, 3, 1, 2, 3]
    cells = [len(faces), *faces]
    pyvista.UnstructuredGrid(cells, [vtk.VTK_POLYHEDRON], tetrahedron().points).save("liver.vtu")
    command, = advised(refusal(reader, out / "liver.vtu", "polyhedron"))
    by_python(command)
    reader.network(out / "simplices.vtu")

    # No elements but of other groups.
    for save_all in (0, 1):
        gmsh.initialize()
        gmsh.option.setNumber("General.Terminal", 0)
        box = gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(1, [1])
        gmsh.model.mesh.generate(3)
        gmsh.option.setNumber("Mesh.SaveAll", save_all)
        gmsh.write("grouped.msh")
        gmsh.finalize()
        if not save_all:
            assert "Mesh.SaveAll = 1" in refusal(reader, out / "grouped.msh", "neither tetrahedra nor triangles"), box
    reader.network(out / "grouped.msh")

    # Nodes of two parts that are not joined.
    pyvista.Cylinder().save("cylinder.vtp")
    source, = advised(refusal(reader, out / "cylinder.vtp", "lie at the same place"))
    by_python(source, pyvista.read("cylinder.vtp"), d=1e-6).save("joined.vtp")
    reader.network(out / "joined.vtp")

    # A triangle that names a node twice.
    faces = np.array([3, 0, 2, 1, 3, 0, 1, 3, 3, 0, 3, 2, 3, 1, 2, 3, 3, 1, 2, 2])
    pyvista.PolyData(tetrahedron().points, faces=faces).save("needle.vtp")
    source, = advised(refusal(reader, out / "needle.vtp", "is flat"))
    by_python(source, pyvista.read("needle.vtp")).save("joined.vtp")
    reader.network(out / "joined.vtp")

    # A flat tetrahedron on a face of another, as Delaunay triangulations leave them at a surface.
    points = np.vstack([tetrahedron().points, [[0.4, 0.3, 0.3]]])
    flat = pyvista.UnstructuredGrid({vtk.VTK_TETRA: np.array([[0, 1, 2, 3], [1, 2, 3, 4]])}, points)
    flat.save("flat.vtu")
    source, = advised(refusal(reader, out / "flat.vtu", "is flat"))
    by_python(source, flat, v=1e-9).save("round.vtu")
    reader.network(out / "round.vtu")

    # Several pieces.
    (tetrahedron() + tetrahedron(3.0)).save("two.vtu")
    source, = advised(refusal(reader, out / "two.vtu", "separate pieces"))
    by_python(source, pyvista.read("two.vtu")).save("one.vtu")
    reader.network(out / "one.vtu")

    # A hole.
    pyvista.Sphere().remove_cells([7]).save("hole.vtp")
    source, *_ = advised(refusal(reader, out / "hole.vtp", "the surface is open"))
    by_python(source, pyvista.read("hole.vtp"), size=1.0).save("closed.vtp")
    reader.network(out / "closed.vtp")

    # Parts that touch at an edge, between two that join them.
    corners = [(x, y, z) for z in range(3) for y in range(2) for x in range(2) if z != 1 or x == y]
    touching = pyvista.ImageData(dimensions=(3, 3, 4)).cast_to_unstructured_grid()
    touching = touching.extract_cells([x + 2 * (y + 2 * z) for x, y, z in corners])
    touching.save("touching.vtu")
    key, = advised(refusal(reader, out / "touching.vtu", "4 faces of the surface meet at the edge"))
    reader.network(out / "touching.vtu", key.removeprefix("mesh."))
    print("Every way out that a message names leads out.")


def main(arguments):
    if len(arguments) != 2:
        print(__doc__, file=sys.stderr)
        return 2
    out = Path(arguments[1]).resolve()
    out.mkdir(parents=True, exist_ok=True)
    vtk.vtkObject.GlobalWarningDisplayOff()
    vtk.vtkLogger.SetStderrVerbosity(vtk.vtkLogger.VERBOSITY_OFF)
    reader = Reader(Path(arguments[0]).resolve(), out)
    compare(reader, out)
    advice(reader, out)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
