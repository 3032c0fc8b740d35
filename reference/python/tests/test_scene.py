"""Scene files: defaults, the instrument's path, and what is refused."""

import numpy as np
import pytest

from stickslip_reference.scene import Scene, SceneError, load

SMALLEST = '''
name = "small"
duration = 0.5
[mesh]
nodes = [3, 3, 3]
spacing = 0.01
[material]
node_mass = 0.01
stiffness = 100.0
damping = 0.5
[contact]
law = "sliding"
[instrument]
waypoints = [[0.0, 0.0, 0.0, 0.002], [0.25, 0.0, 0.0, -0.002]]
'''


def read(tmp_path, text):
    path = tmp_path / "scene.toml"
    path.write_text(text)
    return load(path)


def test_defaults(tmp_path):
    scene = read(tmp_path, SMALLEST)
    assert (scene.ticks, scene.cycle_ticks, scene.h) == (500, 100, 1e-3)
    assert scene["contact"].surface == "faceted" and scene["local"].rings == 1 and scene["sync"].mode == "replay"
    assert scene["material"].gravity == [0.0, 0.0, 0.0] and scene["contact"].wall_stiffness == 1000.0


def test_path_is_linear_between_waypoints_and_constant_outside(tmp_path):
    scene = read(tmp_path, SMALLEST)
    assert scene.tip(0).tolist() == [0.0, 0.0, 0.002]
    assert abs(scene.tip(125)[2]) <= 1e-18
    assert scene.tip(250).tolist() == scene.tip(499).tolist() == [0.0, 0.0, -0.002]


def test_minimum_jerk_rests_at_waypoints(tmp_path, within):
    """Between two: half way in the middle, 15/8 of the mean speed there; no speed or acceleration at the ends."""
    lines = SMALLEST.replace("[instrument]", '[local]\nrate = 1e4\n[instrument]\ninterpolation = "minimum-jerk"')
    lines = lines.replace("[0.25, 0.0, 0.0, -0.002]", "[0.25, 0.0, 0.0, -0.002], [0.35, 0.004, 0.0, -0.002]")
    scene = read(tmp_path, lines)
    tips = np.array([scene.tip(tick) for tick in range(5001)])
    assert tips[0].tolist() == [0.0, 0.0, 0.002] and tips[2500].tolist() == [0.0, 0.0, -0.002]
    assert tips[3500].tolist() == tips[5000].tolist() == [0.004, 0.0, -0.002]
    tau = (np.arange(1001) / 1000)[:, None]
    along = (tips[2500:3501] - tips[2500]) / 0.004
    within("minimum jerk, of the way", np.abs(along - (10 * tau**3 - 15 * tau**4 + 6 * tau**5) * [1.0, 0.0, 0.0]).max(), 1e-12)
    speed = np.linalg.norm(np.diff(tips, axis=0), axis=1) / 1e-4
    assert abs(speed[1249] / (0.004 / 0.25) - 15 / 8) <= 1e-4 and speed[[0, 2499, 2500, 3499]].max() <= 1e-6
    acceleration = np.linalg.norm(np.diff(tips, 2, axis=0), axis=1) / 1e-8
    assert acceleration[[0, 2498, 2499, 3498]].max() <= 0.05 * acceleration.max()


def test_friction_is_a_number_or_a_pair(tmp_path):
    for given, expected in (("0.5", (0.5, 0.5)), ("{ static = 0.5, kinetic = 0.25 }", (0.5, 0.25)), ("0", (0, 0))):
        text = SMALLEST.replace('law = "sliding"', f'law = "stick-slip"\nfriction = {given}')
        assert read(tmp_path, text)["contact"].friction == expected
    text = SMALLEST.replace('law = "sliding"', 'law = "sticking"\nadhesion = inf')
    assert read(tmp_path, text)["contact"].adhesion == np.inf


def test_a_recording_is_the_path_it_holds(tmp_path):
    (tmp_path / "tip.csv").write_text("t,x,y,z\n0.0,0.0,0.0,0.002\n0.25,0.0,0.0,-0.002\n")
    recorded = read(tmp_path, SMALLEST.replace('waypoints = [[0.0, 0.0, 0.0, 0.002], [0.25, 0.0, 0.0, -0.002]]',
                                               'kind = "recording"\nfile = "tip.csv"'))
    assert np.array_equal(recorded.waypoints, read(tmp_path, SMALLEST).waypoints)


@pytest.mark.parametrize("old, new", [
    ('law = "sliding"', 'law = "rolling"'),
    ('law = "sliding"', 'law = "sliding"\nfriction = 1.0'),
    ('law = "sliding"', 'law = "stick-slip"'),
    ('law = "sliding"', 'law = "stick-slip"\nfriction = -0.1'),
    ('law = "sliding"', 'law = "stick-slip"\nfriction = nan'),
    ('law = "sliding"', 'law = "stick-slip"\nfriction = "high"'),
    ('law = "sliding"', 'law = "stick-slip"\nfriction = { static = 0.5 }'),
    ('law = "sliding"', 'law = "stick-slip"\nfriction = { static = 0.4, kinetic = 0.5 }'),
    ('law = "sliding"', 'law = "stick-slip"\nfriction = { static = 0.5, kinetic = nan }'),
    ('law = "sliding"', 'law = "sliding"\nadhesion = -1.0'),
    ('law = "sliding"', 'law = "sliding"\nadhesion = nan'),
    ('law = "sliding"', 'law = "sliding"\nadhesion = inf'),
    ('law = "sliding"', 'law = "stick-slip"\nfriction = 0.5\nadhesion = inf'),
    ("[instrument]", '[instrument]\ninterpolation = "cubic"'),
    ('law = "sliding"', 'law = "sliding"\nsurface = "smooth"'),
    ('law = "sliding"', 'law = "sliding"\nscheme = "velocity"\ndeformation = "rigid"'),
    ('law = "sliding"', 'law = "sliding"\nscheme = "velocity"\nmetric = "euclidean"'),
    ("damping = 0.5", ""),
    ("duration = 0.5", "duration = 0.50005"),
    ("duration = 0.5", ""),
    ("spacing = 0.01", "spacing = 0.01\nspacings = 0.02"),
    ("0.25, 0.0", "0.0, 0.0"),
    ("0.25, 0.0", "nan, 0.0"),
    ("[contact]", "[local]\nintegrator = \"exponential\"\n[contact]"),
    ("[contact]", "[sync]\nlatency_ticks = 100\n[contact]"),
    ("[contact]", "[global]\nrate = 300.0\n[contact]"),
    ("[mesh]", "[mesh"),
])
def test_refused(tmp_path, old, new):
    assert SMALLEST.count(old) == 1
    with pytest.raises(SceneError):
        read(tmp_path, SMALLEST.replace(old, new))


@pytest.mark.parametrize("scheme", ["geometric", "velocity"])
@pytest.mark.parametrize("surface", ["faceted", "shaded", "subdivision"])
def test_every_surface_goes_with_every_scheme(tmp_path, scheme, surface):
    text = SMALLEST.replace('law = "sliding"', f'law = "sliding"\nscheme = "{scheme}"\nsurface = "{surface}"')
    contact = read(tmp_path, text)["contact"]
    assert (contact.scheme, contact.surface) == (scheme, surface)


def test_a_section_that_is_missing_is_named():
    with pytest.raises(SceneError, match="mesh"):
        Scene({"name": "none", "duration": 1.0})
