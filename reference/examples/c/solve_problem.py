"""Solves a problem of `stickslip suite` from its files alone, with a renderer in a shared library.

    python solve_problem.py problems/drag-sticking-faceted build/libpaper_model.so mine.csv
    stickslip judge problems/drag-sticking-faceted/problem.toml --trace mine.csv

It needs numpy. The renderer (stickslip_renderer.h) computes the forces; this program is the global side. It moves the whole network by
semi-implicit Euler with the step of a tick, takes over the nodes that the renderer reports through `moved`, and hands it a new model at
the beginning of every cycle. It reads `network.json`, `tip.csv` and `problem.json`, and nothing of the testbed.
"""

import argparse
import json
import sys
from ctypes import (
    CDLL, POINTER, Structure, byref, c_char_p, c_double, c_int32, c_uint8, c_uint32, c_uint64, c_void_p, create_string_buffer, sizeof
)
from pathlib import Path

import numpy as np

Doubles, Vector = POINTER(c_double), c_double * 3
TYPES = {np.dtype(kind): POINTER(kind) for kind in (c_double, c_uint8, c_uint32)}
LAWS = ["sliding", "sticking", "stick-slip"]
SURFACES = {"faceted": 0, "subdivision": 2}
MODES = ["free", "stick", "slide", "slip"]


class Sized(Structure):
    """A struct of the interface: its first field is its own size."""

    def __init__(self, **fields):
        super().__init__(size=sizeof(type(self)), **fields)


class Body(Sized):
    _fields_ = [
        ("size", c_uint64), ("nodes", c_uint64), ("rest", Doubles), ("mass", Doubles), ("fixed", POINTER(c_uint8)),
        ("springs", c_uint64), ("spring_nodes", POINTER(c_uint32)), ("stiffness", Doubles), ("damping", Doubles),
        ("rest_length", Doubles), ("triangles", c_uint64), ("triangle_nodes", POINTER(c_uint32)), ("gravity", Vector), ("drag", c_double),
    ]


class Setup(Sized):
    _fields_ = [
        ("size", c_uint64), ("tick_s", c_double), ("cycle_s", c_double), ("law", c_int32), ("surface", c_int32),
        ("friction_static", c_double), ("friction_kinetic", c_double), ("adhesion", c_double), ("radius", c_double), ("options", c_char_p),
    ]


class State(Sized):
    _fields_ = [
        ("size", c_uint64), ("tick", c_uint64), ("x", Doubles), ("v", Doubles), ("tip", Doubles), ("mode", c_int32),
        ("triangle", c_uint32), ("weights", Vector), ("normal", Vector),
    ]


class Output(Sized):
    _fields_ = [
        ("size", c_uint64), ("force", Vector), ("mode", c_int32), ("triangle", c_uint32), ("weights", Vector), ("normal", Vector),
    ]


def pointer(array):
    """Returns the address of an array, which has to outlive its use."""
    return array.ctypes.data_as(TYPES[array.dtype])


class Network:
    """Masses, springs and dampers in free motion. The problems have neither gravity nor drag."""

    def __init__(self, file):
        def column(values, kind):
            return np.ascontiguousarray(values, kind)

        i, j, k, c, length = zip(*file["springs"])
        self.rest, self.mass = column(file["nodes"], "f8"), column(file["mass"], "f8")
        self.fixed, self.triangles = column(file["fixed"], "u1"), column(file["triangles"], "u4")
        self.ends, self.k, self.c, self.length = column(list(zip(i, j)), "u4"), column(k, "f8"), column(c, "f8"), column(length, "f8")
        self.inverse_mass = np.where(self.fixed, 0.0, 1.0 / self.mass)[:, None]
        self.x, self.v = self.rest.copy(), np.zeros_like(self.rest)

    def body(self):
        """Returns the struct of the body. It points to this network's arrays."""
        return Body(
            nodes=len(self.rest), rest=pointer(self.rest), mass=pointer(self.mass), fixed=pointer(self.fixed), springs=len(self.k),
            spring_nodes=pointer(self.ends), stiffness=pointer(self.k), damping=pointer(self.c), rest_length=pointer(self.length),
            triangles=len(self.triangles), triangle_nodes=pointer(self.triangles),
        )

    def step(self, h):
        """Moves all nodes by one step of semi-implicit Euler."""
        i, j = self.ends.T
        along = self.x[j] - self.x[i]
        distance = np.sqrt(np.sum(along**2, axis=1))
        rate = np.sum((self.v[j] - self.v[i]) * along, axis=1) / distance
        pull = along * ((self.k * (distance - self.length) + self.c * rate) / distance)[:, None]
        n = len(self.x)
        force = np.stack([np.bincount(i, axis, n) - np.bincount(j, axis, n) for axis in pull.T], axis=1)
        self.v += h * force * self.inverse_mass
        self.x += h * self.v


class Renderer:
    """A renderer in a shared library."""

    def __init__(self, path, body, setup):
        self.library, self.renderer = CDLL(str(path.resolve())), None
        abi = self._function("abi", c_uint32)()
        if abi != 1:
            sys.exit(f"{path} has version {abi} of the interface; this program knows version 1")
        self._build, self._swap = self._function("build", c_void_p), self._function("swap", c_void_p)
        self._tick, self._moved = self._function("tick", c_int32), self._function("moved", c_uint64)
        self._dispose, self._body = self._function("dispose", None), body
        self.renderer = c_void_p(self._function("create", c_void_p)(byref(body), byref(setup)))
        if not self.renderer:
            sys.exit(f"the renderer refuses the problem: {self._message()}")
        self._nodes = np.empty(body.nodes, "u4")
        self._x, self._v = np.empty((body.nodes, 3)), np.empty((body.nodes, 3))

    def _function(self, name, result):
        function = getattr(self.library, f"stickslip_renderer_{name}")
        function.restype = result
        return function

    def _message(self):
        if not hasattr(self.library, "stickslip_renderer_message"):
            return "it gives no reason"
        text = create_string_buffer(1000)
        self._function("message", c_uint64)(self.renderer, text, c_uint64(len(text) - 1))
        return text.value.decode()

    def hand_over(self, state):
        """Puts a model of the network's state to use."""
        model = self._build(self.renderer, byref(state))
        if not model:
            sys.exit(f"the renderer has no model from tick {state.tick} on: {self._message()}")
        old = self._swap(self.renderer, c_void_p(model))
        if old:
            self._dispose(c_void_p(old))

    def tick(self, before, tip, output):
        """Renders a tick. Returns the nodes that it moved, with their positions and velocities."""
        if self._tick(self.renderer, pointer(before), pointer(tip), byref(output)):
            sys.exit(f"the renderer failed at the tip {tip}: {self._message()}")
        m = self._moved(self.renderer, c_uint64(len(self._nodes)), pointer(self._nodes), pointer(self._x), pointer(self._v))
        if m > len(self._nodes):
            sys.exit(f"the renderer moves {m} nodes, more than the body has")
        return self._nodes[:m], self._x[:m], self._v[:m]

    def destroy(self):
        """Frees the renderer with its model."""
        self._function("destroy", None)(self.renderer)


def solve(network, tip, renderer, ticks_per_cycle, h):
    """Yields the force and the contact mode at the end of every tick."""
    output = Output()
    for tick, (before, after) in enumerate(zip(tip, tip[1:])):
        if tick % ticks_per_cycle == 0:
            renderer.hand_over(State(
                tick=tick, x=pointer(network.x), v=pointer(network.v), tip=pointer(before), mode=output.mode,
                triangle=output.triangle, weights=output.weights, normal=output.normal,
            ))
        moved, x, v = renderer.tick(before, after, output)
        # During the step they still stand where they were at the beginning of the tick.
        network.step(h)
        network.x[moved], network.v[moved] = x, v
        yield [*output.force], MODES[output.mode]


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("problem", type=Path, help="folder of the problem")
    parser.add_argument("library", type=Path, help="shared library of the renderer, which has to provide `moved`")
    parser.add_argument("trace", type=Path, help="CSV file to write: t,fx,fy,fz,mode")
    parser.add_argument("--rate", type=float, default=10.0, help="cycles per second, by which the ticks per second are divisible (default 10)")
    parser.add_argument("--options", default="", help='text for the renderer, such as "rings=2"')
    parser.add_argument("--facets", action="store_true", help="touch the flat triangles, whatever surface the problem asks for")
    arguments = parser.parse_args()
    problem = json.loads((arguments.problem / "problem.json").read_text())
    network = Network(json.loads((arguments.problem / "network.json").read_text()))
    contact, rate = problem["contact"], problem["rate_hz"]
    if not (arguments.rate > 0.0 and rate % arguments.rate == 0.0):
        parser.error(f"the {rate:g} ticks per second are not divisible by {arguments.rate:g} cycles per second")
    surface = "faceted" if arguments.facets else contact["surface"]
    friction = contact["friction"] or {"static": 0.0, "kinetic": 0.0}
    renderer = Renderer(arguments.library, network.body(), Setup(
        tick_s=1.0 / rate, cycle_s=1.0 / arguments.rate, law=LAWS.index(contact["law"]), surface=SURFACES[surface],
        friction_static=friction["static"], friction_kinetic=friction["kinetic"], adhesion=contact["adhesion_n"],
        radius=contact["radius_m"], options=arguments.options.encode(),
    ))
    table = np.loadtxt(arguments.problem / "tip.csv", delimiter=",", skiprows=1)
    tip = np.ascontiguousarray(table[:, 1:])
    rows = list(solve(network, tip, renderer, round(rate / arguments.rate), 1.0 / rate))
    renderer.destroy()
    with arguments.trace.open("w") as file:
        print("t,fx,fy,fz,mode", file=file)
        for t, (force, mode) in zip(table[1:, 0], rows):
            print(*(f"{number:.17g}" for number in [t, *force]), mode, sep=",", file=file)
    touching, largest = sum(mode != "free" for _, mode in rows), max(np.linalg.norm(force) for force, _ in rows)
    print(f"{problem['name']}: {len(rows)} ticks, {touching} of them in contact, up to {largest:.3f} N")
    if surface != contact["surface"]:
        print(f"the problem asks for the surface `{contact['surface']}`; this solution touches flat triangles instead")


if __name__ == "__main__":
    main()
