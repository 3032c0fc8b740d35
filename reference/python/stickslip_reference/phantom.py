"""The modelled PHANTOM Premium 1.5: kinematics, rigid-body dynamics, encoders, motors.

From M. C. Cavusoglu, D. Feygin, F. Tendick, A critical study of the mechanical and electrical properties of the PHANToM
haptic interface, Presence 11 (2002). Device axes: x right, y up, z towards the user, the tip of the home posture
theta = 0 at the origin; m. theta[1] and theta[2] are the angles of the links against the ground. `device` is a scene's
[instrument.device].
"""

import numpy as np

from .scene import SceneError

UPPER, FORE = 0.215, 0.170  # m: the links l1 and l2
# kg m^2 and N m: pi_1 ... pi_6 of M, pi_7 and pi_8 of N.
P1, P2, P3, P4, P5, P6 = 2.8328e-3, 1.1319e-3, -0.3912e-3, 0.9123e-3, 2.4264e-3, 0.9319e-3
P7, P8 = -0.01630, -0.07376
# Where two published sets of joint limits differ, both hold.
LIMITS = {"theta_1": (-90.0, 90.0), "theta_2": (-61.0, 113.0), "theta_3": (-23.0, 167.0),
          "theta_3 - theta_2": (-53.0, 54.0)}
LEAST_REACH = 1e-3  # m: nearer to the axis of the first joint its angle is no longer told by the tip


class WorkspaceError(SceneError):
    """A posture or tip that the device cannot take."""


def sines(theta):
    """Sines and cosines of the angles, as numbers of Python's own: with them formulas take a fifth of the time."""
    return np.sin(theta).tolist(), np.cos(theta).tolist()


def reach(theta):
    """Distance of the tip from the axis of the first joint, signed: negative once the links have swung over it."""
    return UPPER * np.cos(theta[1]) + FORE * np.sin(theta[2])


def forward(theta):
    """The tip (3,), m."""
    (s1, s2, s3), (c1, c2, c3) = sines(theta)
    r = UPPER * c2 + FORE * s3
    return np.array([s1 * r, FORE - FORE * c3 + UPPER * s2, -UPPER + c1 * r])


def jacobian(theta):
    """d tip / d theta (3, 3), m."""
    (s1, s2, s3), (c1, c2, c3) = sines(theta)
    r = UPPER * c2 + FORE * s3
    return np.array([[c1 * r, -UPPER * s1 * s2, FORE * s1 * c3],
                     [0.0, UPPER * c2, FORE * s3],
                     [-s1 * r, -UPPER * c1 * s2, FORE * c1 * c3]])


def inverse(tip):
    """The posture that has its tip here; a WorkspaceError if there is none within the limits."""
    x, y, z = tip
    across, up = np.hypot(x, z + UPPER), y - FORE
    distance = np.hypot(across, up)
    if not abs(UPPER - FORE) <= distance <= UPPER + FORE:
        raise WorkspaceError(f"the tip is {distance:.6g} m from the shoulder: theta_2 and theta_3 reach "
                             f"{UPPER - FORE:.3f} to {UPPER + FORE:.3f} m")
    if not across >= LEAST_REACH:
        raise WorkspaceError(f"theta_1 is singular: the tip is {across:.3g} m from its axis, less than {LEAST_REACH} m")

    def angle(cosine):
        return np.arccos(np.clip(cosine, -1.0, 1.0))  # beyond one by rounding alone

    elevation = angle((UPPER**2 + distance**2 - FORE**2) / (2.0 * UPPER * distance)) + np.arctan2(up, across)
    between = angle((UPPER**2 + FORE**2 - distance**2) / (2.0 * UPPER * FORE))
    theta = np.array([np.arctan2(x, z + UPPER), elevation, elevation + between - np.pi / 2.0])
    check(theta)
    return theta


def check(theta):
    """A WorkspaceError for a posture that is not finite, singular or beyond a joint's limit."""
    if not np.isfinite(theta).all():
        raise WorkspaceError(f"the joint angles are not finite: {theta}")
    if not reach(theta) >= LEAST_REACH:
        raise WorkspaceError(f"theta_1 is singular: the tip is {reach(theta):.3g} m from its axis, "
                             f"less than {LEAST_REACH} m")
    degrees = np.degrees([*theta, theta[2] - theta[1]])
    for (joint, (low, high)), value in zip(LIMITS.items(), degrees):
        if not low <= value <= high:
            raise WorkspaceError(f"{joint} = {value:.4g} degrees is outside its limits of {low:g} to {high:g} degrees")


def mass_matrix(theta):
    """M (3, 3), kg m^2, without rotors."""
    (_, s2, s3), (_, c2, c3) = sines(theta)
    about_axis = P1 + P2 * (c2 * c2 - s2 * s2) + P3 * (c3 * c3 - s3 * s3) + P4 * c2 * s3
    both = -0.5 * P4 * (s2 * c3 - c2 * s3)
    return np.array([[about_axis, 0.0, 0.0], [0.0, P5, both], [0.0, both, P6]])


def mass_slopes(theta):
    """(3, 3, 3): [i] is dM / d theta_i."""
    (_, s2, s3), (_, c2, c3) = sines(theta)
    by_second = -4.0 * P2 * s2 * c2 - P4 * s2 * s3
    by_third = -4.0 * P3 * s3 * c3 + P4 * c2 * c3
    both = 0.5 * P4 * (c2 * c3 + s2 * s3)
    return np.array([[[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]],
                     [[by_second, 0.0, 0.0], [0.0, 0.0, -both], [0.0, -both, 0.0]],
                     [[by_third, 0.0, 0.0], [0.0, 0.0, both], [0.0, both, 0.0]]])


def coriolis(theta, rate):
    """C (3, 3) by Christoffel's symbols: C_kj = sum_i (dM_kj/dtheta_i + dM_ki/dtheta_j - dM_ij/dtheta_k) rate_i / 2."""
    slopes = mass_slopes(theta)
    turned = slopes @ rate  # [j, k] = sum_i dM_ki/dtheta_j rate_i
    changing = (rate @ slopes.reshape(3, 9)).reshape(3, 3)
    return 0.5 * (changing + turned.T - turned)


def potential(theta):
    """Energy of gravity, J."""
    return P7 * np.sin(theta[1]) - P8 * np.cos(theta[2])


def gravity(theta):
    """N (3,), N m: the slope of the potential."""
    (_, _, s3), (_, c2, _) = sines(theta)
    return np.array([0.0, P7 * c2, P8 * s3])


def to_device(device, places):
    """Scene positions (3,) or (n, 3) in device axes."""
    return places @ device.rotation.T + device.offset


def to_scene(device, place):
    return (place - device.offset) @ device.rotation


def nearest_whole(value):
    """The nearest whole number; halves go away from zero."""
    return np.copysign(np.floor(np.abs(value) + 0.5), value)


def measured(device, theta):
    """The posture that the encoders on the motors tell."""
    if device.encoder_counts == 0:
        return theta
    return nearest_whole(theta * counts_per_radian(device)) / counts_per_radian(device)


def counts_per_radian(device):
    return device.capstan_ratio * device.encoder_counts / (2.0 * np.pi)


def count(device):
    """One count of the encoders at the joints (3,), rad; zero where angles are not quantised."""
    return 1.0 / counts_per_radian(device) if device.encoder_counts else np.zeros(3)


def applied(device, theta, currents):
    """Force at the tip, scene axes, N, of motor currents in a posture."""
    torque = device.capstan_ratio * device.torque_constant * currents
    return device.rotation.T @ np.linalg.solve(jacobian(theta).T, torque)


def currents(device, theta, force):
    """Motor currents (3,), A, commanded for a force at the tip in scene axes, N; `theta` is the measured posture."""
    force = device.rotation @ force
    size = np.linalg.norm(force)
    if size > device.largest_force:
        force = force * (device.largest_force / size)
    torque = jacobian(theta).T @ force
    current = np.clip(torque / (device.capstan_ratio * device.torque_constant), -device.largest_current,
                      device.largest_current)
    if device.torque_bits == 0:
        return current
    half = 2 ** (device.torque_bits - 1)
    step = device.largest_current / half
    return np.clip(nearest_whole(current / step), -half, half - 1) * step
