"""Scenes and small networks that several tests share, and scripts run without a new interpreter."""

import contextlib
import io
import runpy
import sys
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

import numpy as np

from stickslip_reference.network import Network
from stickslip_reference.scene import Scene


def scene(law="stick-slip", depth=0.003, x_end=0.02, duration=1.2, **sections):
    """The drag experiment: down at x = -0.03 within 0.2 s, then along x until 1.2 s. `sections` override keys."""
    table = {
        "name": "test", "duration": duration,
        "mesh": {"nodes": [9, 9, 4], "spacing": 0.0125},
        "material": {"node_mass": 0.01, "stiffness": 100.0, "damping": 0.5},
        "contact": {"law": law},
        "instrument": {"waypoints": [[0.0, -0.03, 0.0013, 0.002], [0.2, -0.03, 0.0013, -depth],
                                     [1.2, x_end, 0.0013, -depth]]},
    }
    if law == "stick-slip":
        table["contact"]["friction"] = 1.0
    for section, keys in sections.items():
        table[section] = table.get(section, {}) | keys
    return Scene(table)


DEEP = {"surface": "shaded", "deformation": "least-norm"}


def lumps(rng, count=5):
    """A small network in general position with unequal masses, gravity and drag."""
    nodes = rng.normal(size=(count, 3))
    ends = np.array([(i, j) for i in range(count) for j in range(i + 1, count)])
    s = len(ends)
    mass, stiffness, damping, length = (rng.uniform(*range_of) for range_of in (
        (0.5, 2.0, count), (1.0, 3.0, s), (0.1, 0.5, s), (0.5, 2.0, s)))
    return Network(nodes, mass, np.zeros(count, bool), ends, stiffness, damping, length, np.array([[0, 1, 2]]),
                   gravity=np.array([0.1, 0.2, -9.81]), drag=0.3)


# Anchors and corners of the plate are this far apart, m: over millimetres of travel its springs are linear along the
# axes, and the weights of the contact point and the tilt of the plate stay put, to about travel / FAR.
FAR = 1e4


def plate(kx, kz, c, mass, weights=(1 / 3, 1 / 3, 1 / 3)):
    """One large triangle; each corner is held by a spring along x, y (kx) and z (kz). The origin has the given weights."""
    corners = FAR * np.array([[1.0, 0.0, 0.0], [-0.5, 1.0, 0.0], [-0.5, -1.0, 0.0]])
    corners = corners - np.asarray(weights) @ corners
    anchors = np.concatenate([corners + FAR * axis for axis in -np.eye(3)])
    ends = np.array([(corner, 3 + 3 * axis + corner) for axis in range(3) for corner in range(3)])
    stiffness = np.repeat([kx, kx, kz], 3).astype(float)
    return Network(np.concatenate([corners, anchors]), np.full(12, float(mass)), np.arange(12) >= 3, ends, stiffness,
                   np.full(9, float(c)), np.full(9, FAR), np.array([[0, 1, 2]]))


def plate_scene(waypoints, law="stick-slip", friction=0.5, rate=1000.0, duration=None, **contact):
    contact = {"law": law} | contact
    if law == "stick-slip":
        contact["friction"] = friction
    return Scene({"name": "plate", "duration": duration or waypoints[-1][0], "mesh": {}, "material": {"damping": 0.0},
                  "local": {"model": "full", "rate": rate}, "contact": contact, "instrument": {"waypoints": waypoints}})


def script(name, *arguments):
    """Exit status and output of one of the reference's scripts, run as by a shell but in this interpreter: to start another
    one takes longer than most of what tests ask of it. What needs processes of its own must be started as one."""
    path = str(Path(__file__).parents[1] / name)
    out, error = io.StringIO(), io.StringIO()
    with (mock.patch.object(sys, "argv", [path, *map(str, arguments)]), contextlib.redirect_stdout(out),
          contextlib.redirect_stderr(error)):
        try:
            runpy.run_path(path, run_name="__main__")
            status = 0
        except SystemExit as ended:
            status = ended.code or 0
    return SimpleNamespace(returncode=status, stdout=out.getvalue(), stderr=error.getvalue())
