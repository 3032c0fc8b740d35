"""Whole traces against each other: a difference per tick and quantity, its distribution, and where it first goes wrong."""

import csv

import numpy as np

from .scene import SceneError
from .trace import DEVICE_COLUMNS, ENERGY_COLUMNS

# Relative to the largest value of the quantity in the reference. The same scene with its springs in another order, so
# with other rounding, differs by at most 2e-13 (3e-15 where nothing runs away): 1e-9 leaves room for another order of
# operations and for projections solved to 1e-12, and is far below anything a wrong term could do.
SCALED_TOLERANCE = 1e-9
# The same where contact is spread, whose weights are integrals by quadrature: to 1e-6 is asked of them.
SPREAD_TOLERANCE = 1e-5

VECTORS = {"force": ("fx", "fy", "fz"), "normal": ("nx", "ny", "nz"), "q": ("qx", "qy", "qz"),
           "device": ("device_x", "device_y", "device_z"), "contact_force": ("contact_fx", "contact_fy", "contact_fz")}
SCALARS = ("t", "fn", "ft", "kinetic", "elastic", "gravitational", "work", "hand_energy", "contact_kinetic",
           "contact_exchange")
EXACT = ("mode", "triangle", "model_age", "tick")
WEIGHTS = ("alpha", "beta", "gamma")


def tolerance(contact):
    """What differences may be, for a scene's [contact]."""
    return SPREAD_TOLERANCE if contact.radius > 0.0 else SCALED_TOLERANCE


def differences(expected, actual, triangles, positions, same_point=SCALED_TOLERANCE):
    """Per quantity (absolute, scaled) differences over the ticks both traces have.

    `positions` holds per tick the node positions on which the reference located its contact, None when free. Where just
    one of the traces is free, the contact quantities differ by NaN, which no tolerance accepts. Node weights as close as
    `same_point` name the same point, whichever of the triangles around it is named.
    """
    count = min(len(expected["t"]), len(actual["t"]))
    expected = {name: values[:count] for name, values in expected.items()}
    actual = {name: values[:count] for name, values in actual.items()}
    both_free = (expected["mode"] == "free") & (actual["mode"] == "free")
    found = {}
    absent = set(DEVICE_COLUMNS) - set(expected)
    if absent != set(DEVICE_COLUMNS) - set(actual):
        raise SceneError("one of the traces has a device, the other has not")
    if not set(actual).issuperset(set(expected).intersection(ENERGY_COLUMNS)):
        raise SceneError("the trace lacks columns of the massless scheme: " + ", ".join(ENERGY_COLUMNS))
    absent |= set(ENERGY_COLUMNS) - set(expected)
    for name, columns in VECTORS.items():
        if absent.intersection(columns):
            continue
        ours, theirs = (np.stack([trace[column] for column in columns], axis=1) for trace in (expected, actual))
        difference = np.linalg.norm(theirs - ours, axis=1)
        if name == "normal":
            difference = np.where(both_free, 0.0, difference)
        found[name] = scaled(difference, np.linalg.norm(ours, axis=1))
    for name in SCALARS:
        if name in absent:
            continue
        # fn and ft are parts of the force, and one of them can vanish: both are measured by the force.
        size = np.hypot(expected["fn"], expected["ft"]) if name in ("fn", "ft") else np.abs(expected[name])
        found[name] = scaled(np.abs(actual[name] - expected[name]), size)
    weights, points = contact_points(expected, actual, triangles, positions, both_free)
    found["weights"] = weights, weights
    found["point"] = scaled(points, edge_lengths(triangles, positions))
    wrong_triangle = (expected["triangle"] != actual["triangle"]) & ~(weights <= same_point)
    for name in EXACT:
        wrong = wrong_triangle if name == "triangle" else expected[name] != actual[name]
        found[name] = wrong.astype(float), wrong.astype(float)
    return found


def scaled(difference, size):
    largest = np.nanmax(size, initial=0.0)
    return difference, difference / (largest if largest > 0.0 else 1.0)


def edge_lengths(triangles, positions):
    """Edges of the surface at the first contact: distances between contact points are measured by the longest."""
    first = next((x for x in positions if x is not None), None)
    return np.zeros(1) if first is None else np.linalg.norm(first[triangles[:, 1]] - first[triangles[:, 0]], axis=1)


def contact_points(expected, actual, triangles, positions, both_free):
    """Per tick the largest difference of a node's weight, and the distance of the two contact points in space, m."""
    count = len(both_free)
    weights, distances = np.zeros(count), np.zeros(count)
    ours, theirs = (np.stack([trace[column] for column in WEIGHTS], axis=1) for trace in (expected, actual))
    for tick in np.flatnonzero(~both_free):
        one, other = expected["triangle"][tick], actual["triangle"][tick]
        if positions[tick] is None or not 0 <= other < len(triangles):
            weights[tick] = distances[tick] = np.nan
            continue
        by_node = np.zeros(len(positions[tick]))
        np.add.at(by_node, triangles[one], -ours[tick])
        np.add.at(by_node, triangles[other], theirs[tick])
        weights[tick] = np.abs(by_node).max()
        distances[tick] = np.linalg.norm(by_node @ positions[tick])
    return weights, distances


def judge(found, expected_rows, actual_rows, allowed=SCALED_TOLERANCE):
    """The verdict: per quantity the distribution of its differences and the first tick beyond tolerance."""
    quantities = {}
    for name, (absolute, relative) in found.items():
        limit = 0.0 if name in EXACT else allowed
        beyond = np.flatnonzero(~(relative <= limit))  # NaN is beyond every tolerance
        quantities[name] = {"tolerance": limit, "absolute": distribution(absolute), "scaled": distribution(relative),
                            "beyond": len(beyond), "first_beyond": int(beyond[0]) if len(beyond) else None}
    same_length = expected_rows == actual_rows
    passed = same_length and expected_rows > 0 and all(entry["beyond"] == 0 for entry in quantities.values())
    return {"pass": passed, "rows": {"reference": expected_rows, "trace": actual_rows}, "quantities": quantities}


def distribution(values):
    """q50, q99 and max; null stands for NaN or infinity."""
    finite = len(values) > 0 and np.isfinite(values).all()
    q50, q99, largest = np.quantile(values, [0.5, 0.99, 1.0]).tolist() if finite else (None, None, None)
    return {"q50": q50, "q99": q99, "max": largest}


def write_differences(found, path):
    """Every difference: a row per tick, absolute and scaled per quantity."""
    with open(path, "w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["tick", *(f"{name}_{kind}" for name in found for kind in ("absolute", "scaled"))])
        columns = [column for pair in found.values() for column in pair]
        for tick, values in enumerate(zip(*columns)):
            writer.writerow([tick, *(repr(float(value)) for value in values)])


def table(verdict):
    """The verdict as lines of text."""
    def number(value):
        return "not finite" if value is None else f"{value:.2e}"

    lines = [f"{'quantity':<17}{'q50':>11}{'q99':>11}{'max':>11}"
             f"{'scaled max':>12}{'tolerance':>11}{'beyond':>8}{'first':>7}"]
    for name, entry in verdict["quantities"].items():
        absolute = entry["absolute"]
        first = "" if entry["first_beyond"] is None else entry["first_beyond"]
        lines.append(f"{name:<17}{number(absolute['q50']):>11}{number(absolute['q99']):>11}{number(absolute['max']):>11}"
                     f"{number(entry['scaled']['max']):>12}{entry['tolerance']:>11.0e}{entry['beyond']:>8}{first:>7}")
    rows = verdict["rows"]
    lines.append(f"rows: {rows['reference']} in the reference, {rows['trace']} in the trace")
    lines.append("PASS" if verdict["pass"] else "FAIL")
    return lines
