"""The loop through the modelled device: what stands between it and the contact, scenes, runs, comparison."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from setups import scene, script
from stickslip_reference import comparison, cycle, phantom, trace
from stickslip_reference import network as net
from stickslip_reference.instrument import Coupling, PassivityControl, Phantom, Smoothing
from stickslip_reference.scene import SceneError

ROUNDING_TOLERANCE = 1e-13  # N, m or J, of sizes of 1 at most. Measured: 8.9e-16.
ENERGY_BOOK_TOLERANCE = 1e-15  # J: a damper's work against what was missing, of millijoules. Measured: 2e-18.
# Fixed point of the coupling, m, after a second. Measured: 8.0e-15.
REST_TOLERANCE = 1e-12

# Down in 0.1 s and along x: collides, sticks and slips on a soft block.
WAYPOINTS = [[0.0, -0.012, 0.0013, 0.001], [0.08, -0.012, 0.0013, -0.014], [0.25, 0.015, 0.0013, -0.014]]


def drag(duration=0.25, waypoints=WAYPOINTS, **sections):
    sections["instrument"] = {"kind": "phantom-1.5", "waypoints": waypoints} | sections.get("instrument", {})
    sections["mesh"] = {"nodes": [5, 5, 3]}
    sections["contact"] = {"friction": 0.4} | sections.get("contact", {})
    return scene(duration=duration, **sections)


def ran(read):
    network = net.block(read)
    run = cycle.run(read, network)
    assert run.fault is None and run.inside_without_contact == 0
    return network, run, trace.table(run)


def stack(columns, names):
    return np.stack([columns[name] for name in names.split()], axis=1)


def test_smoothing_by_hand():
    """A step from 2 N to 6 N fades over three ticks: 3, 4, 5; a second hand-over starts from what was felt."""
    smoothing = Smoothing(3)

    def felt(force, new_model):
        return smoothing.smoothed(np.array([force, 0.0, 0.0]), new_model)[0]
    assert felt(2.0, False) == 2.0
    assert [felt(6.0, first) for first in (True, False, False, False)] == [3.0, 4.0, 5.0, 6.0]
    assert [felt(10.0, True), felt(7.0, False)] == [7.0, 5.0]  # a gap of -4
    assert [felt(1.0, first) for first in (True, False, False, False)] == [4.0, 3.0, 2.0, 1.0]


def test_no_smoothing_changes_nothing():
    smoothing, force = Smoothing(0), np.array([0.1, 0.2, 0.3])
    for _ in range(2):
        assert smoothing.smoothed(force, True) is force


def test_one_tick_of_a_coupling_by_hand(within):
    """k = 100, b = 2, m = 0.5, h = 0.1: v = 0.2 (100 * 0.03 + 2 * 0.3 + 1) = 0.92, x = 0.092."""
    coupling = Coupling(SimpleNamespace(stiffness=100.0, damping=2.0, mass=0.5), np.zeros(3), 0.1)
    coupling.contact_force = np.array([1.0, 0.0, 0.0])
    coupling.move(np.array([0.03, 0.0, 0.0]), np.array([0.3, 0.0, 0.0]))
    within("velocity and place", [abs(coupling.v[0] - 0.92), abs(coupling.x[0] - 0.092)], ROUNDING_TOLERANCE)
    on_device = coupling.command(np.zeros(3))
    within("force, N", np.abs(on_device - [-(100.0 * (0.03 - 0.092) + 2.0 * (0.3 - 0.92)), 0.0, 0.0]).max(),
           ROUNDING_TOLERANCE)


def test_a_coupling_at_rest_passes_the_force_on(within):
    """The mass lies where its spring carries the contact's force, and the device feels that force."""
    coupling = Coupling(SimpleNamespace(stiffness=500.0, damping=20.0, mass=0.05), np.zeros(3), 1e-3)
    device, force = np.array([0.001, 0.002, -0.003]), np.array([0.0, 0.1, 0.8])
    for _ in range(1000):
        coupling.move(device, np.zeros(3))
        felt = coupling.command(force)
    within("place, m", np.abs(coupling.x - device - force / 500.0).max(), REST_TOLERANCE)
    within("force on the device, N", np.abs(felt - force).max(), 500.0 * REST_TOLERANCE)


def test_passivity_control_damps_what_is_missing(within):
    """The balance counts the forces as they were held; while it is below zero, the damper's work restores what is missing."""
    rng = np.random.default_rng(3)
    control, book, held, changed = PassivityControl(), 0.0, np.zeros(3), 0
    # A tip that wanders, so that a damper meets the motion it was made for; at rest every seventh tick.
    angle = np.cumsum(0.02 * rng.normal(size=2001))
    ways = 1e-3 * np.stack([np.cos(angle), np.sin(angle), 0.1 * rng.normal(size=2001)], axis=1)
    ways[::7] = 0.0
    for moved, ahead in zip(ways, ways[1:]):
        # Forces that push the tip on where it goes next give energy out.
        force = rng.normal(size=3) + 300.0 * ahead
        book -= held @ moved
        damped = control.damped(force, moved)
        if book < 0.0 and moved.any():
            changed += 1
            within("work of the damper, J", abs((damped - force) @ moved - book), ENERGY_BOOK_TOLERANCE)
        else:
            assert damped is force
        held = control.held = damped
    assert changed > 100


def test_the_damper_acts_along_the_motion_only():
    control = PassivityControl()
    force = control.held = np.array([2.0, 1.0, -1.0])
    damped = control.damped(force, np.array([1e-4, 0.0, 0.0]))
    assert np.allclose(damped, [0.0, 1.0, -1.0], rtol=0.0, atol=ROUNDING_TOLERANCE)


@pytest.fixture(scope="module")
def direct():
    read = drag()
    return read, *ran(read)


def test_the_loop_takes_the_force_of_the_tick_before(direct):
    """The tip of every tick, from the commands in the trace alone."""
    read, _, _, columns = direct
    assert {"free", "stick", "slip"} <= set(columns["mode"])
    device = Phantom(read)
    tips, true, energies = [], [], []
    for tick, force in enumerate(stack(columns, "fx fy fz")):
        device.move(tick)
        tips.append(device.tip)
        true.append(stack({name: np.array([value]) for name, value in device.state().items()},
                          "device_x device_y device_z")[0])
        energies.append(device.state()["hand_energy"])
        device.currents = phantom.currents(device.device, device.posture, force)
    assert np.array_equal(tips, stack(columns, "qx qy qz"))
    assert np.array_equal(true, stack(columns, "device_x device_y device_z"))
    assert np.array_equal(energies, columns["hand_energy"])
    # Half a count per joint, and little more since joints add up: the tip measured is not the true one.
    assert 1e-6 < np.abs(np.subtract(tips, true)).max() < 50e-6


def test_contact_pushes_the_hand_back(direct):
    """The tip stays behind where the same hand goes in the air; what holds it there is the contact's force."""
    read, _, _, columns = direct
    free = Phantom(read)
    for tick in range(read.ticks):
        free.move(tick)
        if tick == 100:
            assert columns["qz"][tick] - free.tip[2] > 2e-3 and columns["fn"][tick] > 0.5


def test_forces_and_work_without_coupling(direct, within):
    _, _, _, columns = direct
    commanded, contact = stack(columns, "fx fy fz"), stack(columns, "contact_fx contact_fy contact_fz")
    assert np.array_equal(commanded, contact)
    q = stack(columns, "qx qy qz")
    work = -np.cumsum((contact[1:] * np.diff(q, axis=0)).sum(axis=1))
    assert columns["work"][0] == 0.0  # the first tick is free
    within("work, J", np.abs(columns["work"][1:] - work).max(), ROUNDING_TOLERANCE)


def test_a_coupled_passive_smoothed_run(within):
    """The contact sees the coupling's mass, the force commanded is the coupling's, damped; its energy balance stays above 0."""
    read = drag(instrument={"coupling": {"stiffness": 400.0}, "passivity_control": True, "smoothing_ticks": 5})
    _, _, columns = ran(read)
    commanded, contact = stack(columns, "fx fy fz"), stack(columns, "contact_fx contact_fy contact_fz")
    assert {"stick", "slip"} <= set(columns["mode"]) and np.abs(commanded - contact).max() > 0.01
    # Once more, from the contact's forces alone.
    device, smoothing = Phantom(read), Smoothing(5)
    assert device.coupling.options.stiffness == 400.0 and device.coupling.options.damping == 2.0
    for tick, force in enumerate(contact):
        device.move(tick)
        within("simulated tip, m", np.abs(device.tip - stack(columns, "qx qy qz")[tick]).max(), 0.0)
        felt = device.command(smoothing.smoothed(force, tick in (100, 200)))
        within("force commanded, N", np.abs(felt - commanded[tick]).max(), 0.0)
    free = columns["mode"] == "free"
    assert np.abs(commanded[free]).max() > 0.0 and not columns["fn"][free].any() and not columns["ft"][free].any()


def test_smoothing_of_a_path():
    """The force commanded fades from the last one; what the contact does and its work are the same."""
    def table(ticks):
        waypoints = [[0.0, -0.012, 0.0013, 0.001], [0.25, 0.012, 0.0013, -0.012]]
        return ran(scene(duration=0.25, mesh={"nodes": [5, 5, 3]},
                         instrument={"waypoints": waypoints, "smoothing_ticks": ticks}))[2]
    plain, smooth = table(0), table(4)
    assert np.array_equal(plain["work"], smooth["work"]) and np.array_equal(plain["qx"], smooth["qx"])
    assert "device_x" not in plain
    changed = np.flatnonzero(plain["fz"] != smooth["fz"])
    assert changed.tolist() == [100, 101, 102, 103, 200, 201, 202, 203]
    gap = smooth["fz"][99] - plain["fz"][100]
    added = (smooth["fz"] - plain["fz"])[100:104]
    assert np.allclose(added, gap * np.array([0.8, 0.6, 0.4, 0.2]), rtol=0.0, atol=ROUNDING_TOLERANCE)


def test_the_first_model_fades_nothing():
    """A collision in tick 0 is felt at once: nothing was felt before."""
    waypoints = [[0.0, 0.0, 0.0013, 1e-6], [0.01, 0.0, 0.0013, -0.002]]
    read = scene(duration=0.01, mesh={"nodes": [5, 5, 3]}, instrument={"waypoints": waypoints, "smoothing_ticks": 4})
    _, run, columns = ran(read)
    assert columns["fz"][0] > 1e-3 and all(row.force is row.result.force for row in run.rows)


def test_a_device_that_leaves_its_workspace_ends_the_run():
    read = drag(duration=0.2, waypoints=[[0.0, 0.0, 0.0, 0.01], [0.2, 0.0, -0.4, 0.2]])
    run = cycle.run(read, net.block(read))
    assert "outside its limits" in run.fault and 10 < len(run.rows) < 200
    with pytest.raises(SceneError, match="cannot start at the first: .* m from the shoulder"):
        read = drag(waypoints=[[0.0, 0.0, 0.0, 1.0]])
        cycle.run(read, net.block(read))


@pytest.mark.parametrize("keys, message", [
    ({"device": {"rotation": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]}}, "must be a rotation"),
    ({"device": {"rotation": [[2, 0, 0], [0, 1, 0], [0, 0, 1]]}}, "must be a rotation"),
    ({"device": {"rotation": [1, 0, 0]}}, "device.rotation = .* must be numbers"),
    ({"device": {"offset": [0.0, 0.0]}}, "device.offset"),
    ({"device": {"offset": [0.0, 0.0, float("nan")]}}, "offset = .* must be finite"),
    ({"device": {"friction_speed": 0.0}}, "friction_speed = 0.0 must be more than 0"),
    ({"device": {"joint_friction": [0.0, -1.0, 0.0]}}, "joint_friction = .* must be 0 or more"),
    ({"device": {"torque_bits": 16.0}}, "torque_bits = 16.0 must be a whole number"),
    ({"device": {"substeps": True}}, "substeps = True"),
    ({"device": {"substeps": 0}}, "substeps = 0 must be more than 0"),
    ({"device": {"gears": 3}}, r"\[instrument.device\] is a table of rotation, offset"),
    ({"hand": {"mass": 0.2}}, "hand.mass = 0.2 must be numbers"),
    ({"hand": {"mass": [[0.1], [0.2, 0.3], [0.1]]}}, "hand.mass"),
    ({"coupling": {"mass": 0.0}}, "coupling.mass"),
    ({"coupling": 500.0}, r"\[instrument.coupling\] is a table"),
    ({"smoothing_ticks": -1}, "smoothing_ticks"),
    ({"smoothing_ticks": 1.5}, "smoothing_ticks"),
    ({"passivity_control": 1}, "passivity_control"),
    ({"file": "tip.csv"}, "instrument.file"),
    ({"kind": "path", "coupling": {}}, "go with kind"),
    ({"kind": "path", "passivity_control": True}, "go with kind"),
    ({"kind": "phantom-3.0"}, "phantom-1.5"),
    ({"waypoints": None}, "waypoints"),
])
def test_refused(keys, message):
    with pytest.raises(SceneError, match=message):
        drag(instrument=keys)


def test_defaults():
    read = drag()
    device, hand = read["instrument"].device, read["instrument"].hand
    assert read["instrument"].coupling is None and Phantom(read).coupling is None and Phantom(read).passivity is None
    assert device.capstan_ratio.tolist() == [13.3, 11.2, 11.2] and device.substeps == 10 and device.torque_bits == 16
    assert hand.mass.tolist() == [0.218, 0.269, 0.204]
    assert drag(instrument={"coupling": {}})["instrument"].coupling.mass == 0.05


def test_the_scenes_axes_go_through_rotation_and_offset(within):
    """The same place in the device whatever the scene's axes are: its commands turn with them."""
    rotation, offset = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]]), [0.01, -0.02, 0.03]
    plain = Phantom(drag())
    waypoints = np.column_stack([plain.plant.times, (plain.plant.places - offset) @ rotation]).tolist()
    other = Phantom(drag(waypoints=waypoints, instrument={"device": {"rotation": rotation.tolist(), "offset": offset}}))
    back = rotation.T @ plain.device.rotation
    force = np.array([0.3, -0.4, 0.8])
    for tick in range(50):
        plain.move(tick), other.move(tick)
        plain.command(force), other.command(back @ force)
        expected = (plain.device.rotation @ plain.tip - offset) @ rotation
        within("axes, m", np.abs(other.tip - expected).max(), ROUNDING_TOLERANCE)


def compared(expected_run, network, columns):
    expected = trace.table(expected_run)
    found = comparison.differences(expected, columns, network.triangles, [row.result.at for row in expected_run.rows])
    return comparison.judge(found, len(expected["t"]), len(columns["t"]))


@pytest.mark.parametrize("keys", [{}, {"coupling": {}, "passivity_control": True, "smoothing_ticks": 10},
                                  {"device": {"encoder_counts": 0, "torque_bits": 0}}])
def test_another_order_of_springs_passes(within, keys):
    """Other rounding, same physics: in a loop that is closed, too, whether counts absorb it or not."""
    read = drag(instrument=keys)
    network, expected, _ = ran(read)
    order = np.random.default_rng(1).permutation(len(network.ends))
    shuffled = dataclasses.replace(network, ends=network.ends[order][:, ::-1], stiffness=network.stiffness[order],
                                   damping=network.damping[order], rest_length=network.rest_length[order])
    verdict = compared(expected, network, trace.table(cycle.run(read, shuffled)))
    assert {"device", "contact_force", "hand_energy"} <= set(verdict["quantities"])
    worst = max(entry["scaled"]["max"] for entry in verdict["quantities"].values())
    within("another order of springs, worst quantity", worst, comparison.SCALED_TOLERANCE)
    assert verdict["pass"] and worst > 0.0


@pytest.mark.parametrize("name", trace.DEVICE_COLUMNS)
def test_a_wrong_cell_in_a_column_of_the_device_fails_at_its_tick(direct, name):
    _, network, run, columns = direct
    for wrong in (np.nan, columns[name][120] + 1e-6 * np.abs(columns[name]).max() + 1e-9):
        edited = {key: values.copy() for key, values in columns.items()}
        edited[name][120] = wrong
        entries = compared(run, network, edited)["quantities"].values()
        assert [entry["first_beyond"] for entry in entries if entry["beyond"]] == [120]


def test_a_device_is_compared_and_its_absence_is_an_error(direct, tmp_path):
    _, network, run, columns = direct
    assert {"device", "contact_force", "hand_energy"} <= set(compared(run, network, columns)["quantities"])
    for missing in (set(trace.DEVICE_COLUMNS), {"device_y"}):
        with pytest.raises(SceneError, match="the other has not"):
            compared(run, network, {name: values for name, values in columns.items() if name not in missing})
    # Columns that are there but empty are those of a trace without a device.
    path = tmp_path / "trace.csv"
    trace.write(columns, path)
    header, *rows = path.read_text().splitlines()
    first = header.split(",").index("device_x")
    emptied = [",".join(cell if at < first else "" for at, cell in enumerate(row.split(","))) for row in rows]
    path.write_text("\n".join([header, *emptied]) + "\n")
    assert not set(trace.DEVICE_COLUMNS) & set(trace.read(path))


SCENE = '''
name = "held"
duration = 0.1
mesh = { nodes = [4, 4, 3], spacing = 0.0125 }
material = { node_mass = 0.01, stiffness = 100.0, damping = 0.5 }
contact = { law = "stick-slip", friction = 0.4 }
[instrument]
kind = "phantom-1.5"
waypoints = [[0.0, 0.001, 0.0013, 0.001], [0.05, 0.001, 0.0013, -0.006], [0.1, 0.006, 0.0013, -0.006]]
passivity_control = true
[instrument.coupling]
'''


def test_scripts_run_and_compare_a_device(tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE)

    def call(name, *arguments):
        return script(name, tmp_path / "scene.toml", *arguments)
    done = call("simulate.py", "--out", tmp_path / "trace.csv", "--write-network", tmp_path / "network.json")
    assert done.returncode == 0, done.stderr
    header, *rows = (tmp_path / "trace.csv").read_text().splitlines()
    assert header.split(",") == trace.COLUMNS + trace.DEVICE_COLUMNS and len(rows) == 100
    assert any(",stick," in row for row in rows)
    done = call("compare.py", "--run", tmp_path)
    assert done.returncode == 0 and "hand_energy" in done.stdout, done.stdout + done.stderr
    cells = rows[70].split(",")
    cells[-1] = repr(float(cells[-1]) + 1e-6)
    (tmp_path / "trace.csv").write_text("\n".join([header, *rows[:70], ",".join(cells), *rows[71:]]) + "\n")
    assert call("compare.py", "--run", tmp_path).returncode == 1
    cells[-1] = ""
    (tmp_path / "trace.csv").write_text("\n".join([header, *rows[:70], ",".join(cells), *rows[71:]]) + "\n")
    assert call("compare.py", "--run", tmp_path).returncode == 2
