"""What the peer comparison speaks, and its numpy peer, against the reference's own steps."""

import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from setups import scene
from stickslip_reference import cycle
from stickslip_reference import network as net

PEER = Path(__file__).parents[2] / "peers" / "in_numpy.py"
STEPS = 100
STEP = 1e-3
# Largest difference of a position after 100 steps, relative to the spacing; sums of 26 forces in another order are off
# by a few roundings of 1e-16 a step, which add up. Measured: 1.1e-15.
TRAJECTORY_TOLERANCE = 1e-12


@pytest.fixture
def moving():
    """A block of 125 nodes with springs that differ, and a state in which it moves."""
    rng = np.random.default_rng(1)
    block = net.block(scene(mesh={"nodes": [5, 5, 5], "stencil": "full"}, material={"damping": 0.1}))
    s = len(block.ends)
    network = net.Network(block.nodes, block.mass * rng.uniform(0.5, 1.5, len(block.mass)), block.fixed, block.ends,
                          block.stiffness * rng.uniform(0.7, 1.3, s), block.damping * rng.uniform(0.5, 1.5, s),
                          block.rest_length * rng.uniform(0.95, 1.05, s), block.triangles)
    free = ~network.fixed[:, None]
    x = network.nodes + free * 0.002 * rng.normal(size=network.nodes.shape)
    return network, SimpleNamespace(x=x, v=free * 0.1 * rng.normal(size=x.shape))


def ask(path, commands):
    """The peer's answers, one line each."""
    process = subprocess.run([sys.executable, PEER, path], input="\n".join(commands), capture_output=True, text=True,
                             check=False)
    return process.returncode, process.stdout.splitlines(), process.stderr


def write(path, network, state):
    springs = zip(*network.ends.T.tolist(), network.stiffness.tolist(), network.damping.tolist(),
                  network.rest_length.tolist(), strict=True)
    path.write_text(json.dumps({
        "rest": network.nodes.tolist(), "mass": network.mass.tolist(), "fixed": network.fixed.tolist(),
        "springs": list(springs), "x": state.x.tolist(), "v": state.v.tolist(), "step": STEP}))


def test_numpy_peer_does_the_steps_it_is_told(moving, tmp_path, within):
    network, state = moving
    write(tmp_path / "network.json", network, state)
    half = f"run {STEPS // 2}"
    status, answers, _ = ask(tmp_path / "network.json",
                             ["build", "run 7", "reset", "state", half, half, "state"])
    assert status == 0
    assert answers[:2] == ["read", "built"] and answers[3] == "reset"
    assert all(float(answers[i]) >= 0.0 for i in (2, 5, 6))
    assert np.array_equal(json.loads(answers[4]), state.x)
    for _ in range(STEPS):
        cycle.integrate(network, state, STEP, "semi-implicit-euler")
    difference = np.abs(np.array(json.loads(answers[7])) - state.x).max() / 0.0125
    within("numpy peer after 100 steps", difference, TRAJECTORY_TOLERANCE)


def test_a_peer_says_what_it_does_not_understand(moving, tmp_path):
    write(tmp_path / "network.json", *moving)
    status, _, error = ask(tmp_path / "network.json", ["build", "walk 3"])
    assert status == 1 and "not a command: 'walk 3'" in error and "run N" in error
