"""Comparisons with the whole network, and conformance."""

import json
import subprocess

import numpy as np
import pytest
import stickslip

SCENE = stickslip.Scene.shipped("fig3-sliding").with_keys(duration=0.15)


@pytest.fixture(scope="module")
def reference():
    return stickslip.Reference(SCENE)


def test_the_reference_is_the_whole_network(reference):
    full = stickslip.run(SCENE.with_keys({"local": None, "local.model": "full"}))
    assert (reference.forces == full.forces).all() and (reference.t == full.t).all()
    assert 0.0 < reference.floor < 0.1 and reference.fault is None
    error = np.sqrt(((reference.fine_forces - reference.forces) ** 2).sum() / (reference.forces**2).sum())
    assert abs(error - reference.floor) <= 1e-12


def test_errors_are_those_of_the_definition(reference):
    point = stickslip.accuracy(SCENE, reference=reference)
    forces = stickslip.run(SCENE).forces
    error = np.sqrt(((forces - reference.forces) ** 2).sum() / (reference.forces**2).sum())
    # Sums of 150 squares, in another order.
    assert abs(point["force_error_rms_rel"] - error) <= 1e-12
    assert point["status"] == "ok" and point["reference"]["floor_rms_rel"] == reference.floor
    assert (point["model"], point["rings"]) == ("patch", 1)
    # The judge comes to the same from the forces alone.
    judged = stickslip.judge(SCENE, reference.t, forces, reference=reference)
    for key in ("force_error_rms_rel", "force_error_rms_rel_fine", "force_error_max_n", "normal_error_rms_rel"):
        assert judged[key] == point[key], key


def test_a_renderer_in_python_is_judged(reference, penalty):
    point = stickslip.accuracy(SCENE, penalty, reference)
    assert point["name"] == "tutorial.Penalty, 10 Hz" and point["model"] == "external"
    # A spring of 50 N/m in place of a body of some 400 N/m: 0.887.
    assert 0.85 < point["force_error_rms_rel"] < 0.92 and point["status"] == "ok"
    result = stickslip.run(SCENE, penalty)
    judged = stickslip.judge(SCENE, result.t, result.forces, mode=result.trace["mode"], reference=reference)
    assert judged["verdict"] == "FAIL" and judged["force_error_rms_rel"] == point["force_error_rms_rel"]
    assert judged["mode_agreement"] == point["mode_agreement"]


def test_what_the_program_judges(program, tmp_path, reference):
    """Forces at another rate and late, with contact points: the program says the same of the same file."""
    t = reference.t[::2] + 2e-3
    points = np.where(reference.forces[::2].any(axis=1, keepdims=True), [[0.0, 0.0, 0.0]], np.nan)
    judged = stickslip.judge(SCENE, t, reference.forces[::2], points=points, reference=reference)
    assert judged["lag_ticks"] == 2 and judged["contact_point_error_max_m"] > 0.0

    (tmp_path / "scene.toml").write_text(SCENE.toml)
    columns = np.column_stack([t, reference.forces[::2], points]).tolist()
    cells = [",".join("" if cell != cell else repr(cell) for cell in row) for row in columns]
    (tmp_path / "mine.csv").write_text("\n".join(["t,fx,fy,fz,px,py,pz", *cells]))
    subprocess.run(
        [program, "judge", "scene.toml", "--trace", "mine.csv", "--out", "out", "--quiet"],
        cwd=tmp_path,
        stdin=subprocess.DEVNULL,
    )
    written = json.loads((tmp_path / "out/judge.json").read_text())
    del written["trace"]  # the file and its columns
    assert written == judged


def test_what_cannot_be_compared(reference):
    with pytest.raises(ValueError, match="another problem"):
        stickslip.accuracy(SCENE.with_keys({"material.stiffness": 123.0}), reference=reference)
    stickslip.accuracy(SCENE.with_keys({"local.rings": 2, "global.rate": 50.0}), reference=reference)
    t, forces = reference.t, reference.forces
    for arguments, message in [
        ((t, forces[1:]), "shape"),
        ((t[::-1], forces), "do not ascend"),
        ((t, forces * np.nan), "not finite"),
        ((t, forces, ["glued"] * len(t)), "mode needs one of"),
        ((t + 9.0, forces), "covers nothing of the scene"),
    ]:
        with pytest.raises(ValueError, match=message):
            stickslip.judge(SCENE, *arguments, reference=reference)
    with pytest.raises(ValueError, match="modelled hand"):
        by_hand = SCENE.with_keys({"instrument.kind": "phantom-1.5"}, duration=0.002)
        stickslip.judge(by_hand, t, forces, reference=stickslip.Reference(by_hand))


def test_conformance_finds_what_a_renderer_does_wrong(penalty):
    class Pulling(type(penalty)):
        """Pulls at a free tip, and gives up at a jump."""

        def build(self, state):
            return PullingModel(super().build(state))

    class PullingModel:
        def __init__(self, inner):
            self.inner = inner

        def tick(self, before, tip):
            if not np.linalg.norm(tip - before) < 1e-3:
                raise ArithmeticError("a jump")
            return self.inner.tick(before, tip) or stickslip.Rendered([0.0, 0.0, -1e-3], "free")

    found = stickslip.conform(SCENE, Pulling(50.0))
    assert found["renderer"].endswith("Pulling") and found["verdict"] == "FAIL"
    properties = {finding["name"]: finding for finding in found["properties"]}
    assert properties["no-force-when-free"]["verdict"] == "FAIL"
    assert "ArithmeticError: a jump" in properties["bounded-teleport"]["finding"]
    assert properties["same-bits"]["verdict"] == "PASS"


def test_an_interrupt_ends_a_conformance():
    class Interrupted(stickslip.Renderer):
        def build(self, state):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stickslip.conform(SCENE, Interrupted())
