"""The velocity scheme: what its constraint promises, tick by tick, and its balances of momentum and energy."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from setups import plate, plate_scene, scene
from stickslip_reference import comparison, cycle, trace, velocity
from stickslip_reference import network as net

SURFACES = ("faceted", "shaded", "subdivision")
# Momentum against impulses, of the largest impulse. Measured: 4.2e-14.
MOMENTUM_TOLERANCE = 1e-11
# The contact point against the tip, m; positions of centimetres. Measured: 3.5e-18.
PLACE_TOLERANCE = 1e-15
# Speeds of the contact point along the normal, m/s: places over a tick of 1 ms. Measured: 2.8e-17.
SPEED_TOLERANCE = 1e-12
# A plate's impulse, relative: its springs are linear, and it stays level, to about travel over length, 3e-7.
# Measured: 1.9e-7.
PLATE_TOLERANCE = 1e-6
# F_T / F_N at slip. Measured: 2.3e-16.
CONE_TOLERANCE = 1e-12
# What the energy balances may leave open, of the work, at 1 ms. Measured: 0.0086 and 0.0015.
BOOKS_TOLERANCE = 0.02
# Order of what they leave open in the tick, 1. Measured: 0.023 off.
ORDER_TOLERANCE = 0.1

WAYPOINTS = [[0.0, -0.01, 0.0013, 0.00051], [0.05, -0.01, 0.0013, -0.003], [0.2, 0.006, 0.003, -0.003]]
UNEQUAL = np.random.default_rng(6).uniform(0.005, 0.02, 180)


def drag(law, surface, rate=1000.0, duration=0.2, path=np.array(WAYPOINTS), **sections):
    """A drag over a small block, and what every tick began and ended with."""
    sections = {"mesh": {"nodes": [6, 6, 5]}, "material": {"node_mass": UNEQUAL.tolist()}} | sections
    read = scene(law, duration=duration, instrument={"waypoints": path.tolist()}, local={"model": "full", "rate": rate},
                 contact={"surface": surface, "scheme": "velocity"} | ({"friction": 0.4} if law == "stick-slip" else {}),
                 **sections)
    network = net.block(read)
    ticks = []
    original = velocity.advance

    def watched(model, surface, options, state, q0, q1, h, elapsed):
        after, report = original(model, surface, options, state, q0, q1, h, elapsed)
        ticks.append(SimpleNamespace(before=state, after=after, report=report, q0=q0, q1=q1, surface=surface))
        return after, report

    velocity.advance = watched
    try:
        result = cycle.run(read, network)
    finally:
        velocity.advance = original
    assert result.fault is None and result.inside_without_contact == 0
    return read, network, result, ticks


def tip_velocity_left(tick, h):
    """(q1 - p) / h less the velocity of the contact point after the tick: zero where it follows the tip."""
    nodes, weights = tick.surface.support(tick.report.point)
    return (tick.q1 - weights @ tick.before.x[nodes]) / h - weights @ tick.after.v[nodes]


@pytest.mark.parametrize("surface", SURFACES)
@pytest.mark.parametrize("law", ["sliding", "sticking", "stick-slip"])
def test_impulses_are_the_momentum_of_a_free_network(within, law, surface):
    """Nothing holds the block: in every tick its momentum changes by minus the force on the instrument times h."""
    read, network, _, ticks = drag(law, surface, mesh={"nodes": [6, 6, 5], "fixed": "none"}, duration=0.1)
    momenta = np.array([network.mass @ tick.before.v for tick in ticks] + [network.mass @ ticks[-1].after.v])
    impulses = np.array([-read.h * tick.report.force for tick in ticks])
    assert np.abs(impulses).max() > 1e-4
    error = np.abs(np.diff(momenta, axis=0) - impulses).max() / np.abs(impulses).max()
    within("momentum against impulse", error, MOMENTUM_TOLERANCE)


@pytest.mark.parametrize("surface", SURFACES)
def test_a_sticking_contact_point_follows_the_tip(within, surface):
    read, _, _, ticks = drag("sticking", surface)
    stuck = [tick for tick in ticks if tick.report.mode == "stick"]
    assert len(stuck) > 100
    for tick in stuck:
        place = tick.surface.position(tick.report.point, tick.after.x)
        within("sticking point against the tip, m", np.abs(place - tick.q1).max(), PLACE_TOLERANCE)


@pytest.mark.parametrize("surface", SURFACES)
def test_a_sliding_contact_point_follows_the_tip_along_the_normal(within, surface):
    """r.n = 0 afterwards; the impulse is along n and pushes."""
    read, _, _, ticks = drag("sliding", surface)
    slid = [tick for tick in ticks if tick.report.mode == "slide"]
    assert len(slid) > 100
    for tick in slid:
        n, force = tick.report.normal, tick.report.force
        within("speed left along the normal, m/s", abs(tip_velocity_left(tick, read.h) @ n), SPEED_TOLERANCE)
        assert force @ n > 0.0
        within("force across the normal, of the force", np.linalg.norm(np.cross(force, n)) / (force @ n), CONE_TOLERANCE)


@pytest.mark.parametrize("surface", SURFACES)
def test_stick_slip_stays_in_the_cone(within, surface):
    read, _, _, ticks = drag("stick-slip", surface)
    modes = [tick.report.mode for tick in ticks]
    assert modes.count("stick") > 10 and modes.count("slip") > 10
    for tick in ticks:
        if tick.report.mode == "free":
            assert not tick.report.force.any()
            continue
        n, force = tick.report.normal, tick.report.force
        across = force - force @ n * n
        left = tip_velocity_left(tick, read.h)
        assert force @ n > 0.0
        within("speed left along the normal, m/s", abs(left @ n), SPEED_TOLERANCE)
        if tick.report.mode == "stick":
            assert np.linalg.norm(across) <= 0.4 * (force @ n)
            within("speed left when sticking, m/s", np.abs(left).max(), SPEED_TOLERANCE)
        else:
            within("F_T / F_N at slip, less mu", abs(np.linalg.norm(across) / (force @ n) - 0.4), CONE_TOLERANCE)
            # Friction pulls the instrument back: against the way it still has to go on the mesh.
            assert across @ left < 0.0


def test_collisions_and_tension():
    """A contact starts on the triangle of the collision, at the start's positions; a pull is never passed on."""
    for surface in SURFACES:
        _, _, _, ticks = drag("stick-slip", surface)
        first = next(tick for tick in ticks if tick.report.mode != "free" or tick.after.contact)
        predicted = first.before.x + 1e-3 * first.before.v  # no forces yet: the block rests
        tau, point = first.surface.collide(first.q0, first.q1, first.before.x, predicted)
        assert 0.0 < tau < 1.0 and first.after.contact.point.triangle == point.triangle
        assert np.abs(first.after.contact.point.weights - point.weights).max() == 0.0
        if first.report.mode != "free":
            assert first.report.at is first.before.x
        for tick in ticks:
            if tick.after.contact is not None and tick.after.contact.tension:
                assert tick.report.mode == "free" and not tick.report.force.any()


def test_one_tick_on_a_plate(within):
    """Three masses under the contact point: G = sum w^2 / m, whatever the springs did to v* before."""
    weights = np.array([0.5, 0.3, 0.2])
    network = plate(100.0, 100.0, 0.0, 0.02, weights)
    network = dataclasses.replace(network, mass=np.concatenate([[0.01, 0.02, 0.05], network.mass[3:]]))
    inverse = (weights**2 / network.mass[:3]).sum()
    q0, q1 = np.array([0.0, 0.0, 1e-3]), np.array([3e-3, 1e-3, -2e-3])
    h = 1e-3
    for law, friction in (("sticking", None), ("sliding", None), ("stick-slip", 0.5), ("stick-slip", 5.0)):
        read = plate_scene([[0.0, *q0], [h, *q1]], law, friction, scheme="velocity")
        result = cycle.run(read, network)
        r = 2.0 / 3.0 * (q1 - q0) / h  # the tip meets the plate a third of the way down
        normal = min(0.0, r[2])
        expected = np.array([0.0, 0.0, -normal])
        if law == "sticking" or friction == 5.0:
            expected[:2] = -r[:2]
        elif law == "stick-slip":
            expected[:2] = friction * normal * r[:2] / np.linalg.norm(r[:2])
        expected *= 1.0 / (inverse * h)
        force = result.rows[0].result.force
        # The plate's corners lie 1e4 m off: places, and with them r, are known to 1e-12 m.
        within("impulse on a plate", np.abs(force - expected).max() / np.abs(expected).max(), PLATE_TOLERANCE)


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
        if tick.report.point is not None:
            nodes, weights = tick.surface.support(tick.report.point)
            mean = weights @ (0.5 * (tick.before.v + tick.after.v))[nodes]
            force = tick.report.force
            across = force - force @ tick.report.normal * tick.report.normal
            total -= across @ (tick.q1 - tick.q0 - h * mean)
    return total


@pytest.mark.parametrize("law", ["sliding", "stick-slip"])
def test_energy_books_close_with_the_tick(within, law):
    """Work less what is stored, damped and rubbed away, on the limit surface: halves with the tick.

    The tip touches the flat top at 1 mm/s and turns smoothly: an impact would lose energy however short the tick.
    """
    t = np.linspace(0.0, 0.2, 801)
    down, along = (0.5 - 0.5 * np.cos(np.pi * np.clip(share, 0.0, 1.0)) for share in (t / 0.1, (t - 0.05) / 0.15))
    smooth = np.stack([t, 0.016 * along - 0.01, 0.0013 + 0.002 * along, 1e-6 - 0.003 * down], axis=1)
    open_ = []
    for rate in (1000.0, 2000.0, 4000.0):
        read, network, result, ticks = drag(law, "subdivision", rate, material={"node_mass": 0.01}, path=smooth)
        kinetic, elastic, _ = net.energies(network, ticks[-1].after.x, ticks[-1].after.v)
        work = result.rows[-1].work
        gap = work - kinetic - elastic - dissipated(network, ticks, read.h) - rubbed(ticks, read.h)
        open_.append(abs(gap) / abs(work))
    within("energy balances at 1 ms, of the work", open_[0], BOOKS_TOLERANCE)
    assert open_[2] < open_[1] < open_[0]
    within("order of the energy balances, less 1", abs(np.log2(open_[0] / open_[2]) / 2.0 - 1.0), ORDER_TOLERANCE)


def test_subdivision_has_no_jumps_where_facets_have():
    """Dragged over the edges of triangles without friction: the force's largest jump from tick to tick, N."""
    jumps = {}
    for surface in ("faceted", "subdivision"):
        _, _, _, ticks = drag("sliding", surface, material={"node_mass": 0.01})
        force = np.array([tick.report.force for tick in ticks])[60:]
        jumps[surface] = np.linalg.norm(np.diff(force, axis=0), axis=1).max()
    assert jumps["subdivision"] < 0.2 * jumps["faceted"]


@pytest.mark.parametrize("scheme", ["geometric", "velocity"])
def test_another_order_of_springs_passes_on_the_limit_surface(within, scheme):
    """Other rounding, same physics: the headroom that comparisons of traces have."""
    read = scene("stick-slip", duration=0.2, instrument={"waypoints": WAYPOINTS}, mesh={"nodes": [6, 6, 5]},
                 contact={"surface": "subdivision", "scheme": scheme})
    network = net.block(read)
    order = np.random.default_rng(1).permutation(len(network.ends))
    shuffled = dataclasses.replace(network, ends=network.ends[order][:, ::-1], stiffness=network.stiffness[order],
                                   damping=network.damping[order], rest_length=network.rest_length[order])
    run = cycle.run(read, network)
    found = comparison.differences(trace.table(run), trace.table(cycle.run(read, shuffled)), network.triangles,
                                   [row.result.at for row in run.rows])
    verdict = comparison.judge(found, 200, 200)
    worst = max(entry["scaled"]["max"] for entry in verdict["quantities"].values())
    within("another order of springs on the limit surface", worst, comparison.SCALED_TOLERANCE)
    assert verdict["pass"] and worst > 0.0
