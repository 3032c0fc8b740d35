"""Traces: one row per tick, written, read and summarised."""

import csv

import numpy as np

from .scene import SceneError

COLUMNS = ("tick t qx qy qz fx fy fz fn ft mode triangle alpha beta gamma nx ny nz "
           "kinetic elastic gravitational work model_age").split()
# After the others, of an instrument that is a modelled device.
DEVICE_COLUMNS = "device_x device_y device_z contact_fx contact_fy contact_fz hand_energy".split()
# After those, of the massless scheme: kinetic energy of what is held, and the sum of its changes at the price of the mesh.
ENERGY_COLUMNS = ["contact_kinetic", "contact_exchange"]
FURTHER_COLUMNS = DEVICE_COLUMNS + ENERGY_COLUMNS
CONTACT_COLUMNS = ("triangle", "alpha", "beta", "gamma", "nx", "ny", "nz")  # empty in free ticks
MODES = ("free", "stick", "slide", "slip")
NO_TRIANGLE = -1


def table(run):
    """The trace of a run as columns: arrays of float, `mode` of str; what is empty in free ticks is NaN."""
    rows = run.rows
    empty = np.full(3, np.nan)
    force = np.array([row.force for row in rows]).reshape(-1, 3)
    results = [row.result for row in rows]
    normal = np.array([empty if result.normal is None else result.normal for result in results]).reshape(-1, 3)
    weights = np.array([empty if result.point is None else result.point.weights for result in results]).reshape(-1, 3)
    contact = np.isfinite(normal[:, 0])
    safe = np.where(contact[:, None], normal, 0.0)
    fn = (force * safe).sum(axis=1)
    q = np.array([row.q for row in rows]).reshape(-1, 3)
    energies = np.array([row.energies for row in rows]).reshape(-1, 3)
    tick = np.arange(len(rows))
    ft = np.where(contact, np.linalg.norm(force - fn[:, None] * safe, axis=1), 0.0)
    columns = {"tick": tick, "t": (tick + 1) * run.h, "fn": fn, "ft": ft,
               "mode": np.array([result.mode for result in results], dtype=str),
               "triangle": np.array([NO_TRIANGLE if result.point is None else result.point.triangle for result in results],
                                    dtype=int),
               "work": np.array([row.work for row in rows]), "model_age": np.array([row.model_age for row in rows], int)}
    for names, values in (("qx qy qz", q), ("fx fy fz", force), ("alpha beta gamma", weights), ("nx ny nz", normal),
                          ("kinetic elastic gravitational", energies)):
        columns.update(zip(names.split(), values.T))
    if rows and rows[0].device:
        columns |= zip(("contact_fx", "contact_fy", "contact_fz"), np.array([result.force for result in results]).T)
        columns |= {name: np.array([row.device[name] for row in rows]) for name in rows[0].device}
    if run.massless:
        columns["contact_kinetic"] = np.array([result.contact_kinetic for result in results])
        columns["contact_exchange"] = np.cumsum([sum(result.exchanged) for result in results])
    return {name: columns[name] for name in (*COLUMNS, *DEVICE_COLUMNS, *ENERGY_COLUMNS) if name in columns}


def write(columns, path):
    """Write a trace.csv; floats in shortest round-trip form, empty cells in free ticks."""
    with open(path, "w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        free = columns["mode"] == "free"
        for row in range(len(free)):
            cells = [values[row] for values in columns.values()]
            writer.writerow(["" if free[row] and name in CONTACT_COLUMNS else
                             cell if isinstance(cell, str) else repr(cell.item())
                             for name, cell in zip(columns, cells)])


def read(path):
    """Read a trace.csv; of further columns those of a device and of the massless scheme are kept, NaN as NaN."""
    try:
        with open(path, newline="") as file:
            rows = list(csv.reader(file))
    except OSError as error:
        raise SceneError(f"{path}: {error}") from None
    if not rows or rows[0][: len(COLUMNS)] != COLUMNS:
        raise SceneError(f"{path}: the header must begin with {','.join(COLUMNS)}")
    if any(len(row) != len(rows[0]) for row in rows):
        raise SceneError(f"{path}: rows of different length")
    cells = {name: np.array([row[index] for row in rows[1:]], dtype=str) for index, name in enumerate(rows[0])
             if index < len(COLUMNS) or name in FURTHER_COLUMNS}
    # A trace without a device, or of another scheme, may leave these columns empty.
    cells = {name: values for name, values in cells.items() if name not in FURTHER_COLUMNS or (values != "").any()}
    unknown = set(cells["mode"].tolist()) - set(MODES)
    if unknown:
        raise SceneError(f"{path}: unknown modes {sorted(unknown)}")
    free = cells["mode"] == "free"
    for name in cells:
        if ((cells[name] == "") != (free if name in CONTACT_COLUMNS else False)).any():
            raise SceneError(f"{path}: {name} must be empty in free ticks, and only there" if name in CONTACT_COLUMNS
                             else f"{path}: {name} has empty cells")
    try:
        return {name: parse(name, values) for name, values in cells.items()}
    except ValueError as error:
        raise SceneError(f"{path}: {error}") from None


def parse(name, cells):
    if name == "mode":
        return cells
    if name in ("tick", "triangle", "model_age"):
        return np.array([NO_TRIANGLE if cell == "" else int(cell) for cell in cells], dtype=int)
    return np.array([np.nan if cell == "" else float(cell) for cell in cells])


def summary(columns, run):
    """Counts and extremes of a run, for people."""
    force = np.stack([columns[name] for name in ("fx", "fy", "fz")], axis=1)
    size = np.linalg.norm(force, axis=1)
    return {"ticks": len(size), "modes": {mode: int((columns["mode"] == mode).sum()) for mode in MODES},
            "largest_force": float(size.max(initial=0.0)), "largest_fn": float(columns["fn"].max(initial=0.0)),
            "largest_ft": float(columns["ft"].max(initial=0.0)),
            "first_contact_tick": next((t for t, m in enumerate(columns["mode"]) if m != "free"), None),
            "contact_energy_created_j": sum(max(0.0, energy) for row in run.rows for energy in row.result.exchanged),
            "rigid_ticks": sum(row.result.rigid for row in run.rows),
            "inside_without_contact": run.inside_without_contact, "fault": run.fault}
