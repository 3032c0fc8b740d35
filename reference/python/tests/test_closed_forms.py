"""Motions and contacts with solutions on paper."""

from types import SimpleNamespace

import numpy as np
import pytest

from setups import plate, plate_scene
from stickslip_reference import cycle, trace
from stickslip_reference import network as net
from stickslip_reference.network import Network

# RK4 over one second at 2.5e-4 s, relative to the start: (omega h)^4 / 120 per radian is 5e-12 at 20 rad/s. Measured: 2.0e-12.
MASS_TOLERANCE = 1e-11
# Eigenvalues of a chain, relative. Measured: 2.4e-15.
MODE_TOLERANCE = 1e-12
# A chain's mode followed by RK4, relative to its amplitude; it never leaves the axis, where springs are linear.
# Measured: 3.3e-11.
CHAIN_TOLERANCE = 1e-10
# Impact times in ticks: places known to 2e-18 m against 2e-5 m and more flown per tick. Measured: 0.
IMPACT_TOLERANCE = 1e-11
# The scheme falls g h^2 j (j + 1) / 2 where free fall covers half a tick less: (j + 1/2) h against sqrt(2 gap / g).
# Measured: 0.500.
FREE_FALL_TICKS = 0.51
# The plate's springs are linear to about travel over their length, 1e-6, and positions of 1e4 m are known to 2e-12 m.
# Measured: 7e-7.
PLATE_TOLERANCE = 2e-6

# F_T / F_N at slip, which is mu by construction. Measured: 1.7e-16.
CONE_TOLERANCE = 1e-12


def line(count, stiffness, damping, mass, anchors):
    """Masses on the x axis a unit apart; `anchors` of them (one or two ends) are fixed."""
    nodes = np.outer(np.arange(count), [1.0, 0.0, 0.0])
    ends = np.stack([np.arange(count - 1), np.arange(1, count)], axis=1)
    fixed = np.isin(np.arange(count), anchors)
    s = len(ends)
    return Network(nodes, np.full(count, mass), fixed, ends, np.full(s, stiffness), np.full(s, damping), np.ones(s),
                   np.zeros((0, 3), int))


def follow(network, x, v, duration, steps):
    state = SimpleNamespace(x=x, v=v)
    for _ in range(steps):
        cycle.integrate(network, state, duration / steps, "rk4")
    return state.x, state.v


@pytest.mark.parametrize("regime, damping", [("underdamped", 0.8), ("critically damped", 4.0), ("overdamped", 12.0)])
def test_one_mass(within, regime, damping):
    mass, stiffness, stretch, duration = 0.1, 40.0, 0.05, 1.0
    network = line(2, stiffness, damping, mass, [0])
    x = network.nodes.copy()
    x[1, 0] += stretch
    x, v = follow(network, x, np.zeros_like(x), duration, 4000)

    decay, omega2 = damping / (2.0 * mass), stiffness / mass
    if regime == "critically damped":
        expected = stretch * (1.0 + decay * duration) * np.exp(-decay * duration)
        speed = -stretch * decay**2 * duration * np.exp(-decay * duration)
    else:
        one, other = -decay + np.sqrt(complex(decay**2 - omega2)), -decay - np.sqrt(complex(decay**2 - omega2))
        grow, shrink = np.exp(one * duration), np.exp(other * duration)
        expected = (stretch * (one * shrink - other * grow) / (one - other)).real
        speed = (stretch * one * other * (shrink - grow) / (one - other)).real
    within(f"{regime} mass, place", abs(x[1, 0] - 1.0 - expected) / stretch, MASS_TOLERANCE)
    within(f"{regime} mass, speed", abs(v[1, 0] - speed) / (stretch * np.sqrt(omega2)), MASS_TOLERANCE)


def test_regimes_are_what_they_are_called():
    mass, stiffness = 0.1, 40.0
    critical = 2.0 * np.sqrt(mass * stiffness)
    assert 0.8 < critical and abs(4.0 - critical) <= 1e-15 and 12.0 > critical


def test_chain_modes(within):
    """N masses between two walls: omega_j = 2 sqrt(k/m) sin(j pi / 2(N + 1)) along the chain, zero across it."""
    count, stiffness, mass = 8, 50.0, 0.02
    network = line(count + 2, stiffness, 0.0, mass, [0, count + 1])
    K, _ = net.jacobians(network, network.nodes, np.zeros_like(network.nodes))
    free = slice(3, 3 * (count + 1))
    values = np.sort(np.linalg.eigvalsh(-K.toarray()[free, free] / mass))
    expected = (2.0 * np.sqrt(stiffness / mass) * np.sin(np.arange(1, count + 1) * np.pi / (2 * (count + 1)))) ** 2
    within("chain modes, squared frequencies", np.abs(values[2 * count :] / expected - 1.0).max(), MODE_TOLERANCE)
    within("chain across itself is slack", np.abs(values[: 2 * count]).max() / expected.max(), MODE_TOLERANCE)


@pytest.mark.parametrize("mode", [1, 3, 8])
def test_chain_mode_in_time(within, mode):
    """A damped mode: sin shape times exp(-zeta omega t) cos-and-sin of the damped frequency."""
    count, stiffness, damping, mass, duration = 8, 50.0, 0.05, 0.02, 0.3
    network = line(count + 2, stiffness, damping, mass, [0, count + 1])
    shape = np.sin(np.arange(count + 2) * mode * np.pi / (count + 1))
    amplitude = 0.01
    x = network.nodes.copy()
    x[:, 0] += amplitude * shape
    x, _ = follow(network, x, np.zeros_like(x), duration, 6000)
    omega = 2.0 * np.sqrt(stiffness / mass) * np.sin(mode * np.pi / (2 * (count + 1)))
    zeta = damping * omega / (2.0 * stiffness)
    damped = omega * np.sqrt(1.0 - zeta**2)
    swing = np.cos(damped * duration) + zeta * omega / damped * np.sin(damped * duration)
    factor = np.exp(-zeta * omega * duration) * swing
    error = np.abs(x[:, 0] - network.nodes[:, 0] - amplitude * factor * shape).max() / amplitude
    within("chain mode in time", error, CHAIN_TOLERANCE)


def drag(kx, kz, c, mass, waypoints, weights=(1 / 3, 1 / 3, 1 / 3), **options):
    run = cycle.run(plate_scene(waypoints, **options), plate(kx, kz, c, mass, weights))
    assert run.fault is None
    return run, trace.table(run)


@pytest.mark.parametrize("law", ["sticking", "sliding"])
@pytest.mark.parametrize("deformation", ["rigid", "least-norm"])
@pytest.mark.parametrize("weights", [(1 / 3, 1 / 3, 1 / 3), (0.5, 0.3, 0.2)])
def test_single_triangle_pressed(within, law, deformation, weights):
    """Corners on springs k, pressed by depth: sum w_i z_i = -depth, so lambda = k depth / sum w_i^2 at every moment."""
    k, depth = 30.0, 0.004
    _, columns = drag(k, k, 0.6, 0.05, [[0.0, 0, 0, 0.0005], [0.09, 0, 0, -depth], [0.2, 0, 0, -depth]], weights,
                      law=law, deformation=deformation)
    pressed = columns["mode"] != "free"
    assert pressed.sum() > 150
    expected = k * -columns["qz"][pressed] / (np.array(weights) ** 2).sum()
    error = np.abs(columns["fz"][pressed] - expected).max() / expected.max()
    within("single triangle pressed, force", error, PLATE_TOLERANCE)


@pytest.mark.parametrize("rate", [1000.0, 4000.0])
def test_impact_of_a_moving_triangle(within, rate):
    """A triangle in free flight against a tip at rest: semi-implicit Euler covers g h^2 j (j + 1) / 2 in j ticks."""
    g, gap = 2.0, 0.0105
    corners = np.array([[1.0, 0.0, 0.0], [-0.5, 1.0, 0.0], [-0.5, -1.0, 0.0]])
    ends = np.array([[0, 1], [1, 2], [2, 0]])
    length = np.linalg.norm(corners[ends[:, 1]] - corners[ends[:, 0]], axis=1)
    network = Network(corners, np.full(3, 0.1), np.zeros(3, bool), ends, np.full(3, 5.0), np.zeros(3), length,
                      np.array([[0, 1, 2]]), np.array([0.0, 0.0, g]))
    run = cycle.run(plate_scene([[0.0, 0, 0, gap], [0.2, 0, 0, gap]], law="sticking", rate=rate), network)
    h = 1.0 / rate
    before = int(np.floor((-1.0 + np.sqrt(1.0 + 8.0 * gap / (g * h * h))) / 2.0))
    covered = g * h * h * before * (before + 1) / 2.0
    tau = (gap - covered) / (g * h * h * (before + 1))
    hit = int(np.flatnonzero(trace.table(run)["mode"] != "free")[0])
    assert hit == before
    flown = run.rows[hit].result.at[:, 2] - corners[:, 2]
    within("impact time, ticks", np.abs((flown - covered) / (g * h * h * (before + 1)) - tau).max(), IMPACT_TOLERANCE)
    within("weight on the tip", abs(run.rows[hit].result.force[2] / (0.3 * g) - 1.0), IMPACT_TOLERANCE)
    # The continuous fall takes sqrt(2 gap / g); the scheme runs ahead of it by half a tick.
    within("impact time against free fall, ticks", abs((hit + tau) * h - np.sqrt(2 * gap / g)) / h, FREE_FALL_TICKS)


def test_stick_to_slip_onset(within):
    """Pressed by depth and dragged by X: F_T = 3 kx X and F_N = 3 kz depth, so it slips beyond X = mu kz depth / kx."""
    kx, kz, friction, depth, speed, h = 20.0, 60.0, 0.5, 0.004, 0.05, 1e-3
    run, columns = drag(kx, kz, 0.5, 0.05, [[0.0, 0, 0, 0.0005], [0.1, 0, 0, -depth], [0.5, 0.4 * speed, 0, -depth]])
    onset = friction * kz * depth / kx
    first = int(np.flatnonzero(columns["mode"] == "slip")[0])
    # Ticks from 100 on end at X = speed (tick - 99) h.
    assert first == 100 + int(np.floor(onset / (speed * h)))
    sticking = slice(100, first)
    load = 3 * kz * depth
    within("load before slip", np.abs(columns["fn"][sticking] - load).max() / load, PLATE_TOLERANCE)
    expected = 3 * kx * columns["qx"][sticking]
    within("tangential force before slip", np.abs(columns["ft"][sticking] - expected).max() / load, PLATE_TOLERANCE)
    ratio = columns["ft"][first] / columns["fn"][first]
    within("tangential over normal force at the first slip", abs(ratio - friction), CONE_TOLERANCE)


# Ticks in which the slow mode of the sliding plate, exp(-15.5 t), has decayed below the tolerance but not to round-off,
# where F_T and mu F_N would be equal and the law's choice chance.
STEADY = (1150, 1400)


def steady_slide():
    kx, kz, c, mass = 20.0, 60.0, 1.6, 0.02
    friction, depth, speed = 0.5, 0.004, 0.05
    waypoints = [[0.0, 0, 0, 0.0005], [0.1, 0, 0, -depth], [1.4, 1.3 * speed, 0, -depth]]
    run, columns = drag(kx, kz, c, mass, waypoints)
    return kx, kz, c, friction, depth, speed, run, columns


def test_frictional_sliding_at_constant_speed(within):
    """Overdamped, so without chatter: slip in every tick, F_T = mu F_N, F_N = 3 kz depth, and the plate stands still.

    It stands where kx X = mu F_N / 3 + c speed: the deformation carries it along with the tip, and it creeps back against
    its dampers at the same speed.
    """
    kx, kz, c, friction, depth, speed, run, columns = steady_slide()
    steady = slice(*STEADY)
    assert (columns["mode"][steady] == "slip").all()
    load = 3 * kz * depth
    within("load while sliding", np.abs(columns["fn"][steady] - load).max() / load, PLATE_TOLERANCE)
    within("F_T / F_N while sliding", np.abs(columns["ft"][steady] / columns["fn"][steady] - friction).max(), CONE_TOLERANCE)
    assert (columns["fx"][steady] < 0.0).all()
    place = np.array([(row.result.at[:3] - run.rows[99].result.at[:3]).mean(axis=0)[0] for row in run.rows[steady]])
    h = 1e-3
    expected = (friction * load / 3 + c * speed) / kx - speed * h  # a tick begins before its deformation
    within("place of the plate while sliding", np.abs(place / expected - 1.0).max(), PLATE_TOLERANCE)


def test_energy_dissipated_by_coulomb_friction(within):
    """Sliding steadily, the instrument puts in mu F_N times the way, and nothing is stored."""
    _, kz, _, friction, depth, _, _, columns = steady_slide()
    first, last = STEADY[0], STEADY[1] - 1
    way = columns["qx"][last] - columns["qx"][first]
    work = columns["work"][last] - columns["work"][first]
    expected = friction * 3 * kz * depth * way
    within("work over mu F_N s", abs(work / expected - 1.0), PLATE_TOLERANCE)
    stored = columns["elastic"][last] - columns["elastic"][first]
    within("energy stored meanwhile, of the work", abs(stored) / work, PLATE_TOLERANCE)


def test_work_of_pressing(within):
    """Half a tick's way above the surface at the start of the press: W = sum F_i dz = k dz^2 n^2 / 2 over n ticks."""
    k, per_tick, count = 30.0, 4e-5, 100
    start = 0.5 * per_tick
    _, columns = drag(k, k, 0.0, 0.05, [[0.0, 0, 0, start], [0.1, 0, 0, start - count * per_tick]], law="sliding")
    expected = 3 * k * per_tick**2 * count**2 / 2.0
    within("work of pressing", abs(columns["work"][-1] / expected - 1.0), PLATE_TOLERANCE)
