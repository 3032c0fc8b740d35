"""Semi-implicit Euler in two kernels of NVIDIA Warp, float64, on the CPU, where Warp uses one thread.

One instance of the first kernel for every spring, which adds its force to both ends, as Newton does it. A step is
captured once and replayed, which spares Python's part in launching kernels.
"""

import warp as wp
from protocol import serve

wp.config.log_level = wp.LOG_WARNING


@wp.kernel
def add_forces(x: wp.array(dtype=wp.vec3d), v: wp.array(dtype=wp.vec3d), ends: wp.array(dtype=wp.vec2i),
               stiffness: wp.array(dtype=wp.float64), damping: wp.array(dtype=wp.float64),
               rest_length: wp.array(dtype=wp.float64), f: wp.array(dtype=wp.vec3d)):
    s = wp.tid()
    i = ends[s][0]
    j = ends[s][1]
    d = x[j] - x[i]
    length = wp.length(d)
    u = d / length
    tension = stiffness[s] * (length - rest_length[s]) + damping[s] * wp.dot(v[j] - v[i], u)
    wp.atomic_add(f, i, tension * u)
    wp.atomic_sub(f, j, tension * u)


@wp.kernel
def advance(inverse_mass: wp.array(dtype=wp.float64), h: wp.float64, f: wp.array(dtype=wp.vec3d),
            x: wp.array(dtype=wp.vec3d), v: wp.array(dtype=wp.vec3d)):
    i = wp.tid()
    v[i] = v[i] + h * inverse_mass[i] * f[i]
    x[i] = x[i] + h * v[i]
    f[i] = wp.vec3d()


class Simulation:
    """v <- v + h M^-1 f(x, v), x <- x + h v."""

    def __init__(self, network):
        def array(values, dtype):
            return wp.array(values, dtype=dtype, device="cpu")

        self.network = network
        self.x, self.v = array(network.x, wp.vec3d), array(network.v, wp.vec3d)
        f = wp.zeros_like(self.x)
        springs = [array(values, wp.float64) for values in (network.stiffness, network.damping, network.rest_length)]
        ends, inverse_mass = array(network.ends, wp.vec2i), array(network.inverse_mass, wp.float64)
        with wp.ScopedCapture(device="cpu") as capture:
            wp.launch(add_forces, len(ends), [self.x, self.v, ends, *springs, f], device="cpu")
            wp.launch(advance, len(f), [inverse_mass, network.step, f, self.x, self.v], device="cpu")
        self.step = capture.graph
        # A graph holds addresses.
        self.arrays = [f, ends, inverse_mass, *springs]
        self.reset()

    def reset(self):
        self.x.assign(self.network.x)
        self.v.assign(self.network.v)

    def run(self, steps):
        for _ in range(steps):
            wp.capture_launch(self.step)

    def positions(self):
        return self.x.numpy()


if __name__ == "__main__":
    serve(Simulation)
