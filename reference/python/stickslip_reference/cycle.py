"""The multi-rate run: local ticks, and at every cycle boundary the global network, a new local model and the hand-over."""

from dataclasses import dataclass, field

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from . import instrument as instruments
from . import equilibrium, local_model, massless, operators, spread, velocity
from . import network as net
from .phantom import WorkspaceError
from .scene import SceneError
from .tick import RIGID_BELOW, Contact, State, advance

ON_SURFACE = 1e-12  # m: a tip that is no further inside is on the surface to round-off
RUNAWAY_DIAGONALS = 10.0  # a node this many bounding-box diagonals from its rest place has run away


@dataclass
class Row:
    """One line of the trace, and what comparisons need besides.

    `force` is what was commanded, `result.force` the contact's own; `device` holds further columns of the instrument.
    """

    q: np.ndarray
    force: np.ndarray
    result: object
    energies: tuple
    work: float
    model_age: int
    device: dict


@dataclass
class Run:
    """Rows of a run; `fault` says why it ended early, at the tick after the last row.

    `inside_without_contact` counts the ticks that end with the tip inside and no contact kept. It must stay zero.
    """

    h: float
    massless: bool = False
    rows: list = field(default_factory=list)
    inside_without_contact: int = 0
    fault: str | None = None


@dataclass(frozen=True)
class Recorded:
    """One tick of the patch then in use, for the replay: states at its start and its end."""

    patch: np.ndarray
    x: tuple
    v: tuple

    def at(self, share):
        """Positions and velocities at a share of the tick, linear between its ends."""
        return tuple((1.0 - share) * start + share * end for start, end in (self.x, self.v))


def run(scene, network):
    """Run a scene on a network, lockstep in virtual time."""
    surface = spread.surface(scene["contact"], network)
    instrument = instruments.build(scene)
    smoothing = instruments.Smoothing(scene["instrument"].smoothing_ticks)
    start = equilibrium.settle(network) if scene.settle else network.nodes.copy()
    if not surface.outside(instrument.tip, start):
        raise SceneError("the tip is inside the surface at t = 0")
    full = scene["local"].model == "full"
    state = State(start, np.zeros_like(start))
    shared = GlobalNetwork(scene, network, surface, start)
    pending, model, work, age = None, None, 0.0, 0
    if full:
        model = local_model.FullModel(network)
    step = {"geometric": advance, "velocity": velocity.advance, "massless": massless.advance}[scene["contact"].scheme]
    result = Run(scene.h, scene["contact"].scheme == "massless")
    for tick in range(scene.ticks):
        q0, handed_over = instrument.tip, False
        if not full and tick % scene.cycle_ticks == 0:
            if tick > 0:
                shared.advance_cycle(state, model)
            pending = shared.linearise(state, tick, q0)
        if pending and (tick - pending.tick == scene["sync"].latency_ticks or model is None):
            handed_over = model is not None
            state, model, pending, age = hand_over(state, model, pending, tick, scene.h), pending, None, 0
            if handed_over:
                state.contact = state.contact or swallowed(surface, q0, state.x)
        try:
            instrument.move(tick)
        except WorkspaceError as error:
            result.fault = str(error)
            break
        q1, before = instrument.tip, state
        state, report = step(model, surface, scene["contact"], state, q0, q1, scene.h, (tick - model.tick) * scene.h,
                             **({"tip_velocity": instrument.velocity} if result.massless else {}))
        result.fault = fault_in(network, state, report.force, scene.force_limit)
        if result.fault:
            break
        force = instrument.command(smoothing.smoothed(report.force, handed_over))
        if not np.isfinite(force).all():
            result.fault = "the force commanded is not finite"
            break
        shared.record(model.patch, before, state)
        work -= report.force @ (q1 - q0)
        result.inside_without_contact += state.contact is None and swallowed(surface, q1, state.x) is not None
        energies = model.energies(state.x, state.v)
        result.rows.append(Row(q1, force, report, energies, work, age, instrument.state()))
        age += 0 if full else 1
    return result


def hand_over(state, old, new, tick, h):
    """Nodes of both patches go on from the local model; all others start where the new model has them."""
    elapsed = (tick - new.tick) * h
    x = np.where(new.moves[:, None], new.x0, new.x0 + elapsed * new.v0)
    v = new.v0.copy()
    if old is not None:
        stays = old.moves & new.moves
        x[stays], v[stays] = state.x[stays], state.v[stays]
    return State(x, v, state.contact)


def swallowed(surface, tip, x):
    """A contact for a free tip that the new exterior covers: no motion within a tick would ever show it to collision."""
    distance, point = surface.signed_distance(tip, x)
    return Contact(point, tension=True) if distance < -ON_SURFACE else None


def fault_in(network, state, force, force_limit):
    """Why the run must end, or None. Written so that a NaN is a fault."""
    if not np.isfinite(force).all():
        return "the force is not finite"
    if not np.linalg.norm(force) <= force_limit:
        return f"a force of {np.linalg.norm(force):.4g} N"
    if not (np.isfinite(state.x).all() and np.isfinite(state.v).all()):
        return "the state is not finite"
    distance = np.linalg.norm(state.x - network.nodes, axis=1).max()
    if not distance <= RUNAWAY_DIAGONALS * network.diagonal:
        return f"a node is {distance:.3g} m from its rest place"
    return None


class GlobalNetwork:
    """The whole network, integrated over the cycle just past at every boundary."""

    def __init__(self, scene, network, surface, start=None):
        self.scene, self.network, self.surface = scene, network, surface
        self.x = (network.nodes if start is None else start).copy()
        self.v = np.zeros_like(self.x)
        self.ticks = []
        self.contact = None  # at the boundary before

    def record(self, patch, before, after):
        if self.scene["local"].model == "patch":
            self.ticks.append(Recorded(patch, (before.x[patch], after.x[patch]), (before.v[patch], after.v[patch])))

    def linearise(self, state, tick, tip):
        """A local model from the state now, around the contact point, or the tip when there is none."""
        self.contact = state.contact
        anchor, nodes = tip, ()
        if state.contact is not None:
            anchor = self.surface.position(state.contact.point, self.x)
            nodes, _ = self.surface.support(state.contact.point)
        return local_model.build(self.network, self.scene["local"], self.x.copy(), self.v, tick, anchor, nodes)

    def advance_cycle(self, state, model):
        """Bring the network to the present boundary, and take the patch's state from the local model."""
        count = self.scene["global"].substeps
        step = self.scene.cycle_ticks * self.scene.h / count
        replay = self.scene["sync"].mode == "replay"
        project = None if replay else self.contact_projection()
        self.v = project(self.v) if project else self.v
        for number in range(count):
            def prescribe(share, start=number):
                return self.patch_at((start + share) / count, from_left=share > 0.0)
            integrate(self.network, self, step, self.scene["global"].integrator, prescribe if replay else None, project)
        self.x[model.patch], self.v[model.patch] = state.x[model.patch], state.v[model.patch]
        self.ticks = []

    def patch_at(self, share, from_left):
        """Patch nodes and their recorded state at a share of the cycle; at a tick's end, of that tick if `from_left`."""
        position = share * len(self.ticks)
        whole = round(position)
        if abs(position - whole) <= 1e-9:
            position = float(whole)
        number = int(np.ceil(position)) - 1 if from_left else int(np.floor(position))
        tick = self.ticks[number]
        return (tick.patch, *tick.at(position - number))

    def contact_projection(self):
        """P (10) at the contact of the boundary before, as a function on velocities; None if nothing pressed then."""
        contact = self.contact
        if contact is None or contact.tension:
            return None
        support, weights = self.surface.support(contact.point)
        free = ~self.network.fixed[support]
        nodes, weights = support[free], weights[free]
        if weights.sum() < RIGID_BELOW:
            return None
        contact = self.scene["contact"]
        mass = self.network.mass[nodes] if contact.metric == "mass" else None
        P = operators.literal(len(nodes), np.arange(len(nodes)), weights, np.array([0.0, 0.0, 1.0]), mass).P

        def project(v):
            projected = v.copy()
            projected[nodes] = (P @ v[nodes].ravel()).reshape(-1, 3)
            return projected
        return project


def integrate(network, state, step, integrator, prescribe=None, project=None):
    """One step of the network, in place on state.x and state.v.

    `prescribe(share)` gives nodes, positions and velocities that are imposed at a share of the step; `project` keeps
    velocities and accelerations in the constraint.
    """
    def hold(x, v, share):
        if prescribe is None:
            return x, v
        nodes, place, speed = prescribe(share)
        x, v = x.copy(), v.copy()
        x[nodes], v[nodes] = place, speed
        return x, v

    def acceleration(x, v):
        a = network.inverse_mass[:, None] * net.forces(network, x, v)
        return project(a) if project else a

    x, v = hold(state.x, state.v, 0.0)
    if integrator == "semi-implicit-euler":  # (11)
        v_new = v + step * acceleration(x, v)
        x_new = x + step * v_new
    elif integrator == "implicit-euler":
        x_new, v_new = implicit_euler(network, x, v, step, prescribe(1.0) if prescribe else None, project)
    else:
        def slope(share, dx, dv):
            xs, vs = hold(x + share * step * dx, v + share * step * dv, share)
            return vs, acceleration(xs, vs)
        k1 = slope(0.0, 0.0, 0.0)
        k2 = slope(0.5, *k1)
        k3 = slope(0.5, *k2)
        k4 = slope(1.0, *k3)
        x_new, v_new = (start + step / 6.0 * (a + 2.0 * b + 2.0 * c + d)
                        for start, a, b, c, d in zip((x, v), k1, k2, k3, k4))
    state.x, state.v = hold(x_new, v_new, 1.0)


def implicit_euler(network, x0, v0, h, imposed, project):
    """v = v0 + h a(x0 + h v, v), x = x0 + h v, by Newton's method until rounding stops it.

    Imposed nodes are where they will be at the end of the step. Under a projection P both v0 and a(x, v) are projected.
    """
    x, v = x0.copy(), v0.copy()
    moves = ~network.fixed
    if imposed:
        nodes, place, speed = imposed
        x[nodes], v[nodes] = place, speed
        moves[nodes] = False
    free = local_model.components(np.flatnonzero(moves))
    P = projection_matrix(project, len(x)) if project else None

    def residual(v):
        x[moves] = x0[moves] + h * v[moves]
        a = network.inverse_mass[:, None] * net.forces(network, x, v)
        return (v - v0 - h * (project(a) if project else a)).ravel()[free]

    error, size = residual(v), np.inf
    for _ in range(100):
        K, D = net.jacobians(network, x, v)
        J = sparse.diags(np.repeat(h * network.inverse_mass, 3)) @ (D + h * K)
        J = (P @ J.toarray() if project else J)[free][:, free]
        update = (np.linalg.solve(np.eye(len(free)) - J, error) if project
                  else splu(sparse.csc_matrix(sparse.identity(len(free)) - J)).solve(error))
        share, before = 1.0, np.linalg.norm(error)
        start = v.ravel()[free]
        while True:
            v.reshape(-1)[free] = start - share * update
            error = residual(v)
            if np.linalg.norm(error) < before or share < 1e-3:
                break
            share /= 2.0
        last, size = size, np.abs(update).max(initial=0.0)
        if size <= 1e-9 * np.abs(v).max() + 1e-14 * np.abs(x).max() / h or (size < 1e-6 and size >= last):
            return x, v
    raise FloatingPointError("Newton's method does not converge")


def projection_matrix(project, n):
    columns = [project(column.reshape(n, 3)).ravel() for column in np.eye(3 * n)]
    return np.array(columns).T
