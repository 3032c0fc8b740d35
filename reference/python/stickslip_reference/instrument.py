"""What moves the tip that the contact sees, and where the contact's force goes.

An instrument has a `tip`, and a `velocity` of it if it estimates one; `move(tick)` brings it to the tick's end,
`command(force)` takes the force of that tick and returns what was commanded.
"""

import numpy as np

from . import phantom
from .observer import Observer
from .phantom import WorkspaceError
from .plant import ENERGY, THETA, Plant
from .scene import SceneError


def build(scene):
    return Phantom(scene) if scene["instrument"].kind == "phantom-1.5" else Path(scene)


class Path:
    """A tip that is where the scene says, whatever the force."""

    velocity = None

    def __init__(self, scene):
        self.scene, self.tip = scene, scene.tip(0)

    def move(self, tick):
        self.tip = self.scene.tip(tick + 1)

    def command(self, force):
        return force

    def state(self):
        return {}


class Phantom:
    """The modelled device in a hand: every tick it moves under the command of the tick before, then is measured."""

    def __init__(self, scene):
        options = scene["instrument"]
        self.device, self.h = options.device, scene.h
        self.plant = Plant(options.device, options.hand, scene.waypoints, options.interpolation, options.structure)
        try:
            self.y = self.plant.at_rest()
        except WorkspaceError as error:
            raise SceneError(f"instrument.waypoints: the device cannot start at the first: {error}") from None
        self.currents = np.zeros(3)
        self.sense()
        observed = options.device.tip == "observed"
        self.observer = Observer(self.posture, phantom.count(options.device), self.h) if observed else None
        self.coupling = Coupling(options.coupling, self.measured, self.h) if options.coupling else None
        self.passivity = PassivityControl() if options.passivity_control else None

    @property
    def tip(self):
        if self.observer:
            return phantom.to_scene(self.device, phantom.forward(self.observer.angle))
        return self.coupling.x if self.coupling else self.measured

    @property
    def velocity(self):
        """Of the tip in scene axes, m/s, as the encoders tell it; None where only the way of the tip does."""
        if self.observer is None:
            return None
        return phantom.jacobian(self.observer.angle) @ self.observer.rate @ self.device.rotation

    def sense(self):
        """Posture and tip as the encoders tell them, the tip in scene axes."""
        self.posture = phantom.measured(self.device, self.y[THETA])
        self.measured = phantom.to_scene(self.device, phantom.forward(self.posture))

    def move(self, tick):
        """A WorkspaceError ends it where the device cannot follow."""
        before = self.measured
        self.y = self.plant.advance(self.y, tick * self.h, self.h, self.currents)
        phantom.check(self.y[THETA])
        self.sense()
        self.moved = self.measured - before
        if self.observer:
            self.observer.move(self.posture)
        if self.coupling:
            self.coupling.move(self.measured, self.moved / self.h)

    def command(self, force):
        if self.coupling:
            force = self.coupling.command(force)
        if self.passivity:
            force = self.passivity.damped(force, self.moved)
        self.currents = phantom.currents(self.device, self.posture, force)
        if self.passivity:
            self.passivity.held = phantom.applied(self.device, self.posture, self.currents)
        return force

    def state(self):
        """Further columns of the trace: the true tip in scene axes, and the energy that the hand has been given."""
        tip = phantom.to_scene(self.device, self.plant.stylus(self.y))
        return dict(zip(("device_x", "device_y", "device_z"), tip)) | {"hand_energy": self.y[ENERGY]}


class Coupling:
    """A virtual coupling: the contact sees a mass that hangs on the device by a spring and a damper.

    J. E. Colgate, M. C. Stanley, J. M. Brown, Issues in the haptic display of tool use, IROS 1995.
    """

    def __init__(self, options, tip, h):
        self.options, self.h = options, h
        self.x, self.v = tip, np.zeros(3)
        self.contact_force = np.zeros(3)

    def pull(self):
        """Force of the coupling on the mass, N."""
        return self.options.stiffness * (self.device_x - self.x) + self.options.damping * (self.device_v - self.v)

    def move(self, device_x, device_v):
        self.device_x, self.device_v = device_x, device_v
        self.v = self.v + self.h / self.options.mass * (self.pull() + self.contact_force)
        self.x = self.x + self.h * self.v

    def command(self, contact_force):
        """Force on the device; that of the contact acts on the mass in the next tick."""
        self.contact_force = contact_force
        return -self.pull()


class PassivityControl:
    """Takes by a damper what the simulation would give out beyond what it has taken in.

    B. Hannaford, J.-H. Ryu, Time-domain passivity control of haptic interfaces, IEEE Trans. Robot. Autom. 18 (2002).

    A force counts with the way over which the motors held it.
    """

    def __init__(self):
        self.energy, self.held = 0.0, np.zeros(3)

    def damped(self, force, moved):
        """The force to command where the measured tip has `moved` since the command before, m."""
        self.energy -= self.held @ moved
        if self.energy < 0.0 and moved.any():
            return force + (self.energy / (moved @ moved)) * moved
        return force


class Smoothing:
    """Lets the step of the force at a hand-over fade over some ticks, linearly."""

    def __init__(self, ticks):
        self.ticks, self.since = ticks, ticks
        self.last, self.gap = np.zeros(3), np.zeros(3)

    def smoothed(self, force, new_model):
        """The force to pass on; `new_model` in the first tick of a model."""
        if new_model:
            self.gap, self.since = self.last - force, 0
        if self.since < self.ticks:
            force = force + (1.0 - (self.since + 1) / (self.ticks + 1)) * self.gap
            self.since += 1
        self.last = force
        return force
