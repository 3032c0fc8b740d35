"""What every peer does the same: reads a network, builds its own model of it, and does as it is told.

    python in_numpy.py NETWORK.json

answers "read" when it has the network and holds nothing else, so that its memory can be looked at, and then to each
line of standard input with one line of standard output:

    build    makes the model in the initial state: "built"
    reset    goes back to the initial state: "reset"
    run N    does N steps: the processor time they took, s, of all threads, so that waiting for a CPU does not count
    state    the positions, m, as JSON: [[x, y, z], ...]

What a peer brings is `build(network) -> simulation`, with `simulation.reset()`, `.run(steps)`, `.positions()`.
"""

import ctypes
import gc
import json
import os
import sys
import time
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Network:
    """n nodes, s springs; SI units."""

    rest: np.ndarray  # (n, 3) positions at rest, m
    mass: np.ndarray  # (n,) kg
    fixed: np.ndarray  # (n,) bool: never moves
    ends: np.ndarray  # (s, 2) nodes i, j
    stiffness: np.ndarray  # (s,) N/m
    damping: np.ndarray  # (s,) N s/m
    rest_length: np.ndarray  # (s,) m
    x: np.ndarray  # (n, 3) initial positions, m
    v: np.ndarray  # (n, 3) initial velocities, m/s
    step: float  # s

    @property
    def inverse_mass(self):
        """1/kg, (n,); 0 for a fixed node."""
        return np.where(self.fixed, 0.0, 1.0 / self.mass)


# Built before anything is measured, so that libraries are loaded and kernels compiled.
TWO_NODES = Network(np.array([[0.0, 0, 0], [0, 0, 1]]), np.ones(2), np.array([True, False]), np.array([[0, 1]]),
                    np.ones(1), np.ones(1), np.ones(1), np.array([[0.0, 0, 0], [0, 0, 1.1]]), np.zeros((2, 3)), 1e-3)


def read(path):
    """The network of a file."""
    with open(path) as file:
        values = json.load(file)
    springs = np.array(values["springs"], float).reshape(-1, 5)
    stiffness, damping, rest_length = (np.ascontiguousarray(column) for column in springs.T[2:])
    return Network(np.array(values["rest"]), np.array(values["mass"]), np.array(values["fixed"]),
                   springs[:, :2].astype(np.int32), stiffness, damping, rest_length,
                   np.array(values["x"]), np.array(values["v"]), values["step"])


def give_back_memory():
    """Returns to the system what is free, so that memory in use is what is held."""
    gc.collect()
    if sys.platform == "linux":
        ctypes.CDLL(None).malloc_trim(0)


def serve(build):
    """Answers standard input until it ends. What libraries print goes to standard error."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)

    def answer(text):
        print(text, file=answers, flush=True)

    build(TWO_NODES).run(3)
    network = read(sys.argv[1])
    give_back_memory()
    answer("read")
    simulation = None
    for line in sys.stdin:
        match line.split():
            case ["build"]:
                simulation = build(network)
                give_back_memory()
                answer("built")
            case ["reset"]:
                simulation.reset()
                answer("reset")
            case ["run", steps]:
                start = time.process_time()
                simulation.run(int(steps))
                answer(repr(time.process_time() - start))
            case ["state"]:
                answer(json.dumps(simulation.positions().tolist()))
            case _:
                sys.exit(f"not a command: {line!r}; there are build, reset, run N, state")
