"""Options of the tests, and the renderer that several of them use."""

from pathlib import Path

import numpy as np
import pytest
import stickslip

ROOT = Path(__file__).resolve().parents[3]


def pytest_addoption(parser):
    parser.addoption("--program", type=Path, default=ROOT / "target/debug/stickslip", help="the program stickslip")


@pytest.fixture
def program(request):
    path = request.config.getoption("program").resolve()
    assert path.exists(), f"there is no {path}: build it with `cargo build`, or give --program"
    return path


class Penalty(stickslip.Renderer):
    """A spring on the triangle whose centre is nearest, as in reference/examples/own_renderer.rs."""

    def __init__(self, stiffness):
        self.stiffness = stiffness

    def build(self, state):
        return PenaltyModel(self.stiffness, state.x[self.body.triangles])


class PenaltyModel:
    def __init__(self, stiffness, corners):
        self.stiffness, self.centres = stiffness, corners.mean(axis=1)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self.normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)

    def tick(self, before, tip):
        triangle = np.argmin(((self.centres - tip) ** 2).sum(axis=1))
        normal = self.normals[triangle]
        depth = (self.centres[triangle] - tip) @ normal
        if not depth > 0.0:
            return None
        return stickslip.Rendered(self.stiffness * depth * normal, "slide", triangle, [1 / 3, 1 / 3, 1 / 3], normal)


@pytest.fixture
def penalty():
    return Penalty(50.0)
