"""NVIDIA Newton's `SolverSemiImplicit`, float32, on the CPU, where Warp, which it runs on, uses one thread.

Its particles collide by default; here nothing looks for contacts. A fixed node is a particle without mass. Steps are
captured once and replayed, so that Python's part in them, 150 us a step, is not what is timed.
"""

import newton
import numpy as np
import warp as wp
from protocol import serve

wp.config.log_level = wp.LOG_WARNING


class Simulation:
    """v <- v + h M^-1 f(x, v), x <- x + h v."""

    def __init__(self, network):
        builder = newton.ModelBuilder(gravity=(0.0, 0.0, 0.0))
        mass = np.where(network.fixed, 0.0, network.mass)
        builder.add_particles(network.rest.tolist(), np.zeros_like(network.rest).tolist(), mass.tolist())
        springs = zip(network.ends.tolist(), network.stiffness.tolist(), network.damping.tolist(), strict=True)
        for (i, j), stiffness, damping in springs:
            builder.add_spring(i, j, stiffness, damping, 0.0)
        builder.spring_rest_length = network.rest_length.tolist()
        model = builder.finalize(device="cpu")
        model.particle_grid = None
        self.network = network
        self.solver = newton.solvers.SolverSemiImplicit(model)
        self.state, self.next = model.state(), model.state()
        with wp.ScopedCapture(device="cpu") as capture:
            self.advance(self.state, self.next)
            self.advance(self.next, self.state)
        self.two_steps = capture.graph
        self.reset()

    def advance(self, state, following):
        state.clear_forces()
        self.solver.step(state, following, None, None, self.network.step)

    def reset(self):
        for state in (self.state, self.next):
            state.particle_q.assign(self.network.x.astype(np.float32))
            state.particle_qd.assign(self.network.v.astype(np.float32))

    def run(self, steps):
        for _ in range(steps // 2):
            wp.capture_launch(self.two_steps)
        if steps % 2:
            self.advance(self.state, self.next)
            self.state.particle_q.assign(self.next.particle_q)
            self.state.particle_qd.assign(self.next.particle_qd)

    def positions(self):
        return self.state.particle_q.numpy().astype(float)


if __name__ == "__main__":
    serve(Simulation)
