"""One local tick of the massless scheme: the contact point follows the tip, and the instrument feels the internal forces
without the inertia of the contact point.

The mesh moves as under the velocity scheme. The forces at the tick's end give the force on the instrument, and decide
whether the contact is under tension, sticks or slips.
"""

from dataclasses import dataclass, replace

import numpy as np

from .tick import FREE, RIGID_BELOW, Contact, Result, State, free_support, locate, rigid_tick
from .velocity import Response, linear_step, predict


@dataclass(frozen=True)
class Hold:
    """Directions in which the contact point follows the tip in a tick: all of them, or only the normal."""

    everything: bool
    impulse: np.ndarray  # on the mesh, N s
    stops: float = np.inf  # the friction that stops the slip within the tick, N; the instrument feels no more


def advance(model, surface, options, state, q0, q1, h, elapsed, tip_velocity=None):
    """One tick, with the arguments of `velocity.advance`. An instrument that estimates the tip's velocity at the tick's end
    gives it as `tip_velocity`, m/s; otherwise it follows from the displacement of the contact point. `Result` has the
    kinetic energy of the contact point along the held directions, and its changes that no work explains, J.
    """
    step = linear_step(model, h)
    predicted = predict(model, step, state, h, elapsed)
    before = state.contact.kinetic if state.contact else 0.0
    let_go = (before,) if state.contact else ()
    hit = locate(surface, state, predicted, q0, q1)
    if hit is None:
        return predicted, replace(FREE, exchanged=let_go)
    _, point = hit
    normal = surface.normal(point, state.x)
    nodes, weights = free_support(model, surface, point)
    if weights.sum() < RIGID_BELOW:
        after, report = rigid_tick(surface, options, predicted, point, normal, state.x, q0, q1, h)
        return after, replace(report, exchanged=let_go)

    # The contact point follows the tip along the held directions.
    response = Response(model, step, nodes, weights, h)
    drift = weights @ predicted.v[nodes]
    r = (q1 - surface.position(point, state.x)) / h - drift
    u = across((q1 - q0) / h - drift, normal)
    hold = choose(options, state.contact, response.G, r, u, normal, h)
    place = q1 - surface.position(point, state.x) + weights @ state.x[nodes]
    after = response.moved(predicted, hold.impulse, place, None if hold.everything else normal)

    inverse_mass = model.network.inverse_mass[nodes]
    size = weights**2 @ inverse_mass
    if tip_velocity is not None:
        change = tip_velocity - weights @ after.v[nodes]
        change = change if hold.everything else (change @ normal) * normal
        after.v[nodes] += np.outer(weights * inverse_mass, change) / size

    # What the forces at the tick's end put on the contact point.
    forces = model.forces(after.x, after.v, elapsed + h)[np.searchsorted(model.patch, nodes)]
    multiplier = (weights * inverse_mass) @ forces / size

    def kinetic(v):
        held = weights @ v[nodes]
        return 0.5 * (held @ held if hold.everything else (held @ normal) ** 2) / size

    exchanged = (before - kinetic(state.v),)
    mode, force = felt(options, hold, multiplier, u, normal)
    if mode == "tension":
        after.contact = Contact(point, tension=True)
        return after, replace(FREE, exchanged=(*exchanged, kinetic(after.v)))
    # A contact of the sticking law that slides is located like one that slips: nearest to where the tip was.
    kept = "slip" if options.law == "sticking" and mode == "slide" else mode
    after.contact = Contact(point, kept, normal_force=multiplier @ normal, u=u, kinetic=kinetic(after.v))
    return after, Result(mode, force, point, normal, state.x, contact_kinetic=after.contact.kinetic, exchanged=exchanged)


def across(vector, normal):
    return vector - (vector @ normal) * normal


def choose(options, contact, G, r, u, normal, h):
    """The Hold of a tick, chosen before the forces at its end are known."""
    everything = Hold(True, np.linalg.solve(G, r))
    sliding = Hold(False, (normal @ r) / (normal @ G @ normal) * normal)
    if options.law == "sliding":
        return sliding
    # A contact that was rigid has no force and no slip to remember either.
    taken_again = contact is not None and (contact.tension or (contact.mode != "stick" and contact.u is None))
    if options.law == "sticking":
        slides = contact is not None and (taken_again or (contact.mode == "slip" and not u @ contact.u <= 0.0))
        return sliding if slides else everything
    if contact is None or (contact.mode == "stick" and not contact.tension):
        return everything
    # Slip, with the friction of the tick before, but no more than stops it.
    stops = across(np.linalg.solve(G, (normal @ r) * normal + u), normal)
    needed = np.linalg.norm(stops)
    friction = h * options.friction.kinetic * ((0.0 if taken_again else contact.normal_force) + options.adhesion)
    speed = np.linalg.norm(u)
    if needed <= friction:
        if not taken_again:
            return everything
        tangential = stops
    else:
        tangential = friction * u / speed if speed > 0.0 else np.zeros(3)
    along = normal * (normal @ (r - G @ tangential)) / (normal @ G @ normal)
    return Hold(False, along + tangential, needed / h)


def felt(options, hold, multiplier, u, normal):
    """Mode and force on the instrument, N, from the forces at the tick's end; mode "tension" where F_N <= -A."""
    normal_force, tangential = multiplier @ normal, across(multiplier, normal)
    if normal_force <= -options.adhesion:
        return "tension", np.zeros(3)
    if options.law != "stick-slip":
        return ("stick", multiplier) if hold.everything else ("slide", normal_force * normal)
    bearing = normal_force + options.adhesion
    if not hold.everything:
        speed = np.linalg.norm(u)
        against = -u / speed if speed > 0.0 else np.zeros(3)
        return "slip", normal_force * normal + np.minimum(options.friction.kinetic * bearing, hold.stops) * against
    size = np.linalg.norm(tangential)
    if size <= options.friction.static * bearing:
        return "stick", multiplier
    return "slip", normal_force * normal + options.friction.kinetic * bearing * tangential / size
