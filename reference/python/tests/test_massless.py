"""The massless scheme: what its mesh does, what the instrument feels, and its energy balance."""

from types import SimpleNamespace

import numpy as np
import pytest

from setups import plate, plate_scene, scene
from stickslip_reference import cycle, massless, trace
from stickslip_reference import network as net
from stickslip_reference.scene import Friction
from stickslip_reference.tick import Contact

LAWS = ("sliding", "sticking", "stick-slip")
STATIC, KINETIC = 0.6, 0.3
# The contact point against the tip, m; positions of centimetres. Measured: 1.4e-17 explicit, 2.1e-17 implicit.
PLACE_TOLERANCE = 1e-15
# Its speed along n, m/s: places over a tick of 1 ms.
SPEED_TOLERANCE = 1e-12
# F_T over mu_k (F_N + A) at slip, less 1. Measured: 2.1e-15.
CONE_TOLERANCE = 1e-12
# Forces by two formulas, of the largest. Measured: 2.5e-14.
FORCE_TOLERANCE = 1e-11
# A plate's forces: its springs are linear to about travel over length, 1e-6. Measured: 7.1e-8.
PLATE_TOLERANCE = 2e-6

WAYPOINTS = [[0.0, -0.01, 0.0013, 0.00051], [0.05, -0.01, 0.0013, -0.003], [0.2, 0.006, 0.003, -0.003]]
LIFTED = [*WAYPOINTS, [0.22, 0.006, 0.003, -0.0005], [0.26, 0.004, 0.003, -0.003], [0.3, 0.0, 0.003, -0.002]]
UNEQUAL = np.random.default_rng(6).uniform(0.005, 0.02, 180)


def followed(read, network):
    """A run, and what every tick began and ended with."""
    ticks = []
    original = massless.advance

    def watched(model, surface, options, state, q0, q1, h, elapsed, tip_velocity):
        after, report = original(model, surface, options, state, q0, q1, h, elapsed, tip_velocity)
        ticks.append(SimpleNamespace(model=model, surface=surface, before=state, after=after, report=report, q0=q0, q1=q1,
                                     elapsed=elapsed, tip_velocity=tip_velocity))
        return after, report

    massless.advance = watched
    try:
        result = cycle.run(read, network)
    finally:
        massless.advance = original
    assert result.fault is None and result.inside_without_contact == 0
    return result, ticks


def drag(law, surface="subdivision", rate=1000.0, path=np.array(WAYPOINTS), local=None, contact=None, **sections):
    sections = {"mesh": {"nodes": [6, 6, 5]}, "material": {"node_mass": UNEQUAL.tolist()}} | sections
    friction = {"friction": {"static": STATIC, "kinetic": KINETIC}} if law == "stick-slip" else {}
    read = scene(law, duration=float(path[-1][0]), instrument={"waypoints": np.array(path).tolist()},
                 local={"rate": rate} | ({"model": "full"} if local is None else local),
                 contact={"surface": surface, "scheme": "massless"} | friction | (contact or {}), **sections)
    network = net.block(read)
    return read, network, *followed(read, network)


def held(tick):
    """Whether the contact point was held in all directions: at the tick's end it is then at the tip."""
    return np.abs(tick.surface.position(tick.report.point, tick.after.x) - tick.q1).max() <= PLACE_TOLERANCE


LINEAR = [{"integrator": name} for name in ("implicit-euler", "implicit-midpoint", "exponential")]


@pytest.mark.parametrize("local", [None, {}, {"exterior": "drifting"}, {"exterior": "condensed"}, {"linearization": "none"},
                                   *LINEAR], ids=str)
@pytest.mark.parametrize("law", LAWS)
def test_the_mesh_follows_the_tip_and_the_force_is_that_of_the_springs(within, law, local):
    """The multiplier by least squares in the norm of M^-1, of forces that are computed again at the tick's end."""
    read, network, _, ticks = drag(law, "subdivision" if local in (None, {"exterior": "condensed"}) else "faceted", local=local, path=LIFTED)
    seen = set()
    largest = max(np.linalg.norm(tick.report.force) for tick in ticks)
    for tick in ticks:
        if tick.report.mode == "free":
            continue
        seen.add(tick.report.mode)
        n = tick.report.normal
        # The drift of an exterior does not enter, as under the velocity scheme: nodes outside the patch as the tick began.
        reached = np.where(tick.model.moves[:, None], tick.after.x, tick.before.x)
        left = tick.surface.position(tick.report.point, reached) - tick.q1
        within("contact point against the tip along n, m", abs(left @ n), PLACE_TOLERANCE)
        if tick.report.mode == "stick":
            within("sticking point against the tip, m", np.abs(left).max(), PLACE_TOLERANCE)
        nodes, weights = tick.surface.support(tick.report.point)
        free = tick.model.moves[nodes]
        nodes, weights = nodes[free], weights[free]
        speed = (tick.q1 - tick.surface.position(tick.report.point, tick.before.x)) / read.h - weights @ tick.after.v[nodes]
        within("contact point's speed against the tip's along n, m/s", abs(speed @ n), SPEED_TOLERANCE)
        f = tick.model.forces(tick.after.x, tick.after.v, tick.elapsed + read.h)[np.searchsorted(tick.model.patch, nodes)]
        root = np.sqrt(network.mass[nodes])
        multiplier = np.linalg.lstsq((weights / root)[:, None], f / root[:, None], rcond=None)[0][0]
        force = tick.report.force
        if tick.report.mode == "stick":
            error = force - multiplier
        else:
            error = (force - multiplier) @ n
        within("force against the springs', of the largest", np.abs(error).max() / largest, FORCE_TOLERANCE)
    assert seen - {"slide"} == {"sliding": set(), "sticking": {"stick"}, "stick-slip": {"stick", "slip"}}[law]


@pytest.mark.parametrize("adhesion", [0.0, 0.2])
@pytest.mark.parametrize("surface", ["faceted", "shaded", "subdivision"])
def test_stick_slip_stays_within_its_bounds(within, surface, adhesion):
    """Sticking up to the static coefficient, slipping at the kinetic one, against the tip's way over the mesh."""
    _, _, _, ticks = drag("stick-slip", surface, contact={"adhesion": adhesion}, path=LIFTED)
    modes = [tick.report.mode for tick in ticks]
    assert modes.count("stick") > 10 and modes.count("slip") > 10
    above = 0
    for tick in ticks:
        if tick.report.mode == "free":
            assert not tick.report.force.any()
            continue
        n, force = tick.report.normal, tick.report.force
        bearing, tangential = force @ n + adhesion, force - force @ n * n
        size = np.linalg.norm(tangential)
        assert bearing > 0.0
        if tick.report.mode == "stick":
            assert size <= STATIC * bearing
            above += size > KINETIC * bearing
        elif held(tick):
            within("F_T where it slips from here on, over mu_k (F_N + A), less 1", abs(size / (KINETIC * bearing) - 1.0),
                   CONE_TOLERANCE)
        else:
            u, inertia = slip(tick, 1e-3)
            assert tangential @ u < 0.0
            friction = min(KINETIC * bearing, inertia * np.linalg.norm(u) / 1e-3)
            within("F_T at slip over mu_k (F_N + A) or what stops u, less 1", abs(size / friction - 1.0), CONE_TOLERANCE)
    assert above > 0


def slip(tick, h):
    """The tip's velocity over the mesh without friction, m/s, and the mass of the contact point, kg."""
    nodes, weights = tick.surface.support(tick.report.point)
    nodes, weights = nodes[tick.model.moves[nodes]], weights[tick.model.moves[nodes]]
    v = tick.before.v.copy()
    v[tick.model.patch] += h * tick.model.inverse_mass * tick.model.forces(tick.before.x, tick.before.v, tick.elapsed)
    u = (tick.q1 - tick.q0) / h - weights @ v[nodes]
    return u - u @ tick.report.normal * tick.report.normal, 1.0 / (weights**2 @ tick.model.network.inverse_mass[nodes])


@pytest.mark.parametrize("speed", [1e-16, 1e-4, 1.0])
def test_friction_is_felt_up_to_what_stops_the_slip(within, speed):
    """After a tick without force: a slip that is round-off is felt as round-off, whatever the normal force has become."""
    h, mass, N, n = 1e-3, 0.02, 0.5, np.array([0.0, 0.0, 1.0])
    options = SimpleNamespace(law="stick-slip", friction=Friction(STATIC, KINETIC), adhesion=0.0)
    u = np.array([speed, 0.0, 0.0])
    contact = Contact(None, "slip", normal_force=0.0, u=u)
    hold = massless.choose(options, contact, np.eye(3) / mass, u - 0.1 * n, u, n, h)
    mode, force = massless.felt(options, hold, N * n, u, n)
    assert mode == "slip" and not hold.everything and hold.impulse[0] == 0.0
    friction = min(KINETIC * N, mass * speed / h)
    within("friction against what stops the slip", np.abs(force - [-friction, 0.0, N]).max() / friction, CONE_TOLERANCE)


@pytest.mark.parametrize("rate", [1000.0, 8000.0])
def test_a_plate_is_felt_without_its_mass(within, rate):
    """From the first tick on the force is 3 kz depth + 3 c speed: no impulse m v on contact, at no rate."""
    kz, c, mass, depth = 60.0, 0.4, 0.02, 0.004
    waypoints = [[0.0, 0, 0, 0.00051], [0.1, 0, 0, -depth], [0.2, 0, 0, -depth]]
    read = plate_scene(waypoints, "sticking", rate=rate, scheme="massless")
    columns = trace.table(cycle.run(read, plate(kz, kz, c, mass)))
    contact = np.flatnonzero(columns["mode"] != "free")
    speed = (0.00051 + depth) / 0.1
    # The first tick brings the plate from its rest place to the tip, at the speed that takes.
    first = contact[0]
    within("force at first contact, of the springs'",
           abs(columns["fn"][first] / (3 * (kz + c * rate) * -columns["qz"][first]) - 1.0), PLATE_TOLERANCE)
    assert columns["fn"][first] <= 3 * (kz * -columns["qz"][first] + c * speed)
    pressing = slice(first + 1, round(0.1 * rate))
    expected = 3 * (kz * -columns["qz"][pressing] + c * speed)
    within("force of the press, of the springs'", np.abs(columns["fn"][pressing] / expected - 1.0), PLATE_TOLERANCE)
    resting = slice(round(0.1 * rate) + 1, None)
    within("force at rest, of the springs'", np.abs(columns["fn"][resting] / (3 * kz * depth) - 1.0), PLATE_TOLERANCE)


def slider(rate, static=STATIC, kinetic=KINETIC, c=0.0, speed=0.02, duration=1.2):
    """A plate that is pressed and then dragged along its springs: one mass, one spring, and where it slips."""
    kx, kz, mass, depth = 20.0, 60.0, 0.005, 0.004
    waypoints = [[0.0, 0, 0, 0.00051], [0.05, 0, 0, -depth], [0.1, 0, 0, -depth], [duration, speed * (duration - 0.1), 0, -depth]]
    read = plate_scene(waypoints, rate=rate, scheme="massless", friction={"static": static, "kinetic": kinetic})
    network = plate(kx, kz, c, mass)
    _, ticks = followed(read, network)
    mode = np.array([tick.report.mode for tick in ticks])
    stretch = np.array([tick.after.x[:3, 0].mean() for tick in ticks])
    tip = np.array([tick.q1[0] for tick in ticks])
    slip = mode == "slip"
    starts = np.flatnonzero(slip[1:] & ~slip[:-1]) + 1
    ends = np.flatnonzero(~slip[1:] & slip[:-1]) + 1
    starts = starts[: len(ends)]
    N, k = 3 * kz * depth, 3 * kx
    delta = (static - kinetic) * N / k
    return SimpleNamespace(omega=np.sqrt(kx / mass), delta=delta, speed=speed, starts=starts, ends=ends, stretch=stretch,
                           tip=tip, bound=static * N / k, mode=mode, h=1.0 / rate)


@pytest.mark.parametrize("rate, tolerance", [(1000.0, 0.1), (8000.0, 0.01)])
def test_spring_and_slider(within, rate, tolerance):
    """Slip lasts (2 / w) (pi - arctan(w D / v)), D = (mu_s - mu_k) N / k; the stretch falls by 2 D, the way is 2 D + v T."""
    run = slider(rate)
    assert len(run.ends) >= 2
    lasts = 2.0 / run.omega * (np.pi - np.arctan(run.omega * run.delta / run.speed))
    for start, end in zip(run.starts, run.ends):
        # The last state held, and the last one that slips.
        drop = run.stretch[start - 1] - run.stretch[end - 1]
        time = (end - start) * run.h
        way = (run.tip - run.stretch)[end - 1] - (run.tip - run.stretch)[start - 1]
        within(f"stretch at slip, {rate:.0f} Hz", abs(run.stretch[start - 1] / run.bound - 1.0), tolerance)
        within(f"drop of the stretch over 2 D, {rate:.0f} Hz", abs(drop / (2.0 * run.delta) - 1.0), tolerance)
        within(f"time of the slip, {rate:.0f} Hz", abs(time / lasts - 1.0), tolerance)
        within(f"way of the slip over 2 D + v T, {rate:.0f} Hz", abs(way / (2.0 * run.delta + run.speed * lasts) - 1.0),
               tolerance)


def test_spring_and_slider_against_an_integration_of_one_mass(within):
    """The same by scipy: m x'' = -k x - c x' + mu_k N while v > x', from the bound on, with damping: between D and 2 D."""
    from scipy.integrate import solve_ivp
    kx, kz, mass, depth, c, rate, speed = 20.0, 60.0, 0.005, 0.004, 0.1, 8000.0, 0.02
    run = slider(rate, c=c)
    N = 3 * kz * depth
    # The damper pulls as well while it sticks: it slips where 3 kx x + 3 c v = mu_s N.
    start = (STATIC * N / 3 - c * speed) / kx

    def stops(t, y):
        return speed - y[1] if t > 1e-6 else 1.0
    stops.terminal, stops.direction = True, -1
    slip = solve_ivp(lambda t, y: [y[1], (KINETIC * N / 3 - kx * y[0] - c * y[1]) / mass], (0.0, 1.0), [start, speed],
                     rtol=1e-10, atol=1e-14, events=stops)
    drop, lasts = start - slip.y[0, -1], slip.t[-1]
    assert run.delta < drop < 2.0 * run.delta
    first, end = run.starts[0], run.ends[0]
    within("damped: drop of the stretch", abs((run.stretch[first - 1] - run.stretch[end - 1]) / drop - 1.0), 0.01)
    within("damped: time of the slip", abs((end - first) * run.h / lasts - 1.0), 0.01)


def test_equal_coefficients_do_not_stick_and_slip():
    run = slider(1000.0, static=0.5, kinetic=0.5, c=0.2, duration=0.8)
    slip = run.mode == "slip"
    assert slip[int(slip.argmax()) :].all() and np.ptp(run.stretch[-200:]) <= 1e-3 * run.bound


@pytest.mark.parametrize("surface", ["faceted", "subdivision"])
def test_a_sticking_contact_taken_hold_of_again_slides_until_the_tip_turns(within, surface):
    """Free of friction, along n only, until the tip's speed over the free mesh has no part along that of the tick before."""
    path = [[0.0, -0.015, 0.0013, 0.00051], [0.05, -0.015, 0.0013, -0.003], [0.35, 0.018, 0.0013, -0.003],
            [0.4, 0.0, 0.0013, -0.003]]
    _, _, _, ticks = drag("sticking", surface, path=path)
    again = [k for k, (last, tick) in enumerate(zip(ticks, ticks[1:]), 1)
             if last.after.contact is not None and last.after.contact.tension and tick.report.mode != "free"]
    assert again
    stuck_later = 0
    for k in again:
        assert ticks[k].report.mode == "slide"
        last = None
        while k < len(ticks) and ticks[k].report.mode == "slide":
            tick = ticks[k]
            u, _ = slip(tick, 1e-3)
            # Located nearest to where the tip was, like a contact that slips.
            gap = tick.q0 - tick.surface.position(tick.report.point, tick.before.x)
            across = gap - gap @ tick.report.normal * tick.report.normal
            within("sliding after tension: tip of the start across the normal, m", np.linalg.norm(across), PLACE_TOLERANCE)
            assert last is None or u @ last > 0.0
            force = tick.report.force
            assert np.linalg.norm(force - force @ tick.report.normal * tick.report.normal) <= 1e-12 * np.linalg.norm(force)
            last, k = u, k + 1
        stuck_later += k < len(ticks) and ticks[k].report.mode == "stick"
    assert stuck_later > 0


def dissipated(network, ticks, h):
    """By the dampers, at the mean of the velocities a tick begins and ends with."""
    i, j = network.ends.T
    total = 0.0
    for tick in ticks:
        x, v = (0.5 * (getattr(tick.before, name) + getattr(tick.after, name)) for name in "xv")
        d = x[j] - x[i]
        rate = ((v[j] - v[i]) * d).sum(axis=1) / np.linalg.norm(d, axis=1)
        total += h * (network.damping * rate**2).sum()
    return total


def rubbed(ticks, h):
    """By friction: force on the mesh times the tip's way over it, with the contact point at its mean velocity."""
    total = 0.0
    for tick in ticks:
        if tick.report.mode == "slip" and not held(tick):
            nodes, weights = tick.surface.support(tick.report.point)
            mean = weights @ (0.5 * (tick.before.v + tick.after.v))[nodes]
            across = tick.report.force - tick.report.force @ tick.report.normal * tick.report.normal
            total -= across @ (tick.q1 - tick.q0 - h * mean)
    return total


@pytest.mark.parametrize("law", LAWS)
def test_energy_balance_closes_with_the_tick(within, law):
    """Stored + dissipated - work = contact_kinetic + contact_exchange, with impact, slips and lost contacts: the residual halves with h."""
    open_ = []
    for rate in (1000.0, 2000.0, 4000.0):
        read, network, result, ticks = drag(law, rate=rate, material={"node_mass": 0.01})
        columns = trace.table(result)
        kinetic, elastic, _ = net.energies(network, ticks[-1].after.x, ticks[-1].after.v)
        contact = columns["contact_kinetic"][-1] + columns["contact_exchange"][-1]
        gap = kinetic + elastic + dissipated(network, ticks, read.h) + rubbed(ticks, read.h) - result.rows[-1].work - contact
        open_.append(abs(gap) / abs(result.rows[-1].work))
        print(law, rate, open_[-1], contact / result.rows[-1].work)
    within(f"energy balance at 1 ms under {law}, of the work", open_[0], 0.03)
    assert open_[2] < 0.6 * open_[1] and open_[1] < 0.6 * open_[0]
