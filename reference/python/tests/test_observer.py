"""The estimate of a device's motion between counts, and the massless scheme with it."""

import numpy as np
import pytest

from setups import scene
from stickslip_reference import cycle, phantom, trace
from stickslip_reference import network as net
from stickslip_reference.instrument import Phantom
from stickslip_reference.observer import Observer, steepness
from stickslip_reference.scene import SceneError
from test_massless import PLACE_TOLERANCE, followed

H = 1e-3
COUNT = np.array([1e-4, 2e-4, 3e-4])
ROUNDING_TOLERANCE = 1e-13  # rad/s, of 1e-2. Measured: 0.
# The contact point's speed against the tip's, m/s, of tenths. Measured: 1.5e-17.
SPEED_TOLERANCE = 1e-14

WAYPOINTS = [[0.0, -0.004, 0.0013, 0.00051], [0.04, -0.004, 0.0013, -0.006], [0.15, 0.006, 0.0013, -0.006]]


def observed(readings, h=H):
    observer = Observer(readings[0], COUNT, h)
    angles, rates = [], []
    for reading in readings[1:]:
        observer.move(reading)
        angles.append(observer.angle), rates.append(observer.rate)
    return np.array(angles), np.array(rates)


def test_one_count_is_a_slow_motion(within):
    """One count in the whole window: a count in 20 ms, for 20 ms, then rest; the angle has gone over to the reading."""
    readings = np.zeros((200, 3))
    readings[40:] = COUNT
    angles, rates = observed(readings)
    within("rate of one count, rad/s", np.abs(rates[39] - COUNT / 0.02).max(), ROUNDING_TOLERANCE)
    assert not rates[:39].any() and not rates[39 + 20 :].any() and (rates[39:59] > 0.0).all()
    left = (COUNT - angles[100:]) / (COUNT - angles[100])
    within("way back to the reading", np.abs(left - (1.0 - H / 0.02) ** np.arange(99)[:, None]).max(), 1e-9)


def test_steady_motion_is_seen_between_its_counts(within):
    """Two readings a window apart are each within half a count: the rate is within a count over the window's 20 ms."""
    true = np.outer(np.arange(400), H * np.array([0.03, -0.11, 0.5]))
    readings = COUNT * np.round(true / COUNT)
    angles, rates = observed(readings)
    error = np.abs(rates[40:] - true[1] / H)
    within("rate of a steady motion, of a count in 20 ms", (error / (COUNT / 0.02)).max(), 1.0 + 1e-9)
    assert (np.abs(angles - true[1:])[40:].std(axis=0) < 0.5 * np.abs(readings - true)[41:].std(axis=0)).all()
    assert (np.abs(angles - readings[1:]) <= COUNT * (1.0 + 1e-12)).all()


@pytest.mark.parametrize("scale", [0.2, 1.0, 5.0])
def test_the_window_is_the_longest_line_that_no_reading_leaves(scale):
    """Line by line and reading by reading: the first line that some reading is more than a count away from ends the search."""
    rng = np.random.default_rng(2)
    walk = np.round(np.cumsum(np.cumsum(scale * rng.normal(size=300)) * 0.3))
    lengths = set()
    for now in range(30, 300):
        past = walk[now::-1][:21]
        length = 1
        for ticks in range(2, 21):
            slope = (past[0] - past[ticks]) / ticks
            if any(abs(past[0] - back * slope - past[back]) > 1.0 + 1e-8 for back in range(1, ticks + 1)):
                break
            length = ticks
        lengths.add(length)
        assert steepness(past, 1.0) == (past[0] - past[length]) / length
    assert len(lengths) > 3


def test_angles_that_are_not_quantised_are_the_readings():
    readings = np.random.default_rng(3).normal(size=(50, 3))
    observer = Observer(readings[0], np.zeros(3), H)
    for last, reading in zip(readings, readings[1:]):
        observer.move(reading)
        assert (observer.angle == reading).all() and np.allclose(observer.rate, (reading - last) / H, rtol=1e-12)


def by_hand(law="stick-slip", **keys):
    friction = {"friction": 0.4} if law == "stick-slip" else {}
    keys = {"duration": 0.15, "waypoints": WAYPOINTS} | keys
    return scene(law, duration=keys.pop("duration"), mesh={"nodes": [5, 5, 3]}, contact={"scheme": "massless"} | friction,
                 material={"node_mass": 0.002, "damping": 0.1}, instrument={"kind": "phantom-1.5"} | keys)


@pytest.mark.parametrize("law", ["sliding", "sticking", "stick-slip"])
def test_the_contact_point_has_the_velocity_that_is_estimated(within, law):
    """Along what is held; its place is the tip's all the same."""
    read = by_hand(law)
    result, ticks = followed(read, net.block(read))
    modes = {"stick": 0, "slide": 0, "slip": 0, "free": 0}
    apart = 0.0
    for tick in ticks:
        modes[tick.report.mode] += 1
        if tick.report.mode == "free":
            continue
        nodes, weights = tick.surface.support(tick.report.point)
        free = tick.model.moves[nodes]
        gap = tick.surface.position(tick.report.point, tick.after.x) - tick.q1
        speed = weights[free] @ tick.after.v[nodes[free]] - tick.tip_velocity
        n = tick.report.normal
        if tick.report.mode != "stick":
            gap, speed = gap @ n, speed @ n
        within("contact point against the estimated tip, m", np.abs(gap).max(), PLACE_TOLERANCE)
        within("its velocity against the estimate, m/s", np.abs(speed).max(), SPEED_TOLERANCE)
        apart = max(apart, np.linalg.norm(tick.tip_velocity - (tick.q1 - tick.q0) / read.h))
    assert modes[{"sliding": "slide", "sticking": "stick", "stick-slip": "slip"}[law]] > 10
    assert apart > 1e-3  # the estimate is not the way of the tip


def test_the_tip_that_is_seen(within):
    """Tip and velocity are those of the estimated angles; readings, and the device with them, are as ever."""
    device = Phantom(by_hand())
    plain = Phantom(by_hand(device={"tip": "quantised"}))
    assert plain.velocity is None and (device.tip == plain.tip).all() and not device.velocity.any()
    axes = device.device
    seen, quantised = [], []
    for tick in range(100):
        for each in (device, plain):
            each.move(tick)
            each.command(np.zeros(3))
        assert (device.measured == plain.measured).all()
        true = phantom.to_scene(axes, phantom.forward(device.y[:3]))
        seen.append(device.tip - true), quantised.append(plain.tip - true)
        step = 1e-6
        moved = phantom.to_scene(axes, phantom.forward(device.observer.angle + step * device.observer.rate)) - device.tip
        within("velocity of the tip, m/s", np.abs(device.velocity - moved / step).max(), 1e-7)
    assert np.abs(np.diff(seen, axis=0)).mean() < 0.8 * np.abs(np.diff(quantised, axis=0)).mean()


def test_defaults_and_what_is_refused():
    assert by_hand()["instrument"].device.tip == "observed"
    assert scene(instrument={"kind": "phantom-1.5"})["instrument"].device.tip == "quantised"
    for keys in ({"device": {"tip": "guessed"}}, {"device": {"tip": 1}}, {"coupling": {}}):
        with pytest.raises(SceneError, match="device.tip"):
            by_hand(**keys)
    by_hand(device={"tip": "quantised"}, coupling={})


def test_runs_with_either_tip_repeat_and_differ():
    tables = {}
    for tip in ("observed", "quantised"):
        read = by_hand(device={"tip": tip}, duration=0.1)
        result = cycle.run(read, net.block(read))
        assert result.fault is None and result.inside_without_contact == 0
        tables[tip] = trace.table(result)
    jumps = {tip: np.abs(np.diff(table["fz"][60:])).max() for tip, table in tables.items()}
    assert jumps["observed"] < jumps["quantised"]
