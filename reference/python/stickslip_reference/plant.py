"""Device and hand between two commands, in continuous time, integrated by Runge and Kutta's method of order 4.

The hand is a mass between the stylus (k1, b1) and an arm (k2, b2) whose other end follows the waypoints, along each
device axis (M. J. Fu, M. C. Cavusoglu, Human-arm-and-hand-dynamic model with variability analyses for a stylus-based haptic
interface, IEEE Trans. Syst. Man Cybern. B 42 (2012)). Without a structure the stylus is the end of the links; with one it is a
mass that a spring and a damper join to that end.
"""

import numpy as np

from . import phantom
from .scene import minimum_jerk

# Where the parts of the state (16,) are: rad, rad/s, A, m, m/s, and the energy delivered to the hand, J.
THETA, RATE, CURRENT, HAND, HAND_VELOCITY = (slice(first, first + 3) for first in range(0, 15, 3))
ENERGY = 15
# With a structure the state is (22,): place and velocity of the stylus, m and m/s, come last.
STYLUS, STYLUS_VELOCITY = slice(16, 19), slice(19, 22)


class Plant:
    """What does not change: the device, the hand, and the target of the hand in device axes."""

    def __init__(self, device, hand, waypoints, interpolation="linear", structure=None):
        self.device, self.hand, self.interpolation, self.structure = device, hand, interpolation, structure
        self.times, self.places = waypoints[:, 0].copy(), phantom.to_device(device, waypoints[:, 1:])
        self.axes = [axis.copy() for axis in self.places.T]
        self.rotors = np.diag(device.rotor_inertia)
        self.drive = device.capstan_ratio * device.torque_constant

    def at_rest(self):
        """The state at the first waypoint: nothing moves, and no current flows."""
        state = np.zeros(16)
        state[THETA] = phantom.inverse(self.places[0])
        state[HAND] = phantom.forward(state[THETA])
        return state if self.structure is None else np.concatenate([state, state[HAND], np.zeros(3)])

    def stylus(self, state):
        """Where the hand holds the device, m."""
        return phantom.forward(state[THETA]) if self.structure is None else state[STYLUS]

    def warped(self, t):
        """The time at which linear interpolation is where the target is at t, and its rate."""
        return minimum_jerk(t, self.times) if self.interpolation == "minimum-jerk" else (t, 1.0)

    def target(self, t):
        """Where the hand aims at time t, m."""
        t, _ = self.warped(t)
        return np.array([np.interp(t, self.times, axis) for axis in self.axes])

    def target_velocity(self, t):
        """Slope of the path at t, in the piece around it, m/s; zero before the first waypoint and after the last."""
        piece = np.searchsorted(self.times, t, side="right") - 1
        if not 0 <= piece < len(self.times) - 1:
            return np.zeros(3)
        _, rate = self.warped(t)
        return rate * (self.places[piece + 1] - self.places[piece]) / (self.times[piece + 1] - self.times[piece])

    def slope(self, state, command, target, target_velocity):
        """d state / dt under the currents commanded."""
        device, hand = self.device, self.hand
        theta, rate = state[THETA], state[RATE]
        jacobian = phantom.jacobian(theta)
        velocity = jacobian @ rate if self.structure is None else state[STYLUS_VELOCITY]
        stylus = (hand.stylus_stiffness * (state[HAND] - self.stylus(state))
                  + hand.stylus_damping * (state[HAND_VELOCITY] - velocity))  # on the device, N
        on_links, beyond = (stylus, []) if self.structure is None else self.bend(state, jacobian @ rate, stylus)
        arm = hand.arm_stiffness * (target - state[HAND]) + hand.arm_damping * (target_velocity - state[HAND_VELOCITY])
        torque = (self.drive * state[CURRENT] + jacobian.T @ on_links
                  - phantom.coriolis(theta, rate) @ rate - phantom.gravity(theta) - device.joint_damping * rate
                  - device.joint_friction * np.tanh(rate / device.friction_speed))
        inertia = phantom.mass_matrix(theta) + self.rotors
        return np.concatenate([rate, np.linalg.solve(inertia, torque),
                               2.0 * np.pi * device.amplifier_bandwidth * (command - state[CURRENT]),
                               state[HAND_VELOCITY], (arm - stylus) / hand.mass, [-stylus @ velocity], beyond])

    def bend(self, state, velocity, grip):
        """Force of the stylus on the end of the links, N, which moves at `velocity`; and the rates of the stylus (6,)."""
        k, m, ratio = self.structure.stiffness, self.structure.tip_mass, self.structure.damping_ratio
        stretch = state[STYLUS] - phantom.forward(state[THETA])
        force = k * stretch + 2.0 * ratio * np.sqrt(k * m) * (state[STYLUS_VELOCITY] - velocity)
        return force, np.concatenate([state[STYLUS_VELOCITY], (grip - force) / m])

    def advance(self, state, t, h, command):
        """The state at t + h, by equal substeps, the command being held."""
        step = h / self.device.substeps
        for number in range(self.device.substeps):
            start = t + number * step
            velocity = self.target_velocity(start + 0.5 * step)

            first, middle, last = (self.target(start + share * step) for share in (0.0, 0.5, 1.0))
            k1 = self.slope(state, command, first, velocity)
            k2 = self.slope(state + 0.5 * step * k1, command, middle, velocity)
            k3 = self.slope(state + 0.5 * step * k2, command, middle, velocity)
            k4 = self.slope(state + step * k3, command, last, velocity)
            state = state + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        return state
