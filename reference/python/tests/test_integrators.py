"""The local integrators of the linear model: order, stability for any step, and e^(Fh) itself."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import expm

from stickslip_reference import integrators

# The exponential against expm of the system as it stands, of the largest value. Measured: 2.7e-13.
EXPONENTIAL_TOLERANCE = 1e-12
# Orders 1 and 2 between 1024 and 2048 steps. Measured: 0.0038 off.
ORDER_TOLERANCE = 0.1
# Two ways to the same affine map, of the largest value. Measured: 2.6e-16.
LINEAR_TOLERANCE = 1e-12
# Spectral radii above 1, and energies, by rounding. Measured: 1.6e-12.
RADIUS_TOLERANCE = 1e-10
# The same for the exponential, per radian of the step: every squaring in expm doubles what was off. Measured: 2.2e-14.
SQUARED_TOLERANCE = 1e-13
# Modulus of implicit Euler's eigenvalues, relative. Measured: 2.2e-16.
MODULUS_TOLERANCE = 1e-13


def system(rng, nodes=3, fixed=1, scale=1.0, damping=0.2):
    """A model of `nodes` free nodes and `fixed` others, all random, K and D negative."""
    size = 3 * nodes
    A, B = rng.normal(size=(2, size, size))
    return SimpleNamespace(
        network=SimpleNamespace(mass=rng.uniform(0.5, 2.0, nodes + fixed)), patch=np.arange(nodes),
        K=-scale * (A @ A.T + np.eye(size)), D=-damping * B @ B.T, f0=rng.normal(size=(nodes, 3)),
        drift=rng.normal(size=(nodes, 3)), x0=rng.normal(size=(nodes + fixed, 3)),
        v0=rng.normal(size=(nodes + fixed, 3)))


def start(model, rng):
    """A state over all nodes that is not the model's x0, v0."""
    return model.x0 + rng.normal(size=model.x0.shape), model.v0 + rng.normal(size=model.v0.shape)


def exact(model, x, v, t, h):
    """x and v (3m,) at t + h: e^(Fh) of the system in (x, v, 1, time), as it stands."""
    patch, n = model.patch, len(model.K)
    by_mass = 1.0 / np.repeat(model.network.mass[patch], 3)
    F = np.zeros((2 * n + 2, 2 * n + 2))
    F[:n, n:2 * n] = np.eye(n)
    F[n:2 * n, :n], F[n:2 * n, n:2 * n] = by_mass[:, None] * model.K, by_mass[:, None] * model.D
    constant = model.f0.ravel() - model.K @ model.x0[patch].ravel() - model.D @ model.v0[patch].ravel()
    F[n:2 * n, -2] = by_mass * constant
    F[n:2 * n, -1] = by_mass * model.drift.ravel()
    F[-1, -2] = 1.0
    after = expm(h * F) @ [*x[patch].ravel(), *v[patch].ravel(), 1.0, t]
    return after[:n], after[n:2 * n]


def run(name, model, x, v, h, steps):
    """Steps from t = 0 on; x and v (3m,)."""
    stepper = integrators.CLASSES[name](model, h)
    x, v = x.copy(), v.copy()
    for step in range(steps):
        after = stepper.predict(x, v, step * h)
        x[model.patch], v[model.patch] = (values.reshape(-1, 3) for values in after)
    return x[model.patch].ravel(), v[model.patch].ravel()


def distance(ours, theirs):
    return np.max([np.abs(a - b).max() for a, b in zip(ours, theirs)]) / np.max([np.abs(b).max() for b in theirs])


@pytest.mark.parametrize("scale, h", [(1.0, 0.1), (1.0, 2.0), (1e4, 0.05), (1e-6, 0.3)])
def test_the_exponential_is_the_solution(within, scale, h):
    rng = np.random.default_rng(4)
    model = system(rng, scale=scale)
    x, v = start(model, rng)
    stepper = integrators.Exponential(model, h)
    within("one tick against expm", distance(stepper.predict(x, v, 0.7), exact(model, x, v, 0.7, h)),
           EXPONENTIAL_TOLERANCE)
    # Any number of ticks make the one over their sum: the drift is all of it, not a mean.
    within("ticks against one", distance(run("exponential", model, x, v, h, 5), exact(model, x, v, 0.0, 5 * h)),
           EXPONENTIAL_TOLERANCE)


@pytest.mark.parametrize("name, order", [("implicit-euler", 1), ("implicit-midpoint", 2)])
def test_order(within, name, order):
    rng = np.random.default_rng(5)
    model = system(rng)
    x, v = start(model, rng)
    end = exact(model, x, v, 0.0, 1.0)
    fine = 1024
    coarse, half = (distance(run(name, model, x, v, 1.0 / steps, steps), end) for steps in (fine, 2 * fine))
    assert half > 1e-8  # or else rounding would be measured
    within(f"order of {name}, off {order}", abs(np.log2(coarse / half) - order), ORDER_TOLERANCE)


def one_step(name, frequency, ratio, h=1.0):
    """The matrix of one tick on a single node's x and v, of an oscillator of angular frequency and damping ratio."""
    mass = 0.3
    still = np.zeros((1, 3))
    model = SimpleNamespace(network=SimpleNamespace(mass=np.array([mass])), patch=np.array([0]),
                            f0=still, drift=still, x0=still, v0=still,
                            K=-mass * frequency**2 * np.eye(3), D=-2.0 * mass * ratio * frequency * np.eye(3))
    stepper = integrators.CLASSES[name](model, h)
    unit = np.array([[1.0, 0.0, 0.0]])
    # v in units of frequency times x: else the matrix of a stiff oscillator is all rounding.
    columns = stepper.predict(unit, still, 0.0), stepper.predict(still, frequency * unit, 0.0)
    return np.array([[x[0], v[0] / frequency] for x, v in columns]).T


FREQUENCIES = np.logspace(-3, 6, 19)
RATIOS = (0.0, 1e-3, 0.1, 0.5, 1.0, 2.0, 100.0)


@pytest.mark.parametrize("name", integrators.CLASSES)
def test_no_step_is_too_long(within, name):
    """A-stable: over nine decades of step times frequency, damped or not, nothing grows."""
    for frequency in FREQUENCIES:
        for ratio in RATIOS:
            eigenvalues = np.linalg.eigvals(one_step(name, frequency, ratio))
            above = np.abs(eigenvalues).max() - 1.0
            if name == "exponential":
                within("spectral radius of exponential - 1, per radian", above / max(1.0, frequency), SQUARED_TOLERANCE)
            else:
                within(f"spectral radius of {name} - 1", above, RADIUS_TOLERANCE)


def test_what_an_undamped_oscillator_keeps(within):
    """The midpoint and the exponential keep its energy; implicit Euler takes it, all of it where the step is long."""
    for frequency in FREQUENCIES:
        midpoint, exponential = (np.abs(kept.T @ kept - np.eye(2)).max() for kept in (
            one_step(name, frequency, 0.0) for name in ("implicit-midpoint", "exponential")))
        within("energy of implicit-midpoint", midpoint, RADIUS_TOLERANCE)
        within("energy of exponential, per radian", exponential / max(1.0, frequency), SQUARED_TOLERANCE)
        lossy = np.abs(np.linalg.eigvals(one_step("implicit-euler", frequency, 0.0)))
        # 1 / (1 - i omega h)
        within("modulus of implicit-euler", np.abs(lossy * np.hypot(1.0, frequency) - 1.0).max(), MODULUS_TOLERANCE)


@pytest.mark.parametrize("name", integrators.CLASSES)
def test_an_impulse_is_a_constant_force_over_the_tick(within, name):
    """by_impulse is what a free tick does more under a force of impulse / h."""
    rng, h = np.random.default_rng(6), 0.05
    model = system(rng)
    x, v = start(model, rng)
    impulse = rng.normal(size=(3, 3))
    pushed = SimpleNamespace(**vars(model) | {"f0": model.f0 + impulse / h})
    plain = integrators.CLASSES[name](model, h)
    answers = plain.by_impulse_x, plain.by_impulse_v
    ours = [free + answer @ impulse.ravel() for free, answer in zip(plain.predict(x, v, 0.2), answers)]
    theirs = integrators.CLASSES[name](pushed, h).predict(x, v, 0.2)
    within("answer to an impulse", distance(ours, theirs), LINEAR_TOLERANCE)
    assert np.abs(plain.by_impulse_x).max() > 1e-3


@pytest.mark.parametrize("name, share", [("implicit-euler", 1.0), ("implicit-midpoint", 0.5)])
def test_drift_counts_at_the_time_of_the_forces(within, name, share):
    """A drift is a constant force of its value at the tick's end or middle."""
    rng, h = np.random.default_rng(7), 0.05
    model = system(rng)
    x, v = start(model, rng)
    constant = {"f0": model.f0 + (0.2 + share * h) * model.drift, "drift": 0.0 * model.drift}
    held = SimpleNamespace(**vars(model) | constant)
    ours, theirs = (integrators.CLASSES[name](each, h).predict(x, v, 0.2) for each in (model, held))
    within("drift", distance(ours, theirs), LINEAR_TOLERANCE)
