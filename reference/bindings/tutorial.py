"""Makes the plots of README.md: `python tutorial.py`, with the package and its extra `plots` installed."""

from pathlib import Path

import numpy as np
import stickslip

FOLDER = Path(__file__).parent / "plots"


class Penalty(stickslip.Renderer):
    """A spring on the triangle whose centre is nearest. The network is pushed back at that point."""

    def __init__(self, stiffness):
        self.stiffness = stiffness

    def build(self, state):
        return PenaltyModel(self.stiffness, state.x[self.body.triangles])


class PenaltyModel:
    """The surface as it was at the hand-over."""

    def __init__(self, stiffness, corners):
        self.stiffness, self.centres = stiffness, corners.mean(axis=1)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self.normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)

    def tick(self, before, tip):
        triangle = np.argmin(((self.centres - tip) ** 2).sum(axis=1))
        normal = self.normals[triangle]
        depth = (self.centres[triangle] - tip) @ normal
        if not depth > 0.0:
            return None
        return stickslip.Rendered(self.stiffness * depth * normal, "slide", triangle, [1 / 3, 1 / 3, 1 / 3], normal)


def frictions():
    """The paper's stick-slip drag by three coefficients of friction."""
    scene = stickslip.Scene.shipped("fig5-stick-slip")
    return {mu: stickslip.run(scene.with_keys({"contact.friction": mu})) for mu in (1.0, 0.5, 0.2)}


def errors():
    """Force errors along the paper's sliding drag: local models of the testbed, and penalties by stiffness, N/m."""
    scene = stickslip.Scene.shipped("fig3-sliding").with_keys(duration=0.6)
    reference = stickslip.Reference(scene)

    def error(scene, renderer=None):
        return stickslip.accuracy(scene, renderer, reference)["force_error_rms_rel"]

    models = {exterior: error(scene.with_keys({"local.exterior": exterior})) for exterior in ("fixed", "condensed")}
    return models, {k: error(scene, Penalty(k)) for k in (50.0, 100.0, 200.0, 400.0, 800.0, 1600.0)}


def main():
    import matplotlib

    matplotlib.use("svg")
    # The same bytes every time.
    matplotlib.rcParams.update({"svg.hashsalt": "stickslip", "svg.fonttype": "none", "font.family": "sans-serif"})
    from matplotlib import pyplot as plt

    def save(figure, name):
        figure.tight_layout()
        figure.savefig(FOLDER / name, metadata={"Date": None, "Creator": None})

    FOLDER.mkdir(exist_ok=True)
    figure, axes = plt.subplots(figsize=(6.4, 3.2))
    for mu, result in frictions().items():
        axes.plot(result.t, result.trace["ft"], linewidth=0.8, label=f"μ = {mu:g}")
    axes.set(xlabel="time, s", ylabel="tangential force, N")
    axes.legend(frameon=False)
    save(figure, "friction.svg")

    models, penalties = errors()
    figure, axes = plt.subplots(figsize=(6.4, 3.2))
    axes.plot(list(penalties), [100.0 * error for error in penalties.values()], "o-", label="penalty")
    for (exterior, error), style in zip(models.items(), ("--", ":")):
        axes.axhline(100.0 * error, linestyle=style, color="black", linewidth=0.8, label=f"local model, {exterior}")
    axes.set(xscale="log", yscale="log", xlabel="stiffness of the penalty, N/m", ylabel="force error, %")
    axes.legend(frameon=False)
    save(figure, "errors.svg")
    print(models, penalties)


if __name__ == "__main__":
    main()
