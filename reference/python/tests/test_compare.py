"""The comparison must find what is wrong: broken physics, and broken traces."""

import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from setups import scene, script
from stickslip_reference import comparison, cycle, local_model, tick, trace
from stickslip_reference import network as net
from stickslip_reference.scene import SceneError
from stickslip_reference.surface import Point, Surface

HERE = Path(__file__).parents[1]
# Starts within a tick, so that the rewind to the time of collision moves something, and lifts off again, fast enough that
# the mesh lags behind the tip.
WAYPOINTS = [[0.0, -0.03, 0.0013, 0.00051], [0.14, -0.03, 0.0013, -0.003], [0.35, -0.0195, 0.0013, -0.003],
             [0.36, -0.0195, 0.0013, 0.002], [0.4, -0.0195, 0.0013, 0.002]]


def setup():
    read = scene(duration=0.4, instrument={"waypoints": WAYPOINTS}, material={"gravity": [0.0, 0.0, -1.0]})
    return read, net.block(read)


def compared(expected_run, network, columns):
    expected = trace.table(expected_run)
    found = comparison.differences(expected, columns, network.triangles, [row.result.at for row in expected_run.rows])
    return comparison.judge(found, len(expected["t"]), len(columns["t"]))


@pytest.fixture(scope="module")
def reference():
    read, network = setup()
    return read, network, cycle.run(read, network)


def test_the_scene_exercises_what_is_broken_below(reference):
    columns = trace.table(reference[2])
    assert set(columns["mode"]) == {"free", "stick", "slip"}
    assert columns["mode"][-1] == "free" and (columns["mode"][:300] == "slip").sum() > 20


def test_another_order_of_springs_passes(reference, within):
    """Other rounding, same physics: the headroom of the tolerance."""
    read, network, expected = reference
    order = np.random.default_rng(1).permutation(len(network.ends))
    shuffled = dataclasses.replace(network, ends=network.ends[order][:, ::-1], stiffness=network.stiffness[order],
                                   damping=network.damping[order], rest_length=network.rest_length[order])
    verdict = compared(expected, network, trace.table(cycle.run(read, shuffled)))
    assert verdict["pass"]
    worst = max(entry["scaled"]["max"] for entry in verdict["quantities"].values())
    within("another order of springs, worst quantity", worst, comparison.SCALED_TOLERANCE)
    assert worst > 0.0


def geometric_part_left_out(network, x, v, stabilised=False):
    u = x[network.ends[:, 1]] - x[network.ends[:, 0]]
    u = u / np.linalg.norm(u, axis=1)[:, None]
    uu = u[:, :, None] * u[:, None, :]
    return network.stiffness[:, None, None] * uu, network.damping[:, None, None] * uu


def linear_state_not_accumulated(self, x, v, elapsed):
    return self.f0 + 0.0 * x[self.patch]


def without_exterior_rest(network, options, x0, v0, tick, anchor, contact_nodes):
    patch = local_model.select_patch(network, local_model.centre_node(network, x0, anchor), options.rings, contact_nodes)
    return local_model.TangentModel(network, patch, x0, v0, tick, False)


def components_of_f(ops, f, normal, friction, adhesion):
    """(24) read with f_i instead of the constraint forces of (23)."""
    along = (f @ normal)[:, None] * normal
    across = f - along
    return along + friction * np.linalg.norm(along, axis=1)[:, None] * across / np.linalg.norm(across, axis=1)[:, None]


def replaced_source(old, new):
    """`advance` with one expression of its source replaced."""
    source = Path(tick.__file__).read_text()
    assert source.count(old) == 1
    space = {"__name__": tick.__name__, "__package__": tick.__package__, "Contact": tick.Contact}
    exec(compile(source.replace(old, new), tick.__file__, "exec"), space)
    return space["advance"]


CONTROLS = {
    "damping sign flipped": ("network", None),
    "Jacobian without its geometric part": (net, "spring_jacobians", geometric_part_left_out),
    "linear state not accumulated": (local_model.TangentModel, "forces", linear_state_not_accumulated),
    "stale linearisation": (cycle.GlobalNetwork, "linearise", None),
    "exterior velocity not zeroed": (local_model, "build", without_exterior_rest),
    "(24) with f": (tick, "friction_forces", components_of_f),
    "force dropped to zero at slip": ('options.friction.kinetic * bearing * tangential', '0.0 * tangential'),
    "impulse reported as force": ("Result(mode, force, point, normal, x)", "Result(mode, h * force, point, normal, x)"),
    "tensile force passed on": ("if normal_force <= -options.adhesion:", "if False:"),
    "rewind left out": ("tau, point = hit", "tau, point = 0.0, hit[1]"),
    "force before the deformation": ("f = model.forces(deformed, v, elapsed)", "f = model.forces(x, v, elapsed)"),
    "no friction on the mesh at slip": ("f[place] -= friction_forces(ops, f[place], normal, options.friction.kinetic, options.adhesion * weights)", "pass"),
    "wall velocity kept": ("v_new[nodes] = (constraint @ v_new[nodes].ravel()).reshape(-1, 3)", "pass"),
    "stick by Q": ('"stick", multiplier, ops.P', '"stick", multiplier, ops.Q'),
}


@pytest.mark.parametrize("control", CONTROLS)
def test_broken_physics_fails(reference, monkeypatch, control):
    read, network, expected = reference
    change = CONTROLS[control]
    used = network
    if control == "damping sign flipped":
        used = dataclasses.replace(network, damping=-network.damping)
    elif control == "stale linearisation":
        first, original = {}, cycle.GlobalNetwork.linearise

        def stale(self, state, number, tip):
            first.setdefault("model", original(self, state, number, tip))
            return first["model"]
        monkeypatch.setattr(cycle.GlobalNetwork, "linearise", stale)
    elif isinstance(change[0], str):
        monkeypatch.setattr(cycle, "advance", replaced_source(*change))
    else:
        monkeypatch.setattr(*change)
    verdict = compared(expected, network, trace.table(cycle.run(read, used)))
    first = [entry["first_beyond"] for entry in verdict["quantities"].values() if entry["first_beyond"] is not None]
    print(control, min(first, default=None), verdict["rows"])
    assert not verdict["pass"] and (first or verdict["rows"]["trace"] < verdict["rows"]["reference"])


def test_release_on_a_gap_fails(monkeypatch):
    """Letting go as soon as the force is tensile loses the contact while the tip is inside: it tunnels."""
    read = scene("sticking", duration=0.45)
    network = net.block(read)
    expected = cycle.run(read, network)
    keep = "predicted.contact = replace(state.contact or Contact(point), point=point, tension=True)"
    monkeypatch.setattr(cycle, "advance", replaced_source(keep, "pass"))
    verdict = compared(expected, network, trace.table(cycle.run(read, network)))
    assert not verdict["pass"] and verdict["quantities"]["mode"]["beyond"] > 0


def columns_of(run):
    return {name: values.copy() for name, values in trace.table(run).items()}


@pytest.mark.parametrize("name", [name for name in trace.COLUMNS if name not in ("mode", "triangle", "tick", "model_age")])
def test_a_nan_in_any_column_fails_at_its_tick(reference, name):
    _, network, expected = reference
    columns = columns_of(expected)
    at = 200
    assert columns["mode"][at] != "free"
    columns[name][at] = np.nan
    verdict = compared(expected, network, columns)
    assert not verdict["pass"]
    assert at in [entry["first_beyond"] for entry in verdict["quantities"].values()]


@pytest.mark.parametrize("name, value", [("mode", "slide"), ("mode", "free"), ("triangle", 0), ("triangle", 10**6),
                                         ("model_age", 7), ("tick", 3)])
def test_a_wrong_cell_is_counted_and_localised(reference, name, value):
    _, network, expected = reference
    columns = columns_of(expected)
    columns[name][200] = value
    verdict = compared(expected, network, columns)
    entry = verdict["quantities"][name]
    assert not verdict["pass"] and entry["beyond"] == 1 and entry["first_beyond"] == 200


def test_a_shorter_trace_on_either_side_fails(reference):
    _, network, expected = reference
    columns = columns_of(expected)
    shorter = {name: values[:-1] for name, values in columns.items()}
    verdict = compared(expected, network, shorter)
    assert not verdict["pass"] and all(entry["beyond"] == 0 for entry in verdict["quantities"].values())
    cut = dataclasses.replace(expected, rows=expected.rows[:-1])
    assert not compared(cut, network, columns)["pass"]
    nothing = {name: values[:0] for name, values in columns.items()}
    assert not compared(dataclasses.replace(expected, rows=[]), network, nothing)["pass"]


def test_a_point_on_a_shared_edge_is_the_same_under_either_triangle(reference):
    _, network, expected = reference
    surface = Surface(network.triangles)
    at = 200
    row = expected.rows[at]
    triangle = row.result.point.triangle
    across = int(surface.neighbours[triangle, 0])
    share = {surface.triangles[triangle, 1]: 0.25, surface.triangles[triangle, 2]: 0.75}
    ours, theirs = (np.array([share.get(node, 0.0) for node in surface.triangles[t]]) for t in (triangle, across))
    run = dataclasses.replace(expected, rows=list(expected.rows))
    run.rows[at] = dataclasses.replace(row, result=dataclasses.replace(row.result, point=Point(triangle, ours)))
    columns = columns_of(run)
    columns["triangle"][at] = across
    for size, passes in ((0.0, True), (5e-10, True), (1e-6, False)):
        weights = theirs + size * np.array([1.0, -1.0, 0.0])
        for name, weight in zip(("alpha", "beta", "gamma"), weights):
            columns[name][at] = weight
        assert compared(run, network, columns)["pass"] == passes


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    (folder / "scene.toml").write_text('''
name = "short"
duration = 0.1
mesh = { nodes = [4, 4, 3], spacing = 0.0125 }
material = { node_mass = 0.01, stiffness = 100.0, damping = 0.5 }
contact = { law = "stick-slip", friction = 1.0 }
instrument = { waypoints = [[0.0, 0.001, 0.0013, 0.001], [0.05, 0.001, 0.0013, -0.002], [0.1, 0.004, 0.0013, -0.002]] }
''')
    done = call("simulate.py", folder / "scene.toml", "--out", folder / "trace.csv",
                "--write-network", folder / "network.json")
    assert done.returncode == 0, done.stderr
    return folder


def call(name, *arguments):
    return subprocess.run([sys.executable, HERE / name, *arguments], capture_output=True, text=True)


def compare(folder, out, run=script, **files):
    paths = {"trace": folder / "trace.csv", "network": folder / "network.json"} | files
    return run("compare.py", folder / "scene.toml", "--trace", paths["trace"], "--network", paths["network"], "--out", out)


def test_compare_passes_on_the_references_own_trace(files, tmp_path):
    done = compare(files, tmp_path, run=call)
    assert done.returncode == 0, done.stdout + done.stderr
    verdict = json.loads((tmp_path / "reference-comparison.json").read_text())
    assert verdict["pass"] and verdict["rows"] == {"reference": 100, "trace": 100}
    # A trace keeps every bit, so its own differences are all zero.
    assert all(entry["absolute"]["max"] == 0.0 for entry in verdict["quantities"].values())
    assert len((tmp_path / "reference-differences.csv").read_text().splitlines()) == 101


@pytest.mark.parametrize("contact", ['surface = "subdivision"', 'scheme = "velocity"', 'scheme = "massless"',
                                     'surface = "subdivision", scheme = "velocity"', 'adhesion = 0.1, scheme = "massless"'])
def test_compare_takes_every_surface_and_scheme(files, tmp_path, contact):
    text = (files / "scene.toml").read_text()
    (tmp_path / "scene.toml").write_text(text.replace("friction = 1.0", f"friction = 1.0, {contact}"))
    done = script("simulate.py", tmp_path / "scene.toml", "--network", files / "network.json",
                "--out", tmp_path / "trace.csv")
    assert done.returncode == 0 and '"inside_without_contact": 0' in done.stdout, done.stderr
    done = compare(tmp_path, tmp_path, network=files / "network.json")
    assert done.returncode == 0, done.stdout + done.stderr
    assert (tmp_path / "trace.csv").read_text() != (files / "trace.csv").read_text()


def test_columns_of_the_massless_scheme_are_compared():
    read = scene(duration=0.3, instrument={"waypoints": WAYPOINTS}, contact={"scheme": "massless", "friction": 0.3})
    network = net.block(read)
    expected = cycle.run(read, network)
    columns = columns_of(expected)
    assert list(columns)[-2:] == ["contact_kinetic", "contact_exchange"] and compared(expected, network, columns)["pass"]
    for name in ("contact_kinetic", "contact_exchange"):
        assert np.abs(columns[name]).max() > 1e-9
        for change in (np.nan, 1e-6 * np.abs(columns[name]).max()):
            wrong = columns | {name: columns[name].copy()}
            wrong[name][250] += change
            verdict = compared(expected, network, wrong)
            assert not verdict["pass"] and verdict["quantities"][name]["first_beyond"] == 250
        with pytest.raises(SceneError):
            compared(expected, network, {key: values for key, values in columns.items() if key != name})


def test_compare_exit_codes(files, tmp_path):
    text = (files / "trace.csv").read_text()
    lines = text.splitlines()

    def edited(cell, value):
        cells = lines[80].split(",")
        cells[trace.COLUMNS.index(cell)] = value
        path = tmp_path / "edited.csv"
        path.write_text("\n".join([*lines[:80], ",".join(cells), *lines[81:]]) + "\n")
        return path

    assert compare(files, tmp_path, trace=edited("fz", "NaN")).returncode == 1
    assert compare(files, tmp_path, trace=edited("fz", "1.0")).returncode == 1
    assert compare(files, tmp_path, trace=edited("fz", "")).returncode == 2
    assert compare(files, tmp_path, trace=edited("fz", "high")).returncode == 2
    assert compare(files, tmp_path, trace=edited("mode", "glide")).returncode == 2
    assert compare(files, tmp_path, trace=tmp_path / "absent.csv").returncode == 2
    assert compare(files, tmp_path, network=files / "trace.csv").returncode == 2
    shorter = tmp_path / "shorter.csv"
    shorter.write_text("\n".join(lines[:-1]) + "\n")
    assert compare(files, tmp_path, trace=shorter).returncode == 1
    wider = tmp_path / "wider.csv"
    wider.write_text("\n".join(line + ",0" for line in lines) + "\n")
    assert compare(files, tmp_path, trace=wider).returncode == 0


def test_compare_goes_through_all_scenes_whatever_becomes_of_one(files, tmp_path):
    def run(name, change=lambda text: text):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "network.json").write_bytes((files / "network.json").read_bytes())
        (folder / "trace.csv").write_text(change((files / "trace.csv").read_text()))
        scene = tmp_path / f"{name}.toml"
        scene.write_bytes((files / "scene.toml").read_bytes())
        return scene

    def several(*scenes):
        done = call("compare.py", *scenes, "--runs", tmp_path)
        return done.returncode, done.stdout

    absent, same = tmp_path / "absent.toml", run("same")
    shorter = run("shorter", lambda text: text[: text.rstrip().rindex("\n") + 1])
    crashes = run("crashes")
    (tmp_path / "crashes" / "reference-differences.csv").mkdir()  # cannot be written
    again = run("again")
    assert several(same, again)[0] == 0
    assert several(same, shorter, again)[0] == 1
    status, text = several(absent, same, shorter, crashes, again)
    assert status == 2 and "2 of 5 traces" in text
    for scene, outcome in ((absent, "could not be compared"), (shorter, "differs"), (crashes, "could not be compared")):
        assert f"{scene}: {outcome}" in text
    for name, passes in (("same", True), ("shorter", False), ("again", True)):
        assert json.loads((tmp_path / name / "reference-comparison.json").read_text())["pass"] == passes
    assert script("compare.py", same, again).returncode == 2
    assert script("compare.py", same, "--runs", tmp_path, "--out", tmp_path).returncode == 2
