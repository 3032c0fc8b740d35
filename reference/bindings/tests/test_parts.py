"""Renderers and instruments in Python."""

import numpy as np
import pytest
import stickslip


def short(duration=0.3, name="fig3-sliding"):
    return stickslip.Scene.shipped(name).with_keys(duration=duration)


def test_a_penalty_renders_and_pushes_the_network(penalty):
    result = stickslip.run(short(), renderer=penalty)
    assert result.fault is None and result.summary["renderer"].endswith("tutorial.Penalty")
    touching = result.trace["mode"] == "slide"
    assert touching.any() and (result.trace["triangle"][touching] >= 0).all()
    # A spring of 50 N/m, pressed by at most 3 mm on a body that yields.
    assert 0.05 < result.trace["fn"].max() < 0.15
    # Equal states give equal forces.
    assert stickslip.run(short(), renderer=penalty).trace["fz"].tobytes() == result.trace["fz"].tobytes()


def test_what_a_renderer_receives():
    seen = {}

    class Recorder(stickslip.Renderer):
        def create(self, body, setup):
            seen.update(body=body, setup=setup, states=[], taken=[])

        def build(self, state):
            seen["states"].append(state)
            return Model()

    class Model:
        def take_over(self, old):
            seen["taken"].append(old)

        def tick(self, before, tip):
            seen["tips"] = before, tip
            return (0.0, 0.0, 0.5), "slip", 3, [0.5, 0.25, 0.25], [0.0, 0.0, 1.0]

    scene = short(0.25, "fig5-stick-slip").with_keys({"contact.friction": {"static": 0.6, "kinetic": 0.4}})
    result = stickslip.run(scene, renderer=Recorder())
    body, setup, states = seen["body"], seen["setup"], seen["states"]
    nodes = len(body.mass)
    assert body.rest.shape == (nodes, 3) and body.fixed.dtype == bool and 0 < body.fixed.sum() < nodes
    assert body.spring_nodes.shape == (len(body.stiffness), 2) and body.triangles.max() < nodes
    lengths = np.linalg.norm(np.diff(body.rest[body.spring_nodes], axis=1)[:, 0], axis=1)
    assert np.abs(lengths - body.rest_length).max() < 1e-15
    corners = body.rest[body.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert ((normals * (corners.mean(axis=1) - body.rest.mean(axis=0))).sum(axis=1) > 0).all(), "outward"
    assert not body.rest.flags.writeable and body.gravity.shape == (3,)
    assert (setup.tick_s, setup.cycle_s, setup.law) == (1e-3, 0.1, "stick-slip")
    assert (setup.friction_static, setup.friction_kinetic, setup.surface) == (0.6, 0.4, "faceted")
    assert [state.tick for state in states] == [0, 100, 200]
    assert states[0].last.mode == "free" and states[0].last.triangle is None
    last = states[2].last
    assert (last.mode, last.triangle, last.weights.tolist(), last.normal.tolist()) == (
        ("slip", 3, [0.5, 0.25, 0.25], [0.0, 0.0, 1.0])
    )
    # Minus the force has pushed the network at the contact point.
    assert states[2].x[body.triangles[3], 2].mean() < body.rest[body.triangles[3], 2].mean()
    assert seen["taken"][0] is None and isinstance(seen["taken"][1], Model)
    assert (seen["tips"][1] == [result.trace[axis][-1] for axis in ("qx", "qy", "qz")]).all()
    assert set(result.trace["mode"].tolist()) == {"slip"} and (result.trace["alpha"] == 0.5).all()


def test_nodes_that_a_renderer_moves_are_the_networks():
    class Lift(stickslip.Renderer):
        """Lifts a free node by 1 mm."""

        def build(self, state):
            self.last = state
            self.node = int(np.flatnonzero(~self.body.fixed)[0])
            return self

        def tick(self, before, tip):
            return None

        def moved(self):
            return [self.node], [self.body.rest[self.node] + [0.0, 0.0, 1e-3]], [[0.0, 0.0, 0.0]]

    lift = Lift()
    assert stickslip.run(short(0.15), renderer=lift).fault is None
    assert lift.last.x[lift.node, 2] == lift.body.rest[lift.node, 2] + 1e-3


class Broken(stickslip.Renderer):
    """Raises in a call of its own choice."""

    def __init__(self, call):
        self.call = call

    def fail(self, call):
        if call == self.call:
            raise ArithmeticError(f"in {call}")

    def create(self, body, setup):
        self.fail("create")

    def build(self, state):
        self.fail("build" if state.tick else "first build")
        return self

    def take_over(self, old):
        self.fail("take_over")

    def tick(self, before, tip):
        self.fail("tick")

    def moved(self):
        self.fail("moved")
        return [], np.zeros((0, 3)), np.zeros((0, 3))


@pytest.mark.parametrize("call", ["create", "first build", "build", "take_over", "tick", "moved"])
def test_exceptions_of_a_renderer_come_back(call):
    with pytest.raises(ArithmeticError, match=f"in {call}") as caught:
        stickslip.run(short(0.15), renderer=Broken(call))
    assert any(entry.name == "fail" for entry in caught.traceback), "with its traceback"


@pytest.mark.parametrize(
    ("result", "error"),
    [
        ([1.0, 2.0], "a force needs three numbers"),
        (([0, 0, 1], "glued", None, None, None), "the mode 'glued' is none of free, stick, slide, slip"),
        (([0, 0, 1], "stick", 3, [1, 0], [0, 0, 1]), "weights needs three numbers"),
        ("force", "could not convert"),
    ],
)
def test_replies_that_make_no_sense(result, error):
    class Odd(stickslip.Renderer):
        def build(self, state):
            return self

        def tick(self, before, tip):
            return result

    with pytest.raises(ValueError, match=error):
        stickslip.run(short(0.01), renderer=Odd())


def test_a_fault_is_a_result_and_no_exception():
    class Wild(stickslip.Renderer):
        def build(self, state):
            return self

        def tick(self, before, tip):
            return [0.0, 0.0, float("nan" if tip[2] < 0.0 else 0.0)]

    result = stickslip.run(short(), renderer=Wild())
    assert "the contact force is not finite" in result.fault
    assert 0 < len(result.t) < 300 and result.summary["verdict"]["verdict"] == "FAIL"


def test_what_does_not_fit_is_refused():
    class NoModel(stickslip.Renderer):
        def build(self, state):
            return 3.0

    with pytest.raises(TypeError, match="build returned float, which has no method tick"):
        stickslip.run(short(0.01), renderer=NoModel())
    with pytest.raises(NotImplementedError, match="Renderer does not define build"):
        stickslip.run(short(0.01), renderer=stickslip.Renderer())
    with pytest.raises(stickslip.SceneError, match="cannot load the renderer"):
        stickslip.run(short(0.01), renderer="./no-such-library.so")


class Hover(stickslip.Instrument):
    """Hovers above the body, or raises."""

    def __init__(self, call=None):
        self.call = call
        self.commands = 0

    def fail(self, call):
        if call == self.call:
            raise ArithmeticError(f"in {call}")

    def start(self):
        self.fail("start")
        return np.array([0.0, 0.0, 0.01])

    def sense(self, begin_s, end_s, contact_force):
        self.fail("sense")
        assert contact_force.shape == (3,)
        return [0.0, end_s, 0.01]

    def tip_velocity(self):
        self.fail("tip_velocity")
        return [0.0, 1.0, 0.0]

    def command(self, contact_force):
        self.fail("command")
        self.commands += 1
        return contact_force


def test_an_instrument_moves_the_tip():
    hover = Hover()
    trace = stickslip.run(short(0.05), instrument=hover).trace
    assert hover.commands == 50 and (trace["qy"] == trace["t"]).all()


@pytest.mark.parametrize("call", ["start", "sense", "tip_velocity", "command"])
def test_exceptions_of_an_instrument_come_back(call):
    with pytest.raises(ArithmeticError, match=f"in {call}"):
        stickslip.run(short(0.05), instrument=Hover(call))
