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


def test_a_recording_is_the_path_it_holds(tmp_path):
    (tmp_path / "tip.csv").write_text("t,x,y,z\n0.0,0.0,0.0,0.002\n0.25,0.0,0.0,-0.002\n")
    recorded = read(tmp_path, SMALLEST.replace('waypoints = [[0.0, 0.0, 0.0, 0.002], [0.25, 0.0, 0.0, -0.002]]',
                                               'kind = "recording"\nfile = "tip.csv"'))
    assert np.array_equal(recorded.waypoints, read(tmp_path, SMALLEST).waypoints)


@pytest.mark.parametrize("old, new", [
    ('law = "sliding"', 'law = "rolling"'),
    ('law = "sliding"', 'law = "sliding"\nfriction = 1.0'),
    ('law = "sliding"', 'law = "stick-slip"'),
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
