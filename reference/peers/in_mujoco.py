"""MuJoCo, float64. The second argument is the integrator: `Euler` or `discrete`.

A free node is a body with three slide joints, whose `ref` makes `qpos` absolute coordinates; a fixed node is a site
of the world; a spring is a spatial tendon with both ends of `springlength` at its rest length. Contacts and the
implicit treatment of joint damping by `Euler` are switched off: what is left is semi-implicit Euler.

`discrete` solves (M + hD + h^2 K)(v' - v) = h(f - hKv) with D and K along the tendons only, by iteration.
"""

import sys

import mujoco
import numpy as np
from protocol import serve

# PGS leaves hD + h^2 K out without a word. Nothing is constrained here, so Euler solves for nothing.
SOLVER = {"Euler": "PGS", "discrete": "Newton"}
# Of discrete's solver, which is iterative: far below the error of a step.
TOLERANCE = 1e-10


def mjcf(network, integrator):
    """The network as a MuJoCo model. Numbers are in shortest round-trip form: MuJoCo reads the same bits."""
    world, tendons = [], []
    nodes = zip(network.rest.tolist(), network.mass.tolist(), network.fixed.tolist(), strict=True)
    for node, (rest, mass, fixed) in enumerate(nodes):
        position = f'pos="{rest[0]} {rest[1]} {rest[2]}"'
        if fixed:
            world.append(f'<site name="s{node}" {position}/>')
            continue
        joints = "".join(f'<joint type="slide" axis="{axis}" ref="{coordinate}"/>'
                         for axis, coordinate in zip(("1 0 0", "0 1 0", "0 0 1"), rest, strict=True))
        # Nothing turns: the moments of inertia are there because MuJoCo asks for them.
        inertia = f'<inertial pos="0 0 0" mass="{mass}" diaginertia="{mass} {mass} {mass}"/>'
        world.append(f'<body {position}>{inertia}{joints}<site name="s{node}"/></body>')
    springs = zip(network.ends.tolist(), network.stiffness.tolist(), network.damping.tolist(),
                  network.rest_length.tolist(), strict=True)
    for (i, j), k, c, rest in springs:
        tendons.append(f'<spatial stiffness="{k}" damping="{c}" springlength="{rest} {rest}">'
                       f'<site site="s{i}"/><site site="s{j}"/></spatial>')
    return (f'<mujoco><compiler autolimits="false"/>'
            f'<option integrator="{integrator}" timestep="{network.step}" gravity="0 0 0" jacobian="sparse" '
            f'solver="{SOLVER[integrator]}" tolerance="{TOLERANCE}">'
            f'<flag contact="disable" eulerdamp="disable" autoreset="disable"/></option>'
            f'<worldbody>{"".join(world)}</worldbody><tendon>{"".join(tendons)}</tendon></mujoco>')


class Simulation:
    """One `mj_step` a step, all of a run in one call."""

    def __init__(self, network, integrator):
        self.network = network
        self.free = np.flatnonzero(~network.fixed)
        self.model = mujoco.MjModel.from_xml_string(mjcf(network, integrator))
        self.data = mujoco.MjData(self.model)
        self.reset()

    def reset(self):
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:] = self.network.x[self.free].ravel()
        self.data.qvel[:] = self.network.v[self.free].ravel()

    def run(self, steps):
        mujoco.mj_step(self.model, self.data, nstep=steps)

    def positions(self):
        x = self.network.rest.copy()
        x[self.free] = self.data.qpos.reshape(-1, 3)
        return x


if __name__ == "__main__":
    serve(lambda network: Simulation(network, sys.argv[2]))
