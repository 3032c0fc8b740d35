#!/usr/bin/env python3
"""Write one small body, and its surface, in every format that is read, by the programs that people use: formats.py.

Gmsh writes MSH, VTK its own formats, STL and PLY, meshio what it writes differently. Into fixtures/meshes/formats.
"""

from pathlib import Path

import gmsh
import meshio
import numpy as np
import vtk
from vtk.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray

OUT = Path(__file__).resolve().parent.parent.parent / "fixtures" / "meshes" / "formats"


def by_gmsh():
    """A box of 40 × 30 × 20 mm, in mm: MSH of both versions, as text and as bytes."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("Mesh.MeshSizeMin", 14)
    gmsh.option.setNumber("Mesh.MeshSizeMax", 14)
    gmsh.model.occ.addBox(-20, -15, -20, 40, 30, 20)
    gmsh.model.occ.synchronize()
    gmsh.model.mesh.generate(3)
    for version, name in ((1, "1"), (2.2, "2.2"), (4, "4.0"), (4.1, "4.1")):
        for binary, encoding in ((0, "text"), (1, "bytes")):
            # Gmsh writes 4.0 as text only.
            if version in (1, 4) and binary:
                continue
            gmsh.option.setNumber("Mesh.MshFileVersion", version)
            gmsh.option.setNumber("Mesh.Binary", binary)
            gmsh.write(str(OUT / f"solid-{name}-{encoding}.msh"))
    # Only triangles: those of a physical group.
    gmsh.model.addPhysicalGroup(2, [tag for _, tag in gmsh.model.getEntities(2)])
    gmsh.option.setNumber("Mesh.MshFileVersion", 2.2)
    gmsh.option.setNumber("Mesh.Binary", 0)
    gmsh.write(str(OUT / "surface-2.2-text.msh"))
    gmsh.finalize()


def grid(nodes, cells, kind):
    made = vtk.vtkUnstructuredGrid()
    points = vtk.vtkPoints()
    points.SetDataTypeToDouble()
    points.SetData(numpy_to_vtk(nodes, deep=True))
    made.SetPoints(points)
    lists = np.hstack([np.full((len(cells), 1), cells.shape[1]), cells]).astype(np.int64)
    array = vtk.vtkCellArray()
    array.ImportLegacyFormat(numpy_to_vtkIdTypeArray(lists.ravel(), deep=True))
    made.SetCells(kind, array)
    return made


def by_vtk(nodes, tetrahedra, triangles):
    solid = grid(nodes, tetrahedra, vtk.VTK_TETRA)
    for mode, encoding in ((vtk.vtkXMLWriter.Ascii, "text"), (vtk.vtkXMLWriter.Binary, "base64"),
                           (vtk.vtkXMLWriter.Appended, "appended")):
        for compressor, packing in ((None, "plain"), (vtk.vtkZLibDataCompressor(), "zlib")):
            for order, word in ((1, "little"), (0, "big")):
                if encoding == "text" and (compressor or not order):
                    continue
                for raw in ((0, 1) if encoding == "appended" else (0,)):
                    writer = vtk.vtkXMLUnstructuredGridWriter()
                    writer.SetInputData(solid)
                    writer.SetDataMode(mode)
                    writer.SetCompressor(compressor)
                    # Several blocks, the last of them shorter.
                    writer.SetBlockSize(1024)
                    writer.SetByteOrder(vtk.vtkXMLWriter.LittleEndian if order else vtk.vtkXMLWriter.BigEndian)
                    writer.SetEncodeAppendedData(not raw)
                    writer.SetHeaderType(vtk.vtkXMLWriter.UInt64 if order else vtk.vtkXMLWriter.UInt32)
                    name = "text" if encoding == "text" else f"{encoding}{'-raw' * raw}-{packing}-{word}"
                    writer.SetFileName(str(OUT / f"solid-{name}.vtu"))
                    writer.Write()
    for compressor, packing in ((vtk.vtkLZ4DataCompressor(), "lz4"), (vtk.vtkLZMADataCompressor(), "lzma")):
        writer = vtk.vtkXMLUnstructuredGridWriter()
        writer.SetInputData(solid)
        writer.SetDataMode(vtk.vtkXMLWriter.Binary)
        writer.SetCompressor(compressor)
        writer.SetBlockSize(1024)
        writer.SetFileName(str(OUT / f"solid-base64-{packing}-little.vtu"))
        writer.Write()
    surface = vtk.vtkPolyData()
    surface.SetPoints(solid.GetPoints())
    lists = np.hstack([np.full((len(triangles), 1), 3), triangles]).astype(np.int64)
    polygons = vtk.vtkCellArray()
    polygons.ImportLegacyFormat(numpy_to_vtkIdTypeArray(lists.ravel(), deep=True))
    surface.SetPolys(polygons)
    # Without nodes inside the body, as the other formats of surfaces have it.
    cleaner = vtk.vtkCleanPolyData()
    cleaner.SetInputData(surface)
    cleaner.Update()
    closed = cleaner.GetOutput()
    writer = vtk.vtkXMLPolyDataWriter()
    writer.SetInputData(closed)
    writer.SetFileName(str(OUT / "closed.vtp"))
    writer.Write()
    stripper = vtk.vtkStripper()
    stripper.SetInputData(closed)
    stripper.Update()
    writer.SetInputData(stripper.GetOutput())
    writer.SetFileName(str(OUT / "closed-strips.vtp"))
    writer.Write()
    for make, ending in ((vtk.vtkSTLWriter, "stl"), (vtk.vtkPLYWriter, "ply")):
        for kind, encoding in ((vtk.VTK_ASCII, "text"), (vtk.VTK_BINARY, "bytes")):
            writer = make()
            writer.SetInputData(closed)
            writer.SetFileType(kind)
            writer.SetFileName(str(OUT / f"closed-{encoding}.{ending}"))
            writer.Write()
    writer = vtk.vtkOBJWriter()
    writer.SetInputData(closed)
    writer.SetFileName(str(OUT / "closed.obj"))
    writer.Write()
    for version, number in ((42, "4.2"), (51, "5.1")):
        for binary, encoding in ((False, "text"), (True, "bytes")):
            for data, name, make in ((solid, "solid", vtk.vtkUnstructuredGridWriter),
                                     (surface, "surface", vtk.vtkPolyDataWriter)):
                writer = make()
                writer.SetInputData(data)
                writer.SetFileVersion(version)
                writer.SetFileType(vtk.VTK_BINARY if binary else vtk.VTK_ASCII)
                writer.SetFileName(str(OUT / f"{name}-{number}-{encoding}.vtk"))
                writer.Write()


def main():
    OUT.mkdir(parents=True, exist_ok=True)
    by_gmsh()
    read = meshio.read(OUT / "solid-4.1-bytes.msh")
    tetrahedra, triangles = read.cells_dict["tetra"], read.cells_dict["triangle"]
    by_vtk(read.points, tetrahedra, triangles)
    solid = meshio.Mesh(read.points, {"tetra": tetrahedra})
    meshio.write(OUT / "solid-meshio.vtu", solid)
    meshio.write(OUT / "solid-meshio.vtk", solid)
    meshio.write(OUT / "solid-meshio.msh", solid, file_format="gmsh")
    surface = meshio.Mesh(read.points, {"triangle": triangles})
    meshio.write(OUT / "surface-meshio.vtu", surface)


if __name__ == "__main__":
    main()
