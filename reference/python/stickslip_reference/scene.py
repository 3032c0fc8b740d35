"""Scene files: TOML with defaults filled in, and the instrument's path."""

import csv
import tomllib
from pathlib import Path
from typing import NamedTuple

import numpy as np


class SceneError(Exception):
    """A scene, network or trace that cannot be used."""


REQUIRED = object()
OPTIONAL = None

# section -> key -> default. REQUIRED has none; OPTIONAL keys stay None when the scene does not give them.
DEFAULTS = {
    "mesh": {"kind": "block", "nodes": OPTIONAL, "spacing": OPTIONAL, "stencil": "shear", "fixed": OPTIONAL,
             "path": OPTIONAL, "scale": 1.0, "layers": OPTIONAL, "layer_depth": OPTIONAL, "anchor": OPTIONAL},
    "material": {"node_mass": OPTIONAL, "density": OPTIONAL, "stiffness": OPTIONAL, "young_modulus": OPTIONAL,
                 "damping": OPTIONAL, "damping_ratio": OPTIONAL, "gravity": [0.0, 0.0, 0.0], "drag": 0.0},
    "global": {"rate": 10.0, "integrator": "semi-implicit-euler", "substeps": 100, "threads": 1},
    "local": {"rate": 1000.0, "model": "patch", "rings": 1, "linearization": "tangent", "exterior": "fixed",
              "tangent": "exact", "integrator": "semi-implicit-euler", "condense_rings": "all"},
    "contact": {"law": REQUIRED, "friction": OPTIONAL, "scheme": "geometric", "surface": "faceted",
                "radius": 0.0, "adhesion": 0.0, "deformation": "rigid", "metric": "euclidean", "wall_stiffness": 1000.0,
                "wall_damping": 0.0},
    "instrument": {"kind": "path", "waypoints": OPTIONAL, "file": OPTIONAL, "columns": OPTIONAL, "scale": OPTIONAL,
                   "start": OPTIONAL, "filter_hz": OPTIONAL, "interpolation": "linear", "force_limit": OPTIONAL,
                   "smoothing_ticks": 0, "passivity_control": False, "device": OPTIONAL, "hand": OPTIONAL, "coupling": OPTIONAL},
    "sync": {"mode": "replay", "latency_ticks": 0},
    "run": {"schedule": "lockstep"},
}

ANY, NOT_NEGATIVE, POSITIVE = "finite", "0 or more", "more than 0"
# Tables of a modelled device: key -> default, whose shape and kind the scene's value must have, and what it must be.
PHANTOM = {
    "device": {
        "rotation": ([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]], ANY),  # scene axes to device axes
        "offset": ([0.0, 0.0, 0.0], ANY),  # m
        "joint_friction": ([0.0086, 0.0086, 0.0068], NOT_NEGATIVE),  # N m
        "friction_speed": (0.01, POSITIVE),  # rad/s, at which friction is tanh 1 of the whole
        "joint_damping": (0.0005, NOT_NEGATIVE),  # N m s/rad
        "rotor_inertia": ([0.0, 0.0, 0.0], NOT_NEGATIVE),  # kg m^2 at the joints
        "capstan_ratio": ([13.3, 11.2, 11.2], POSITIVE),
        "torque_constant": (0.0234, POSITIVE),  # N m/A
        "largest_current": (5.5, POSITIVE),  # A
        "torque_bits": (16, NOT_NEGATIVE),  # 0: not quantised
        "encoder_counts": (4096, NOT_NEGATIVE),  # per turn of a motor; 0: not quantised
        "amplifier_bandwidth": (1000.0, POSITIVE),  # Hz
        "largest_force": (8.5, POSITIVE),  # N
        "substeps": (10, POSITIVE),
    },
    "hand": {  # along the device's x, y, z
        "mass": ([0.218, 0.269, 0.204], POSITIVE),  # kg
        "stylus_stiffness": ([379.5, 552.4, 769.9], NOT_NEGATIVE),  # N/m
        "stylus_damping": ([1.839, 3.609, 0.776], NOT_NEGATIVE),  # N s/m
        "arm_stiffness": ([78.75, 105.3, 271.7], NOT_NEGATIVE),
        "arm_damping": ([4.645, 6.430, 18.06], NOT_NEGATIVE),
    },
    "coupling": {"stiffness": (500.0, POSITIVE), "damping": (2.0, NOT_NEGATIVE), "mass": (0.05, POSITIVE)},
}
# instrument.device.structure, if there is one.
STRUCTURE = {"stiffness": (3500.0, POSITIVE), "tip_mass": (0.01, POSITIVE), "damping_ratio": (0.05, NOT_NEGATIVE)}
TIPS = ("quantised", "observed")  # instrument.device.tip
ORTHOGONAL = 1e-9  # what R^T R may differ from the identity by

# What this reference implements; anything else is refused rather than approximated.
COVERED = {
    ("global", "integrator"): ("semi-implicit-euler", "implicit-euler", "rk4"),
    ("global", "threads"): (1, 2),  # which changes no result
    ("local", "model"): ("patch", "full"),
    ("local", "linearization"): ("tangent", "none"),
    ("local", "exterior"): ("fixed", "drifting", "condensed"),
    ("local", "tangent"): ("exact", "stabilised"),
    ("local", "integrator"): ("semi-implicit-euler", "implicit-euler", "implicit-midpoint", "exponential"),
    ("contact", "law"): ("sliding", "sticking", "stick-slip"),
    ("contact", "scheme"): ("geometric", "velocity", "massless"),
    ("contact", "surface"): ("faceted", "shaded", "subdivision"),
    ("contact", "deformation"): ("rigid", "least-norm"),
    ("contact", "metric"): ("euclidean", "mass"),
    ("instrument", "kind"): ("path", "recording", "phantom-1.5"),
    ("instrument", "interpolation"): ("linear", "minimum-jerk"),
    ("sync", "mode"): ("replay", "overwrite"),
    ("run", "schedule"): ("lockstep",),
}


class Friction(NamedTuple):
    """Coefficients of a contact that sticks, or is new, and of one that slips."""

    static: float
    kinetic: float


class Section(dict):
    """A scene section whose keys read as attributes."""

    __getattr__ = dict.__getitem__


class Scene:
    """A scene with every default applied. `h` is the local tick in seconds, `cycle_ticks` the ticks of a cycle, `settle`
    whether it starts in equilibrium."""

    def __init__(self, table, folder="."):
        unknown = set(table) - set(DEFAULTS) - {"name", "duration", "settle"}
        if unknown:
            raise SceneError(f"unknown keys: {sorted(unknown)}")
        for section in ("mesh", "material", "contact", "instrument"):
            if section not in table:
                raise SceneError(f"[{section}] is missing")
        try:
            self.name, self.duration = table["name"], float(table["duration"])
        except KeyError as key:
            raise SceneError(f"{key} is missing") from None
        self.sections = {name: fill(name, table.get(name, {})) for name in DEFAULTS}
        for (section, key), values in COVERED.items():
            value = self.sections[section][key]
            if value not in values:
                raise SceneError(f"{section}.{key} = {value!r}: the reference covers {', '.join(values)}")

        self.h = 1.0 / self["local"].rate
        self.ticks = whole(self.duration * self["local"].rate, "duration must be a whole number of ticks")
        ticks = self["local"].rate / self["global"].rate
        self.cycle_ticks = whole(ticks, "local.rate must be a multiple of global.rate")
        if not 0 <= self["sync"].latency_ticks < self.cycle_ticks:
            raise SceneError("sync.latency_ticks must be less than a cycle")
        check_contact(self["contact"])
        scheme = self["contact"].scheme
        if scheme != "geometric" and {"deformation", "metric"} & set(table["contact"]):
            raise SceneError("contact.deformation and contact.metric go with scheme = \"geometric\"")
        if self["local"].integrator != "semi-implicit-euler" and (
                self["local"].model == "full" or self["local"].linearization != "tangent"
                or scheme == "geometric"):
            raise SceneError(f"local.integrator = {self['local'].integrator!r} needs the tangent and the velocity or massless "
                             "scheme")
        material = self["material"]
        if (material.damping is None) == (material.damping_ratio is None):
            raise SceneError("[material] needs either damping or damping_ratio")
        self.settle = table.get("settle", False)
        if type(self.settle) is not bool or (self.settle and not any(material.gravity)):
            raise SceneError("settle must be true or false, and true only with material.gravity")
        check_instrument(self["instrument"], "observed" if scheme == "massless" else "quantised")
        self.force_limit = force_limit(self["instrument"])
        self.folder = Path(folder)
        self.waypoints = read_waypoints(self["instrument"], self.folder)

    def __getitem__(self, section):
        return self.sections[section]

    def tip(self, tick):
        """Instrument tip at the start of `tick` (its end is the start of the next)."""
        times, places = self.waypoints[:, 0], self.waypoints[:, 1:]
        t = tick * self.h
        if self["instrument"].interpolation == "minimum-jerk":
            t, _ = minimum_jerk(t, times)
        return np.array([np.interp(t, times, place) for place in places.T])


def load(path):
    """Read a scene file."""
    try:
        with open(path, "rb") as file:
            table = tomllib.load(file)
    except (OSError, tomllib.TOMLDecodeError) as error:
        raise SceneError(f"{path}: {error}") from None
    return Scene(table, Path(path).parent)


def fill(name, given):
    defaults = DEFAULTS[name]
    unknown = set(given) - set(defaults)
    if unknown:
        raise SceneError(f"unknown keys in [{name}]: {sorted(unknown)}")
    section = Section(defaults) | given
    missing = [key for key, value in section.items() if value is REQUIRED]
    if missing:
        raise SceneError(f"[{name}] needs {', '.join(missing)}")
    return Section(section)


def whole(value, message):
    rounded = round(value)
    if rounded < 1 or not abs(value - rounded) <= 1e-9 * rounded:
        raise SceneError(message)
    return rounded


def minimum_jerk(t, times):
    """The time at which linear interpolation is where minimum jerk is at t, and its rate: s = 10 tau^3 - 15 tau^4 + 6 tau^5 of the way.

    T. Flash, N. Hogan, The coordination of arm movements, J. Neurosci. 5 (1985). No velocity or acceleration at waypoints.
    """
    if not times[0] <= t < times[-1]:
        return t, 1.0
    piece = int(np.searchsorted(times, t, side="right")) - 1
    start, end = times[piece], times[piece + 1]
    tau = (t - start) / (end - start)
    return start + tau**3 * (10.0 - 15.0 * tau + 6.0 * tau**2) * (end - start), 30.0 * tau**2 * (1.0 - tau) ** 2


def check_contact(contact):
    """Checks friction and adhesion; makes a friction that is given a Friction."""
    if (contact.law == "stick-slip") != (contact.friction is not OPTIONAL):
        raise SceneError("contact.friction goes with law = \"stick-slip\", and only with it")
    if contact.friction is not OPTIONAL:
        contact["friction"] = read_friction(contact.friction)
    if not is_number(contact.radius) or not (np.isfinite(contact.radius) and contact.radius >= 0.0):
        raise SceneError(f"contact.radius = {contact.radius!r} must be a finite number, 0 or more")
    if contact.radius > 0.0 and contact.surface == "shaded":
        raise SceneError("contact.radius goes with surface = \"faceted\" or \"subdivision\" in the reference")
    adhesion = contact.adhesion
    if not is_number(adhesion) or not adhesion >= 0.0:
        raise SceneError(f"contact.adhesion = {adhesion!r} must be a number, 0 or more")
    if contact.law != "sticking" and not np.isfinite(adhesion):
        raise SceneError("contact.adhesion = inf goes with law = \"sticking\"")


def read_friction(given):
    pair = given if isinstance(given, dict) else {"static": given, "kinetic": given}
    if set(pair) != {"static", "kinetic"}:
        raise SceneError("contact.friction is a number or { static = ..., kinetic = ... }")
    if not all(is_number(value) and np.isfinite(value) and value >= 0.0 for value in pair.values()):
        raise SceneError(f"contact.friction = {given!r}: a coefficient must be finite, 0 or more")
    friction = Friction(**pair)
    if not friction.static >= friction.kinetic:
        raise SceneError("contact.friction.static must be at least contact.friction.kinetic")
    return friction


def is_number(value):
    return type(value) in (int, float)


def check_instrument(instrument, default_tip):
    """Checks the keys of [instrument] but the path; makes the tables of a modelled device Sections."""
    ticks = instrument.smoothing_ticks
    if type(ticks) is not int or ticks < 0:
        raise SceneError(f"instrument.smoothing_ticks = {ticks!r} must be a whole number, 0 or more")
    if type(instrument.passivity_control) is not bool:
        raise SceneError("instrument.passivity_control must be true or false")
    if instrument.kind != "phantom-1.5":
        if instrument.passivity_control or any(instrument[part] is not OPTIONAL for part in PHANTOM):
            raise SceneError(f"instrument.passivity_control, {', '.join(PHANTOM)} go with kind = \"phantom-1.5\"")
        return
    if (instrument.file is OPTIONAL) == (instrument.waypoints is OPTIONAL):
        raise SceneError("the hand follows either instrument.waypoints or instrument.file")
    if instrument.force_limit is not OPTIONAL:
        raise SceneError("instrument.force_limit goes with a path")
    tip, structure = default_tip, None
    if isinstance(instrument.device, dict):
        tip, structure = instrument.device.get("tip", tip), instrument.device.get("structure")
        instrument["device"] = {key: value for key, value in instrument.device.items() if key not in ("tip", "structure")}
    instrument["structure"] = None if structure is None else read_part("device.structure", structure)
    if tip not in TIPS:
        raise SceneError(f"instrument.device.tip = {tip!r} must be one of {', '.join(TIPS)}")
    if tip == "observed" and instrument.coupling is not OPTIONAL:
        raise SceneError("instrument.device.tip = \"observed\" goes without coupling in the reference")
    for part in PHANTOM:
        if part != "coupling" or instrument.coupling is not OPTIONAL:  # without the table there is no coupling
            instrument[part] = read_part(part, {} if instrument[part] is OPTIONAL else instrument[part])
    instrument["device"]["tip"] = tip
    R = instrument["device"].rotation
    if not (np.abs(R.T @ R - np.eye(3)).max() <= ORTHOGONAL and np.linalg.det(R) > 0.0):
        raise SceneError("instrument.device.rotation must be a rotation: orthogonal rows of length 1, right-handed")


def force_limit(instrument):
    """The contact force that ends a run, N: a hundred times the device's largest force, or the limit of a path."""
    if instrument.kind == "phantom-1.5":
        return 100.0 * instrument["device"].largest_force
    limit = 100.0 * PHANTOM["device"]["largest_force"][0] if instrument.force_limit is OPTIONAL else instrument.force_limit
    if not (is_number(limit) and np.isfinite(limit) and limit > 0.0):
        raise SceneError(f"instrument.force_limit = {limit!r} must be a finite number above 0")
    return limit


def read_part(part, given):
    keys = STRUCTURE if part == "device.structure" else PHANTOM[part]
    if not isinstance(given, dict) or set(given) - set(keys):
        raise SceneError(f"[instrument.{part}] is a table of {', '.join(keys)}")
    return Section({key: read_number(f"instrument.{part}.{key}", given.get(key, default), default, rule)
                    for key, (default, rule) in keys.items()})


def read_number(name, value, default, rule):
    """A number or an array of the default's shape, whole where the default is, that is what the rule says."""
    try:
        numbers = np.array(value)
    except ValueError:
        numbers = np.array(None)
    if numbers.shape != np.shape(default) or numbers.dtype.kind not in ("i" if type(default) is int else "if"):
        kind = "a whole number" if type(default) is int else "numbers" if np.shape(default) else "a number"
        raise SceneError(f"{name} = {value!r} must be {kind} like {default}")
    if not (np.isfinite(numbers) & ((rule == ANY) | (numbers > 0) | ((rule == NOT_NEGATIVE) & (numbers == 0)))).all():
        raise SceneError(f"{name} = {value!r} must be {rule}")
    return numbers.astype(float) if np.shape(default) else numbers.item()


def low_pass(points, hz):
    """A first-order low-pass of the piecewise linear motion through rows t, x, y, z, in the order of the rows."""
    result = points.copy()
    for row in range(1, len(points)):
        phase = 2.0 * np.pi * hz * abs(points[row, 0] - points[row - 1, 0])
        lag = (points[row, 1:] - points[row - 1, 1:]) / phase
        result[row, 1:] = points[row, 1:] - lag + (result[row - 1, 1:] - points[row - 1, 1:] + lag) * np.exp(-phase)
    return result


def read_waypoints(instrument, folder):
    """Rows t, x, y, z of a path or of a recording."""
    if instrument.file is not OPTIONAL:
        with open(folder / instrument.file, newline="") as file:
            rows = list(csv.reader(file))
        columns = instrument.columns or ["t", "x", "y", "z"]
        if instrument.columns is OPTIONAL and rows[0] != columns:
            raise SceneError(f"{instrument.file}: the header must be t,x,y,z")
        points = np.array([[row[rows[0].index(column)] for column in columns] for row in rows[1:]], dtype=float)
        points[:, 0] -= instrument.start or 0.0
        points[:, 1:] *= 1.0 if instrument.scale is OPTIONAL else instrument.scale
        if instrument.filter_hz is not OPTIONAL:
            points = np.flip(low_pass(np.flip(low_pass(points, instrument.filter_hz), axis=0), instrument.filter_hz), axis=0)
    else:
        points = np.array(instrument.waypoints, dtype=float)
    if points.ndim != 2 or points.shape[1] != 4 or not np.isfinite(points).all() or not (np.diff(points[:, 0]) > 0).all():
        raise SceneError("waypoints must be finite rows t, x, y, z with increasing t")
    return points
