"""The modelled PHANTOM 1.5 and the hand: closed forms, Lagrange's equations, energy, published figures."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from stickslip_reference import phantom
from stickslip_reference.plant import CURRENT, ENERGY, HAND, HAND_VELOCITY, RATE, THETA, Plant
from stickslip_reference.scene import read_part

# Lengths of 0.2 m, masses of 1e-3 kg m^2, torques of 0.1 N m against complex steps. Measured: 5.6e-17.
SLOPE_TOLERANCE = 1e-15
# Angles that the inverse gives back, rad; the limits keep acos off its ends. Measured: 1.8e-15.
INVERSE_TOLERANCE = 1e-12
# The last digit that was published, kg: pi_5 has 52.49 g for 53 g. Measured: 5.1e-4.
MASS_TOLERANCE = 1e-3
# Half of the last digit that was published, m. Measured: 4.7e-8.
RESOLUTION_TOLERANCE = 0.05e-6
# RK4 at 80 substeps of a tick against DOP853, of each quantity's largest value. Measured: 4.6e-9.
LAGRANGE_TOLERANCE = 1e-8
# The default of 10, for which friction's turn within a fraction of a millisecond is coarse. Measured: 3.0e-5.
DEFAULT_TOLERANCE = 1e-4
# Order of RK4, 4, from 20 to 80 substeps. Measured: 0.14 off.
ORDER_TOLERANCE = 0.2
# Energy without losses over 0.2 s, of what moves between its forms, at substeps of 25 us. Measured: 5.7e-13.
ENERGY_TOLERANCE = 1e-11
# Tip at rest, m, of 1 cm: what is left of the motion after 3 s. Measured: 5.6e-13.
REST_TOLERANCE = 1e-9
COUNT_TOLERANCE = 1e-11  # a count, of one; there are thousands. Measured: 4.5e-13.
FORCE_TOLERANCE = 1e-13  # N, of 1 N, through J^T and back. Measured: 9.4e-16.

# m/s, of 0.5. Measured: 0.
TARGET_TOLERANCE = 1e-14
# m/s, against central differences over 20 us. Measured: 6.9e-10.
DIFFERENCE_TOLERANCE = 1e-8

LOSSLESS = {"joint_friction": [0.0] * 3, "joint_damping": 0.0}
BENT = np.array([0.3, 0.2, 0.5])  # a posture in general position


def parts(device=None, hand=None):
    return read_part("device", device or {}), read_part("hand", hand or {})


def postures(count=200):
    """Random postures that the device can take."""
    rng, found = np.random.default_rng(15), []
    while len(found) < count:
        theta = np.radians(rng.uniform([-90.0, -61.0, -23.0], [90.0, 113.0, 167.0]))
        try:
            phantom.check(theta)
        except phantom.WorkspaceError:
            continue
        found.append(theta)
    return found


def complex_slopes(function, theta):
    """[i] is d function / d theta_i, without a difference."""
    return np.array([np.imag(function(theta + 1e-30j * axis)) / 1e-30 for axis in np.eye(3)])


def mass_matrix(theta):
    """M once more, so that it takes complex angles."""
    one = (phantom.P1 + phantom.P2 * np.cos(2 * theta[1]) + phantom.P3 * np.cos(2 * theta[2])
           + phantom.P4 * np.cos(theta[1]) * np.sin(theta[2]))
    both = -phantom.P4 / 2 * np.sin(theta[1] - theta[2])
    return np.array([[one, 0, 0], [0, phantom.P5, both], [0, both, phantom.P6]])


def test_the_home_posture_is_the_origin():
    assert np.array_equal(phantom.forward(np.zeros(3)), np.zeros(3))


def test_jacobian_and_slopes_against_complex_steps(within):
    for theta in postures():
        within("Jacobian, m", np.abs(phantom.jacobian(theta) - complex_slopes(phantom.forward, theta).T).max(),
               SLOPE_TOLERANCE)
        within("M, kg m^2", np.abs(phantom.mass_matrix(theta) - mass_matrix(theta)).max(), SLOPE_TOLERANCE)
        within("dM, kg m^2", np.abs(phantom.mass_slopes(theta) - complex_slopes(mass_matrix, theta)).max(),
               SLOPE_TOLERANCE)
        within("N, N m", np.abs(phantom.gravity(theta) - complex_slopes(phantom.potential, theta)).max(),
               SLOPE_TOLERANCE)
        assert np.linalg.eigvalsh(phantom.mass_matrix(theta)).min() > 0.0


def test_inverse_gives_the_posture_back(within):
    for theta in postures():
        within("angles, rad", np.abs(phantom.inverse(phantom.forward(theta)) - theta).max(), INVERSE_TOLERANCE)


def test_coriolis_forces_are_lagranges(within):
    """C rate = (dM/dt) rate - d(rate M rate / 2)/d theta, and dM/dt - 2 C is skew."""
    rng = np.random.default_rng(16)
    for theta in postures():
        rate = rng.normal(size=3)
        slopes = complex_slopes(mass_matrix, theta)
        C, changing = phantom.coriolis(theta, rate), np.tensordot(rate, slopes, 1)
        expected = changing @ rate - 0.5 * np.array([rate @ slope @ rate for slope in slopes])
        within("C rate, N m", np.abs(C @ rate - expected).max(), SLOPE_TOLERANCE)
        skew = changing - 2.0 * C
        within("dM/dt - 2C, skew", np.abs(skew + skew.T).max(), SLOPE_TOLERANCE)
        # Printed with + in some transcriptions of the paper, which makes energy.
        assert np.isclose(C[2, 1], -0.5 * phantom.P4 * np.cos(theta[1] - theta[2]) * rate[1], rtol=1e-12, atol=0.0)


def test_published_masses_at_home(within):
    home = np.zeros(3)
    J = phantom.jacobian(home)
    apparent = 1.0 / np.diag(J @ np.linalg.inv(phantom.mass_matrix(home)) @ J.T)
    within("apparent masses of 77, 53, 32 g, kg", np.abs(apparent - [0.077, 0.053, 0.032]).max(), MASS_TOLERANCE)


def test_published_resolution_at_home(within):
    """A little more than half a count moves the measured tip by a whole one."""
    device, _ = parts()
    count = 2.0 * np.pi / (4096 * device.capstan_ratio)
    for joint, axis, published in ((0, 0, 24.8e-6), (1, 1, 29.4e-6), (2, 2, 23.3e-6)):
        before, after = (phantom.forward(phantom.measured(device, share * count * np.eye(3)[joint]))
                         for share in (0.49, 0.51))
        assert not before.any()
        within("resolution, m", abs(after[axis] - published), RESOLUTION_TOLERANCE)


def test_encoders_tell_whole_counts(within):
    device, _ = parts({"encoder_counts": 1000})
    for theta in postures(20):
        told = phantom.measured(device, theta)
        per_radian = device.capstan_ratio * 1000 / (2.0 * np.pi)
        counts = told * per_radian
        within("counts, from whole ones", np.abs(counts - np.round(counts)).max(), COUNT_TOLERANCE)
        within("quantisation, counts", np.abs(counts - theta * per_radian).max(), 0.5 + COUNT_TOLERANCE)
    exact, _ = parts({"encoder_counts": 0})
    assert np.array_equal(phantom.measured(exact, BENT), BENT)


def test_currents_make_the_force(within):
    """J^T f through drives and motors, in steps of 11 A / 2^16; up is the scene's z and the device's y."""
    device, _ = parts()
    exact, _ = parts({"torque_bits": 0})
    step = 11.0 / 2**16
    rng = np.random.default_rng(17)
    for theta in postures(20):
        force = rng.normal(size=3)
        current = phantom.currents(device, theta, force)
        within("steps, from whole ones", np.abs(current / step - np.round(current / step)).max(), COUNT_TOLERANCE)
        ideal = phantom.currents(exact, theta, force)
        within("quantisation, steps", np.abs(current - ideal).max() / step, 0.5 + COUNT_TOLERANCE)
        torque = ideal * device.capstan_ratio * device.torque_constant
        at_tip = np.linalg.solve(phantom.jacobian(theta).T, torque)
        within("force, N", np.abs(at_tip - [force[0], force[2], -force[1]]).max(), FORCE_TOLERANCE)
    assert phantom.currents(device, np.zeros(3), np.array([0.0, 0.0, 1.0]))[1] > 0.0


def test_limits_of_force_and_current():
    device, _ = parts()
    strong = np.array([3.0, -20.0, 40.0])
    as_limited = strong * 8.5 / np.linalg.norm(strong)
    one, other = (phantom.currents(device, BENT, force) for force in (strong, as_limited))
    assert np.abs(one - other).max() <= 1.5 * 11.0 / 2**16 and np.abs(one).max() > 0.5  # rounding may move it by a step
    weak, _ = parts({"largest_current": 0.5})
    current = phantom.currents(weak, BENT, strong)
    # Two's complement: one step less upwards than downwards.
    assert set(current) <= {-0.5, 0.5 * (1.0 - 2.0**-15)} and {-0.5} < set(current)


@pytest.mark.parametrize("theta, message", [
    ([np.nan, 0.0, 0.0], "not finite"),
    ([0.0, 1.95, 2.9], "theta_1 is singular"),
    ([1.6, 0.0, 0.0], "theta_1 = 91.67 degrees .* -90 to 90"),
    ([0.0, -1.1, -0.3], "theta_2 = -63.03 degrees .* -61 to 113"),
    ([0.0, 0.0, -0.5], "theta_3 = -28.65 degrees .* -23 to 167"),
    ([0.0, 0.0, 1.0], "theta_3 - theta_2 = 57.3 degrees .* -53 to 54"),
])
def test_postures_that_cannot_be(theta, message):
    with pytest.raises(phantom.WorkspaceError, match=message):
        phantom.check(np.array(theta))


@pytest.mark.parametrize("tip, message", [
    ([0.0, 0.0, 0.5], "reach 0.045 to 0.385 m"),
    ([0.0, 0.17, -0.2], "reach 0.045"),
    ([0.0, 0.0, -0.215], "theta_1 is singular"),
    ([0.0, 0.0, np.nan], "nan m from the shoulder"),
    ([0.0, 0.0, -0.35], "theta_1 = 180 degrees"),
])
def test_tips_that_cannot_be(tip, message):
    with pytest.raises(phantom.WorkspaceError, match=message):
        phantom.inverse(np.array(tip))


PATH = np.array([[0.0, 0.01, 0.02, -0.01], [1.0, 0.25, -0.1, -0.3]])


def energy_of_device(state):
    theta, rate = state[THETA], state[RATE]
    return 0.5 * rate @ phantom.mass_matrix(theta) @ rate + phantom.potential(theta)


def energy_of_hand(plant, state, target):
    """Of its mass and its springs, J."""
    hand = plant.hand
    stylus, arm = state[HAND] - phantom.forward(state[THETA]), target - state[HAND]
    return 0.5 * (hand.mass @ state[HAND_VELOCITY]**2 + hand.stylus_stiffness @ stylus**2 + hand.arm_stiffness @ arm**2)


def hamilton(plant, state, ticks, h):
    """The same run by Hamilton's equations, without C and N: rate = M^-1 p, dp/dt = dL/d theta + torques."""
    device, hand = plant.device, plant.hand
    start, end = plant.places
    velocity = end - start  # within a second
    inertia = np.diag(device.rotor_inertia)

    def slope(t, y, command):
        theta, p, current, place, speed = (y[part] for part in (THETA, RATE, CURRENT, HAND, HAND_VELOCITY))
        rate = np.linalg.solve(mass_matrix(theta) + inertia, p)

        def lagrangian(angles):
            return 0.5 * rate @ mass_matrix(angles) @ rate - phantom.potential(angles)
        J = complex_slopes(phantom.forward, theta).T
        pull = (hand.stylus_stiffness * (place - phantom.forward(theta)) + hand.stylus_damping * (speed - J @ rate))
        arm = hand.arm_stiffness * (start + t * velocity - place) + hand.arm_damping * (velocity - speed)
        torque = (device.capstan_ratio * device.torque_constant * current - device.joint_damping * rate
                  - device.joint_friction * np.tanh(rate / device.friction_speed) + J.T @ pull)
        return [*rate, *(complex_slopes(lagrangian, theta) + torque),
                *(2 * np.pi * device.amplifier_bandwidth * (command - current)),
                *speed, *((arm - pull) / hand.mass), -pull @ J @ rate]
    y = state.copy()
    y[RATE] = (mass_matrix(y[THETA]) + inertia) @ y[RATE]
    for tick, command in enumerate(ticks):
        y = solve_ivp(slope, (tick * h, (tick + 1) * h), y, "DOP853", args=(command,), rtol=1e-12, atol=1e-15).y[:, -1]
    y[RATE] = np.linalg.solve(mass_matrix(y[THETA]) + inertia, y[RATE])
    return y


def test_plant_against_hamiltons_equations(within):
    """Friction, rotors, amplifiers and a hand that is pulled, all at once: RK4 of order 4 towards DOP853."""
    h, ticks = 1e-3, 0.5 * np.random.default_rng(18).normal(size=(12, 3))

    def plant(substeps):
        return Plant(*parts({"substeps": substeps, "rotor_inertia": [1.82e-4, 1.29e-4, 1.29e-4]}), PATH)
    start = plant(10).at_rest()
    start[RATE] = [0.8, -0.5, 1.1]
    expected = hamilton(plant(10), start, ticks, h)
    size = np.array([np.abs(expected[part]).max() for part in (THETA, RATE, CURRENT, HAND, HAND_VELOCITY)]).repeat(3)
    size = np.append(size, abs(expected[ENERGY]))
    errors = {}
    for substeps in (10, 20, 40, 80):
        state, exact = start, plant(substeps)
        for tick, command in enumerate(ticks):
            state = exact.advance(state, tick * h, h, command)
        errors[substeps] = np.abs((state - expected) / size).max()
    within("10 substeps, the default, scaled", errors[10], DEFAULT_TOLERANCE)
    within("80 substeps against DOP853, scaled", errors[80], LAGRANGE_TOLERANCE)
    within("order of RK4, off 4", abs(np.log2(errors[20] / errors[80]) / 2 - 4.0), ORDER_TOLERANCE)


def test_energy_without_losses_stays(within):
    """Device and hand exchange it: the energy that the device counts as the hand's is what the hand has gained."""
    device, hand = parts(LOSSLESS | {"substeps": 40}, {"stylus_damping": [0.0] * 3, "arm_damping": [0.0] * 3})
    plant = Plant(device, hand, np.array([[0.0, 0.01, 0.02, -0.01]]))
    target = plant.target(0.0)
    state = plant.at_rest()
    state[RATE] = [2.0, -1.0, 1.5]
    before, in_device, in_hand = state, [], []
    for tick in range(200):
        state = plant.advance(state, tick * 1e-3, 1e-3, np.zeros(3))
        in_device.append(energy_of_device(state) - energy_of_device(before))
        in_hand.append(energy_of_hand(plant, state, target) - energy_of_hand(plant, before, target))
    exchanged = np.ptp(in_hand)
    assert exchanged > 1e-3
    within("energy, of the energy exchanged", np.abs(np.add(in_device, in_hand)).max() / exchanged, ENERGY_TOLERANCE)
    within("hand's book, of the energy exchanged", abs(state[ENERGY] - in_hand[-1]) / exchanged, ENERGY_TOLERANCE)


def test_friction_and_damping_only_take():
    """Without a hand, amplifiers and gravity's help a swing dies out, in every tick a little."""
    none = [0.0] * 3
    plant = Plant(*parts(None, {"stylus_stiffness": none, "stylus_damping": none}), np.array([[0.0, 0.0, 0.0, 0.0]]))
    state = plant.at_rest()
    state[RATE] = [0.3, 0.2, -0.1]
    for tick in range(50):
        after = plant.advance(state, tick * 1e-3, 1e-3, np.zeros(3))
        assert energy_of_device(after) < energy_of_device(state)
        state = after


def test_a_force_moves_the_tip_against_the_hand(within):
    """At rest the springs of the hand in series carry the force commanded and gravity."""
    plant = Plant(*parts(LOSSLESS | {"torque_bits": 0, "substeps": 3}), np.array([[0.0, 0.01, 0.02, -0.01]]))
    device, hand = plant.device, plant.hand
    state, force = plant.at_rest(), np.array([0.3, 0.5, 0.4])
    for tick in range(2400):
        state = plant.advance(state, tick * 1e-3, 1e-3, phantom.currents(device, state[THETA], force))
    J = phantom.jacobian(state[THETA])
    load = device.rotation @ force - np.linalg.solve(J.T, phantom.gravity(state[THETA]))
    give = load * (1.0 / hand.stylus_stiffness + 1.0 / hand.arm_stiffness)
    assert np.abs(give).min() > 1e-3
    within("tip at rest, m", np.abs(phantom.forward(state[THETA]) - plant.target(0.0) - give).max(), REST_TOLERANCE)


def test_the_target_has_the_slope_of_its_piece():
    waypoints = np.array([[0.1, 0.0, 0.0, 0.0], [0.2, 1.0, 2.0, 3.0], [0.4, 1.0, 2.0, 4.0]])
    plant = Plant(*parts({"rotation": np.eye(3).tolist()}), waypoints)
    for t, place, velocity in ((0.05, [0, 0, 0], [0, 0, 0]), (0.15, [0.5, 1, 1.5], [10, 20, 30]),
                               (0.3, [1, 2, 3.5], [0, 0, 5]), (0.5, [1, 2, 4], [0, 0, 0])):
        assert np.allclose(plant.target(t), place, rtol=1e-14)
        assert np.allclose(plant.target_velocity(t), velocity, rtol=1e-14)


def test_a_target_of_minimum_jerk_has_the_slope_of_its_own_curve(within):
    """In the middle of a piece 15/8 of its mean speed; at waypoints, and outside the path, none."""
    plant = Plant(*parts(), np.array([[1.0, 0.0, 0.0, 0.0], [2.0, 0.1, 0.0, 0.0], [2.5, 0.1, 0.2, 0.0]]), "minimum-jerk")
    axes = phantom.to_device(plant.device, np.eye(3)) - phantom.to_device(plant.device, np.zeros(3))
    for t, velocity in ((0.5, 0.0), (1.0, 0.0), (1.5, 0.1 * 15 / 8 * axes[0]), (2.0, 0.0), (2.25, 0.4 * 15 / 8 * axes[1]), (3.0, 0.0)):
        within("velocity of the target, m/s", np.abs(plant.target_velocity(t) - velocity).max(), TARGET_TOLERANCE)
    for t in (1.1, 1.7, 2.2):
        slope = (plant.target(t + 1e-5) - plant.target(t - 1e-5)) / 2e-5
        within("velocity against differences, m/s", np.abs(plant.target_velocity(t) - slope).max(), DIFFERENCE_TOLERANCE)


def test_a_substep_belongs_to_the_piece_of_its_middle(monkeypatch):
    """The path turns at 40 % of the second substep and at 60 % of the fourth."""
    places = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [1.0, 1.0, 1.0]]
    plant = Plant(*parts({"rotation": np.eye(3).tolist(), "substeps": 5}), np.column_stack([[0.0, 1.4, 3.6, 5.0], places]))
    moving = []
    monkeypatch.setattr(plant, "slope", lambda y, command, target, velocity: moving.append(np.flatnonzero(velocity)) or 0.0)
    plant.advance(np.zeros(16), 0.0, 5.0, np.zeros(3))
    assert np.ravel(moving).tolist() == 4 * [0] + 12 * [1] + 4 * [2]
