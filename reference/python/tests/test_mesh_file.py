"""Mesh files: what is read is a body, and a run on another network is noticed."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from stickslip_reference import mesh_file
from stickslip_reference import scene as scenes

SCENES = Path(__file__).parents[3] / "fixtures" / "crosscheck"
VOLUME = 0.040 * 0.030 * 0.020  # m^3, of the box in the files


def network(name):
    read = scenes.load(SCENES / f"{name}.toml")
    return read, mesh_file.network(read)


def enclosed(net):
    a, b, c = (net.nodes[net.triangles[:, corner]] for corner in range(3))
    return (np.cross(a, b) * c).sum() / 6


def test_a_solid_fills_its_surface(within):
    read, net = network("mesh-solid")
    within("volume of a solid by its surface", abs(enclosed(net) / VOLUME - 1), 1e-12)
    within("mass of a solid", abs(net.mass.sum() / (read["material"].density * VOLUME) - 1), 1e-12)
    assert net.fixed.sum() == (net.nodes[:, 2] < -0.0199).sum() > 3


def test_a_shell_lies_below_its_surface(within):
    read, net = network("mesh-shell")
    count = len(net.nodes) // 3
    within("volume in a shell", abs(enclosed(net) / VOLUME - 1), 1e-12)
    steps = [np.linalg.norm(net.nodes[count:] - net.nodes[:-count], axis=1)]
    within("depth of layers, m", np.abs(np.concatenate(steps) - read["mesh"].layer_depth).max(), 1e-15)
    assert (net.fixed == (np.arange(3 * count) >= 2 * count)).all() and net.triangles.max() < count


@pytest.mark.parametrize("field", ["nodes", "mass", "fixed", "ends", "stiffness", "rest_length", "triangles"])
def test_another_network_is_noticed(field):
    _, net = network("mesh-shell")
    mesh_file.check_same(net, net)
    values = getattr(net, field).copy()
    if field == "fixed":
        values[0] = ~values[0]
    elif field in ("ends", "triangles"):
        values[0] = values[0][::-1] if field == "triangles" else values[1]
    else:
        values[0] *= 1 + 1e-9
    with pytest.raises(scenes.SceneError):
        mesh_file.check_same(net, dataclasses.replace(net, **{field: values}))
