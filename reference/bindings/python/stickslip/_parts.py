"""Renderers and instruments of one's own: the base classes, and what their methods receive and return."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, Optional, Protocol, Tuple, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.uint32]

#: Modes of a contact, as in the column ``mode`` of a trace.
MODES = ("free", "stick", "slide", "slip")


@dataclass(frozen=True, eq=False)
class Body:
    """The body as a renderer sees it, constant within a run. Its arrays are copies that cannot be written."""

    #: Node positions at rest, m: (nodes, 3).
    rest: Floats
    #: Lumped masses, kg: (nodes,).
    mass: Floats
    #: Whether a node never moves: (nodes,).
    fixed: NDArray[np.bool_]
    #: The two nodes of each spring: (springs, 2).
    spring_nodes: Indices
    #: Stiffness, N/m: (springs,).
    stiffness: Floats
    #: Damping, N·s/m: (springs,).
    damping: Floats
    #: Rest length, m: (springs,).
    rest_length: Floats
    #: Nodes of each triangle of the surface, counterclockwise seen from outside: (triangles, 3).
    triangles: Indices
    #: Gravity, m/s²: (3,).
    gravity: Floats
    #: Damping of each node's velocity, N·s/m.
    drag: float


@dataclass(frozen=True)
class Setup:
    """What a scene asks of its renderer, constant within a run."""

    #: Time between two ticks, s.
    tick_s: float
    #: Time between two models, s.
    cycle_s: float
    #: "sliding", "sticking" or "stick-slip".
    law: str
    #: Coefficients of friction; 0 without friction.
    friction_static: float
    friction_kinetic: float
    #: Largest pulling force of a contact, N; may be infinite.
    adhesion_n: float
    #: "faceted", "shaded" or "subdivision".
    surface: str
    #: Radius of the disc over which a contact is spread, m; 0 for a point.
    radius_m: float


class Rendered(NamedTuple):
    """Result of a tick."""

    #: Force on the instrument, N: (3,).
    force: ArrayLike
    #: "free", "stick", "slide" or "slip".
    mode: str = "free"
    #: The triangle in which the contact point lies; ``None`` without a contact.
    triangle: Optional[int] = None
    #: Barycentric weights of the contact point in that triangle.
    weights: Optional[ArrayLike] = None
    #: Outward unit normal of the contact.
    normal: Optional[ArrayLike] = None


@dataclass(frozen=True, eq=False)
class State:
    """State of the network at a hand-over. Its arrays are copies that cannot be written."""

    #: Number of the first tick after this state, from 0.
    tick: int
    #: Node positions, m: (nodes, 3).
    x: Floats
    #: Node velocities, m/s: (nodes, 3).
    v: Floats
    #: Position of the tip, m: (3,).
    tip: Floats
    #: Result of the renderer's last tick; free before the first.
    last: Rendered


class Moved(NamedTuple):
    """Nodes that a model moves itself."""

    #: Node indices: (count,).
    nodes: ArrayLike
    #: Positions, m: (count, 3).
    x: ArrayLike
    #: Velocities, m/s: (count, 3).
    v: ArrayLike


class RendererModel(Protocol):
    """A model that ``Renderer.build`` returns: any object with ``tick``. Two more methods are optional.

    ``moved(self)`` returns the nodes that the last tick has moved, as ``Moved`` or ``(nodes, x, v)``; the set may change
    only with a new model. Without it, the opposite of the force moves the network at the contact point.

    ``take_over(self, old)`` is called once before the first tick, with the model that rendered until then, or ``None``.
    """

    def tick(self, before: Floats, tip: Floats) -> Union[Rendered, ArrayLike, Tuple[Any, ...], None]:
        """Renders one tick, in which the tip moves from ``before`` to ``tip``, m.

        Returns ``Rendered``, or ``(force, mode, triangle, weights, normal)``, or the force on the instrument alone, N,
        or ``None`` for a free tip. A force alone is rendered, but acts nowhere on the network.
        """


class Renderer:
    """A renderer in place of a scene's local model, contact scheme and contact law. It runs in lockstep.

    ``create`` is called once, ``build`` at every hand-over; the model that it returns renders the ticks until the next.
    Equal states have to give models that render the same forces to the bit. An exception ends the run, and ``run`` raises
    it again.

    A spring of 200 N/m on a rigid half-space below z = 0:

    >>> import stickslip
    >>> class Floor(stickslip.Renderer):
    ...     def build(self, state):
    ...         return self
    ...     def tick(self, before, tip):
    ...         return [0.0, 0.0, max(0.0, -200.0 * tip[2])]
    >>> result = stickslip.run(stickslip.Scene.shipped("fig3-sliding"), renderer=Floor())  # pressed in by 3 mm
    >>> round(float(result.trace["fz"].max()), 12)
    0.6
    """

    body: Body
    setup: Setup

    def create(self, body: Body, setup: Setup) -> None:
        """Prepares for a body. An exception refuses it. By default body and setup are kept as attributes."""
        self.body, self.setup = body, setup

    def build(self, state: State) -> RendererModel:
        """Builds a model from the network's state at a hand-over."""
        raise NotImplementedError(f"{type(self).__name__} does not define build")


class Instrument:
    """An instrument in place of the scene's: it moves the tip under the commanded force. An exception ends the run, and
    ``run`` raises it again.

    A mass of 50 g that falls onto the body:

    >>> import numpy as np, stickslip
    >>> class Falling(stickslip.Instrument):
    ...     def start(self):
    ...         self.x, self.v, self.force = np.array([0.0, 0.0, 0.001]), np.zeros(3), np.zeros(3)
    ...         return self.x
    ...     def sense(self, begin_s, end_s, contact_force):
    ...         h = end_s - begin_s
    ...         self.v = self.v + (self.force / 0.05 - [0.0, 0.0, 9.81]) * h
    ...         self.x = self.x + self.v * h
    ...         return self.x
    ...     def command(self, contact_force):
    ...         self.force = contact_force
    ...         return contact_force
    ...     def release(self):
    ...         self.force = np.zeros(3)
    >>> scene = stickslip.Scene.shipped("fig3-sliding-subdivision")
    >>> lowest = stickslip.run(scene, instrument=Falling()).trace["qz"].min()
    >>> bool(-0.02 < lowest < -0.001)  # it is caught
    True
    """

    def start(self) -> ArrayLike:
        """Returns the tip that contact sees at t = 0, m. It may be called more than once."""
        raise NotImplementedError(f"{type(self).__name__} does not define start")

    def sense(self, begin_s: float, end_s: float, contact_force: Floats) -> ArrayLike:
        """Moves the instrument from one time to another, s, under the force commanded last. ``contact_force`` is that of
        the last computed tick, N. Returns the tip at the end, m."""
        raise NotImplementedError(f"{type(self).__name__} does not define sense")

    def tip_velocity(self) -> Optional[ArrayLike]:
        """Returns the estimate of the tip's velocity after the last ``sense``, m/s. With ``None``, contact derives it from
        the tip's displacement."""
        return None

    def command(self, contact_force: Floats) -> ArrayLike:
        """Takes the contact force, N. Returns the commanded force, N; by default the same."""
        return contact_force

    def release(self) -> None:
        """Commands zero force, after a missed deadline or a fault."""


def vector(value: Any, what: str) -> Tuple[float, float, float]:
    """Three numbers as a tuple of floats."""
    array = np.asarray(value, dtype=np.float64)
    if array.shape != (3,):
        raise ValueError(f"{what} needs three numbers, and has the shape {array.shape}")
    x, y, z = array.tolist()
    return (x, y, z)

