"""One local tick of the hybrid geometric scheme (5)-(28): predict, detect, deform, force, law, advance."""

from dataclasses import dataclass, replace

import numpy as np

from . import operators
from .surface import Point

RIGID_BELOW = 0.5  # a contact whose free nodes carry less weight than this is rigid


@dataclass(frozen=True)
class Contact:
    """A contact between ticks. `mode` is that of its last tick; under `tension` it exerts no force but is not lost.

    The rest is the massless scheme's, of the last tick: normal force, speed of the tip over the free surface, and the
    kinetic energy of the contact point along what was held.
    """

    point: Point
    mode: str = "stick"
    tension: bool = False
    normal_force: float = 0.0
    u: np.ndarray | None = None
    kinetic: float = 0.0


@dataclass
class State:
    """Positions and velocities of all nodes (n, 3) as the local model holds them, and the contact."""

    x: np.ndarray
    v: np.ndarray
    contact: Contact | None = None


@dataclass(frozen=True)
class Result:
    """What a tick reports. `point`, `normal` and `at` (the positions the point was located on) are None when free."""

    mode: str
    force: np.ndarray
    point: Point | None = None
    normal: np.ndarray | None = None
    at: np.ndarray | None = None
    rigid: bool = False
    fell_back: bool = False  # the law had no solution and was solved as sliding
    contact_kinetic: float = 0.0  # J, of the directions held (massless)
    exchanged: tuple = ()  # J: changes of that energy by capture, release, mode, weights or normal (massless)


FREE = Result("free", np.zeros(3))


def advance(model, surface, options, state, q0, q1, h, elapsed):
    """One tick from `state` while the tip goes from q0 to q1; `elapsed` is the time since the model's x0.

    Returns the new state and the Result. `options` is the scene's [contact].
    """
    # 1. Predict (11).
    v_free = push(model, state.v, model.forces(state.x, state.v, elapsed), h)
    x_free = state.x + h * v_free
    predicted = State(x_free, v_free)

    # 2. Detect, and locate the contact.
    hit = locate(surface, state, predicted, q0, q1)
    if hit is None:
        return predicted, FREE
    tau, point = hit
    x = state.x + tau * h * v_free
    v = state.v + tau * (v_free - state.v)
    rest, elapsed = (1.0 - tau) * h, elapsed + tau * h
    normal = surface.normal(point, x)
    nodes, weights = free_support(model, surface, point)

    if weights.sum() < RIGID_BELOW:
        return rigid_tick(surface, options, predicted, point, normal, x, q0, q1, h)

    # 3. Deform.
    d = q1 - surface.position(point, x)
    if options.law == "sliding":
        d = (d @ normal) * normal
    deformed = x.copy()
    if options.deformation == "rigid":
        deformed[nodes] += d / weights.sum()
    else:
        deformed[nodes] += np.outer(weights, d) / (weights @ weights)

    # 4. Force (14), (22).
    f = model.forces(deformed, v, elapsed)
    place = np.searchsorted(model.patch, nodes)
    mass = model.network.mass[nodes] if options.metric == "mass" else None
    # T is the identity outside the support (8), so its operators are built on the support alone.
    ops = operators.literal(len(nodes), np.arange(len(nodes)), weights, normal, mass)
    multiplier = operators.contact_force(ops.Qt if options.law == "sliding" else ops.Pt, weights, f[place])
    normal_force = multiplier @ normal
    if normal_force <= -options.adhesion:
        predicted.contact = replace(state.contact or Contact(point), point=point, tension=True)
        return predicted, FREE

    # 5. Law.
    tangential = multiplier - normal_force * normal
    tangential_force = np.linalg.norm(tangential)
    bearing = normal_force + options.adhesion  # what friction is proportional to
    if options.law == "sliding":
        mode, force, constraint = "slide", multiplier, ops.Q
    elif options.law == "sticking" or tangential_force <= friction_bound(options, state.contact) * bearing:
        mode, force, constraint = "stick", multiplier, ops.P
    else:
        mode, constraint = "slip", ops.Q
        force = normal_force * normal + options.friction.kinetic * bearing * tangential / tangential_force
        f = f.copy()
        f[place] -= friction_forces(ops, f[place], normal, options.friction.kinetic, options.adhesion * weights)
    v_new = push(model, v, f, rest)
    v_new[nodes] = (constraint @ v_new[nodes].ravel()).reshape(-1, 3)

    # 6. Advance.
    advanced = State(deformed + rest * v_new, v_new, Contact(point, mode))
    return advanced, Result(mode, force, point, normal, x)


def locate(surface, state, predicted, q0, q1):
    """Step 2 of either scheme: (share of the tick before a collision, contact point), or None for a free tick."""
    contact = state.contact
    if contact is None:
        return surface.collide(q0, q1, state.x, predicted.x)
    if contact.tension:
        point = None if surface.outside(q1, predicted.x) else surface.nearest(q0, state.x)
    elif contact.mode == "stick":
        point = contact.point
    else:
        point = surface.follow(q1 if contact.mode == "slide" else q0, contact.point, state.x)
    return None if point is None else (0.0, point)


def free_support(model, surface, point):
    """The nodes of a point's support that move, and their weights: the columns of W that are not zero."""
    nodes, weights = surface.support(point)
    free = model.moves[nodes]
    return nodes[free], weights[free]


def push(model, v, f, h):
    """v + h M^-1 f on the patch; the exterior keeps its velocity."""
    moved = v.copy()
    moved[model.patch] += h * model.inverse_mass * f
    return moved


def friction_bound(options, contact):
    """The coefficient up to which a contact sticks: the kinetic one if it slipped in the last tick."""
    starts = contact is None or contact.tension or contact.mode == "stick"
    return options.friction.static if starts else options.friction.kinetic


def friction_forces(ops, f, normal, friction, adhesion):
    """Node forces of frictional sliding (23)-(24), from the components of the constraint forces P~ f.

    `adhesion` is each node's share of the contact's, which adds to the normal force that friction is proportional to.
    """
    constraint = (ops.Pt @ f.ravel()).reshape(-1, 3)
    normal_forces = constraint @ normal
    along = normal_forces[:, None] * normal
    across = constraint - along
    length = np.linalg.norm(across, axis=1)[:, None]
    direction = np.divide(across, length, out=np.zeros_like(across), where=length > 0.0)
    return along + friction * np.abs(normal_forces + adhesion)[:, None] * direction


def rigid_tick(surface, options, predicted, point, normal, x, q0, q1, h):
    """Contact with nodes that do not move: a wall of given stiffness and damping; the mesh moves freely."""
    if surface.outside(q1, predicted.x):
        return predicted, FREE
    depth = (surface.position(point, x) - q1) @ normal
    speed = (q1 - q0) @ normal / h
    magnitude = max(0.0, options.wall_stiffness * depth - options.wall_damping * speed)
    predicted.contact = Contact(point, "slide")
    return predicted, Result("slide", magnitude * normal, point, normal, x, rigid=True)
