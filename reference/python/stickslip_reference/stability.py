"""Stability of the explicit steps: spectral radius of the one-step matrix of the linear model."""

import numpy as np
from scipy.optimize import brentq

from . import network as net


def free_tangent(network, x, v):
    """K, D (3f, 3f) and M^-1 (3f,) over the f free nodes."""
    K, D = net.jacobians(network, x, v)
    free = (3 * np.flatnonzero(~network.fixed)[:, None] + np.arange(3)).ravel()
    return K[free][:, free].toarray(), D[free][:, free].toarray(), np.repeat(network.inverse_mass, 3)[free]


def one_step_matrix(K, D, inverse_mass, h, integrator="semi-implicit-euler"):
    """The matrix that takes (x, v) over one step of the linear model."""
    identity, zero = np.eye(len(K)), np.zeros_like(K)
    by_x, by_v = inverse_mass[:, None] * K, inverse_mass[:, None] * D
    if integrator == "semi-implicit-euler":  # (11): v first, then x with the new v
        v_new = np.hstack([h * by_x, identity + h * by_v])
        return np.vstack([np.hstack([identity, zero]) + h * v_new, v_new])
    hA = h * np.block([[zero, identity], [by_x, by_v]])
    one = np.eye(len(hA))
    return one + hA @ (one + hA @ (one + hA @ (one + hA / 4.0) / 3.0) / 2.0)  # rk4: four terms of the exponential


def spectral_radius(matrix):
    return np.abs(np.linalg.eigvals(matrix)).max()


def step_limit(K, D, inverse_mass, bracket, integrator="semi-implicit-euler"):
    """The step at which the spectral radius leaves 1, between a stable and an unstable one."""
    return brentq(lambda h: spectral_radius(one_step_matrix(K, D, inverse_mass, h, integrator)) - 1.0, *bracket, xtol=1e-15)


def proportional_limit(omega_max, zeta):
    """2 (sqrt(1 + zeta^2) - zeta) / omega_max, for damping proportional to stiffness, zeta = c omega_max / 2k."""
    return 2.0 * (np.sqrt(1.0 + zeta**2) - zeta) / omega_max
