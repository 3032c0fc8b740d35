"""One local tick of the velocity scheme: the constraint is put on the velocity at the tick's end and follows the tip."""

from dataclasses import replace

import numpy as np

from . import integrators
from .tick import FREE, RIGID_BELOW, Contact, Result, State, free_support, friction_bound, locate, push, rigid_tick


def advance(model, surface, options, state, q0, q1, h, elapsed):
    """One tick, as `tick.advance`: without a rewind, and with n and p at the positions that the tick starts from."""
    step = linear_step(model, h)
    predicted = predict(model, step, state, h, elapsed)
    hit = locate(surface, state, predicted, q0, q1)
    if hit is None:
        return predicted, FREE
    _, point = hit
    normal = surface.normal(point, state.x)
    nodes, weights = free_support(model, surface, point)
    if weights.sum() < RIGID_BELOW:
        return rigid_tick(surface, options, predicted, point, normal, state.x, q0, q1, h)

    r = (q1 - surface.position(point, state.x)) / h - weights @ predicted.v[nodes]
    response = Response(model, step, nodes, weights, h)
    G = response.G
    pull = options.adhesion * h  # the impulse that the contact bears
    if (r @ normal) / (normal @ G @ normal) >= pull:
        return kept_under_tension(predicted, state, point)
    mode, impulse, fell_back = impulse_on_mesh(options, state.contact, pull, G, r, normal)
    if not impulse @ normal < pull:
        return kept_under_tension(predicted, state, point)
    place = q1 - surface.position(point, state.x) + weights @ state.x[nodes]
    after = response.moved(predicted, impulse, place, None if mode == "stick" else normal)
    after.contact = Contact(point, mode)
    return after, Result(mode, -impulse / h, point, normal, state.x, fell_back=fell_back)


class Response:
    """What an impulse on the contact point, spread over the tick, does to the patch; G = W A^-1 W^T is what to its velocity."""

    def __init__(self, model, step, nodes, weights, h):
        self.model, self.step, self.nodes, self.weights = model, step, nodes, weights
        W = np.zeros((3, len(model.patch), 3))
        W[:, np.searchsorted(model.patch, nodes)] = np.eye(3)[:, None, :] * weights[:, None]
        W = W.reshape(3, -1)
        if step is None:  # A = M
            self.by_impulse_v = np.repeat(model.inverse_mass, 3)[:, None] * W.T
            self.by_impulse_x = h * self.by_impulse_v
        else:
            self.by_impulse_v, self.by_impulse_x = step.by_impulse_v @ W.T, step.by_impulse_x @ W.T
        self.G, self.GX = W @ self.by_impulse_v, W @ self.by_impulse_x

    def moved(self, predicted, impulse, place, normal):
        """The state after the impulse, W x at `place` in all directions, or along `normal` if there is one."""
        patch = self.model.patch
        after = State(predicted.x.copy(), predicted.v.copy())
        after.v[patch] += (self.by_impulse_v @ impulse).reshape(-1, 3)
        after.x[patch] += (self.by_impulse_x @ impulse).reshape(-1, 3)
        if self.step is not None:  # the way that is left; none if x advances by h v
            gap, GX = place - self.weights @ after.x[self.nodes], self.GX
            push = np.linalg.solve(GX, gap) if normal is None else normal * (normal @ gap) / (normal @ GX @ normal)
            after.x[patch] += (self.by_impulse_x @ push).reshape(-1, 3)
        return after


def linear_step(model, h):
    """The tick's integrator if it is not the explicit one; built once for a model."""
    if model.integrator == "semi-implicit-euler":
        return None
    if model.step is None:
        model.step = integrators.CLASSES[model.integrator](model, h)
    return model.step


def predict(model, step, state, h, elapsed):
    """The state after a tick without contact."""
    if step is None:
        v = push(model, state.v, model.forces(state.x, state.v, elapsed), h)
        return State(state.x + h * v, v)
    after = State(state.x + h * state.v, state.v.copy())  # the exterior
    x, v = step.predict(state.x, state.v, elapsed)
    after.x[model.patch], after.v[model.patch] = x.reshape(-1, 3), v.reshape(-1, 3)
    return after


def kept_under_tension(predicted, state, point):
    predicted.contact = replace(state.contact or Contact(point), point=point, tension=True)
    return predicted, FREE


def impulse_on_mesh(options, contact, pull, G, r, normal):
    """Mode and impulse that give the contact point the velocity r more, as far as the law allows.

    The contact bears less than `pull` outwards. Third, whether the law had no solution and sliding was solved: sticking
    would pull by that, or slipping push backwards.
    """
    slide = (normal @ r) / (normal @ G @ normal) * normal
    if options.law == "sliding":
        return "slide", slide, False
    impulse = np.linalg.solve(G, r)
    along = impulse @ normal
    if along >= pull:
        return "slide", slide, True
    across = impulse - along * normal
    size = np.linalg.norm(across)
    if options.law == "sticking" or size <= friction_bound(options, contact) * (pull - along):
        return "stick", impulse, False
    friction, direction = options.friction.kinetic, across / size
    amount = (friction * pull * (normal @ G @ direction) - normal @ r) / (normal @ G @ (normal - friction * direction))
    if not amount > -pull:
        return "slide", slide, True
    return "slip", friction * (amount + pull) * direction - amount * normal, False
