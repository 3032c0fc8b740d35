"""One local tick of the velocity scheme: the constraint is put on the velocity at the tick's end and follows the tip."""

from dataclasses import replace

import numpy as np

from .tick import FREE, RIGID_BELOW, Contact, Result, State, free_support, locate, push, rigid_tick


def advance(model, surface, options, state, q0, q1, h, elapsed):
    """One tick, as `tick.advance`: without a rewind, and with n and p at the positions that the tick starts from."""
    v_free = push(model, state.v, model.forces(state.x, state.v, elapsed), h)
    predicted = State(state.x + h * v_free, v_free)
    hit = locate(surface, state, predicted, q0, q1)
    if hit is None:
        return predicted, FREE
    _, point = hit
    normal = surface.normal(point, state.x)
    nodes, weights = free_support(model, surface, point)
    if weights.sum() < RIGID_BELOW:
        return rigid_tick(surface, options, predicted, point, normal, state.x, q0, q1, h)

    W = np.kron(weights, np.eye(3))
    A_inverse = np.repeat(model.network.inverse_mass[nodes], 3)  # A = M
    G = W * A_inverse @ W.T
    r = (q1 - surface.position(point, state.x)) / h - W @ v_free[nodes].ravel()
    if r @ normal >= 0.0:
        predicted.contact = replace(state.contact or Contact(point), point=point, tension=True)
        return predicted, FREE
    mode, impulse = impulse_on_mesh(options, G, r, normal)
    v_new = v_free.copy()
    v_new[nodes] += (A_inverse * (W.T @ impulse)).reshape(-1, 3)
    return (State(state.x + h * v_new, v_new, Contact(point, mode)),
            Result(mode, -impulse / h, point, normal, state.x))


def impulse_on_mesh(options, G, r, normal):
    """Mode and impulse that give the contact point the velocity r more, as far as the law allows; r goes inwards."""
    if options.law == "sliding":
        return "slide", (normal @ r) / (normal @ G @ normal) * normal
    impulse = np.linalg.solve(G, r)
    along = (impulse @ normal) * normal
    across = impulse - along
    size = np.linalg.norm(across)
    if options.law == "sticking" or size <= options.friction * np.linalg.norm(along):
        return "stick", impulse
    # G is a multiple of I when A = M, so the size below is positive and the impulse goes inwards.
    direction = options.friction * across / size - normal
    return "slip", (normal @ r) / (normal @ G @ direction) * direction
