"""A verification and benchmarking testbed for multi-rate haptic simulation with stick-slip contact.

>>> import stickslip
>>> scene = stickslip.Scene.shipped("fig5-stick-slip").with_keys({"contact.friction": 0.5})
>>> result = stickslip.run(scene)
>>> bool((result.trace["ft"] <= 0.5 * result.trace["fn"] + 1e-12).all())  # Coulomb's bound
True

All quantities are SI, and all axes right-handed. ``reference/bindings/README.md`` is a tutorial.
"""

from ._accuracy import Reference, accuracy, conform, judge
from ._errors import SceneError
from ._parts import Body, Instrument, Moved, Rendered, Renderer, RendererModel, Setup, State
from ._run import Result, run
from ._scene import Scene

__all__ = [
    "Body",
    "Instrument",
    "Moved",
    "Reference",
    "Rendered",
    "Renderer",
    "RendererModel",
    "Result",
    "Scene",
    "SceneError",
    "Setup",
    "State",
    "accuracy",
    "conform",
    "judge",
    "run",
]
