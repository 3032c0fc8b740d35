"""Comparisons with the whole network, and conformance."""

from __future__ import annotations

import json
from typing import Any, Dict, Optional

import numpy as np
from numpy.typing import ArrayLike

from . import _stickslip
from ._adapters import AnyRenderer, Parts
from ._parts import MODES, Floats
from ._progress import Progress, watched
from ._scene import Scene


class Reference:
    """What a renderer is compared with: the scene's drag with the whole network at the haptic rate and one contact, at the
    scene's tick and at an eighth of it.

    It costs more than most of what is compared with it, so one serves many comparisons: of scenes that differ in their
    local model or their cycle alone (tables ``local``, ``global`` and ``sync``), and of any renderer.

    >>> import stickslip
    >>> scene = stickslip.Scene.shipped("fig3-sliding").with_keys(duration=0.15)
    >>> reference = stickslip.Reference(scene)
    >>> errors = [
    ...     stickslip.accuracy(scene.with_keys({"local.exterior": exterior}), reference=reference)
    ...     for exterior in ("fixed", "condensed")
    ... ]
    >>> errors[0]["force_error_rms_rel"] > errors[1]["force_error_rms_rel"]
    True
    """

    #: The scene.
    scene: Scene
    #: Times at the ends of the ticks, s: (ticks,).
    t: Floats
    #: Forces on the instrument, N: (ticks, 3).
    forces: Floats
    #: Forces of the run by ticks of an eighth, at the same times, N: (ticks, 3).
    fine_forces: Floats

    def __init__(self, scene: Scene, progress: Progress = None) -> None:
        """Runs both references. Raises ``SceneError`` if the scene cannot start."""
        total = _stickslip.Reference.TICKS * scene.tick_count
        with watched(progress, total, f"{scene.name}: reference") as done:
            self._core = _stickslip.Reference.run(scene._core, done)
        self.scene = scene
        rows, fine = (np.frombuffer(rows).reshape(-1, 4) for rows in (self._core.rows, self._core.fine_rows))
        self.t, self.forces, self.fine_forces = rows[:, 0], rows[:, 1:], fine[:, 1:]

    @property
    def floor(self) -> float:
        """Difference of the two runs, relative to the force: smaller errors have no meaning."""
        return self._core.floor

    @property
    def fault(self) -> Optional[str]:
        """The fault that ended one of the runs, if one did; nothing can be judged then."""
        return self._core.fault

    def __repr__(self) -> str:
        return f"Reference({self.scene.name!r}, floor {100.0 * self.floor:.2g} %)"


def accuracy(
    scene: Scene,
    renderer: Optional[AnyRenderer] = None,
    reference: Optional[Reference] = None,
    progress: Progress = None,
    *,
    renderer_options: str = "",
) -> Dict[str, Any]:
    """Force errors of the scene's local model, or of a renderer, against the whole network at the haptic rate.

    The result has the keys of a point of ``accuracy.json`` (``reference/docs/outputs.md``) but for times, which nothing
    measures here, and under ``reference`` those of its reference: ``force_error_rms_rel`` is the root mean square of the
    force error over that of the force, ``status`` is "ok", "unresolved" (below the floor) or "diverged". Without
    ``reference``, the one of the scene is run first.

    Raises ``SceneError`` if the scene cannot start, ``ValueError`` if the reference is one of another problem, and
    whatever a renderer in Python raises.
    """
    reference = reference or Reference(scene, progress)
    parts = Parts.of(renderer, renderer_options)
    with watched(progress, scene.tick_count, scene.name) as done:
        return _read(_stickslip.accuracy(scene._core, parts, reference._core, done))


def judge(
    scene: Scene,
    t: ArrayLike,
    forces: ArrayLike,
    mode: Optional[ArrayLike] = None,
    points: Optional[ArrayLike] = None,
    reference: Optional[Reference] = None,
    progress: Progress = None,
) -> Dict[str, Any]:
    """Judges forces that another program has rendered along the scene's path.

    ``t`` are ascending times, s: (rows,); ``forces`` those on the instrument, N: (rows, 3). They need not be at the ticks
    of the scene. ``mode`` ("free", "stick", "slide", "slip") and ``points``, the contact point on the surface at rest, m:
    (rows, 3) with NaN where free, may be given besides. The result has the keys of ``judge.json``: the verdict, its
    reason as a sentence, what does not fit between forces and scene (a lag, another unit or sign, gaps), and the errors.

    Raises ``ValueError`` if the arrays do not go together, or the path depends on the force (a modelled hand).

    >>> import stickslip
    >>> scene = stickslip.Scene.shipped("fig3-sliding").with_keys(duration=0.15)
    >>> reference = stickslip.Reference(scene)
    >>> stickslip.judge(scene, reference.t, reference.forces, reference=reference)["verdict"]
    'PASS'
    >>> wrong = stickslip.judge(scene, reference.t, -reference.forces, reference=reference)
    >>> wrong["verdict"], wrong["best_scale"]
    ('FAIL', -1.0)
    """
    text = _csv(t, forces, mode, points)
    reference = reference or Reference(scene, progress)
    return _read(_stickslip.judge(scene._core, reference._core, text))


def _read(text: str) -> Dict[str, Any]:
    result: Dict[str, Any] = json.loads(text)
    return result


def _csv(t: ArrayLike, forces: ArrayLike, mode: Optional[ArrayLike], points: Optional[ArrayLike]) -> str:
    """The trace as text: floats in the shortest form that reads back to the same bits."""
    t, forces = np.asarray(t, dtype=np.float64), np.asarray(forces, dtype=np.float64)
    if t.ndim != 1 or forces.shape != (len(t), 3):
        raise ValueError(f"t needs the shape (rows,) and forces (rows, 3); they have {t.shape} and {forces.shape}")
    if not (np.isfinite(t).all() and np.isfinite(forces).all()):
        raise ValueError("a time or a force is not finite")
    if not (np.diff(t) > 0.0).all():
        raise ValueError("the times do not ascend")
    header, columns = ["t", "fx", "fy", "fz"], [t, *forces.T]
    if points is not None:
        points = np.asarray(points, dtype=np.float64)
        if points.shape != forces.shape:
            raise ValueError(f"points needs the shape {forces.shape}, and has {points.shape}")
        header += ["px", "py", "pz"]
        columns += [*points.T]
    cells = [["" if value != value else repr(value) for value in column.tolist()] for column in columns]
    if mode is not None:
        words = np.asarray(mode).tolist()
        if len(words) != len(t) or not set(words) <= set(MODES):
            raise ValueError(f"mode needs one of {', '.join(MODES)} for each row")
        header.append("mode")
        cells.append(words)
    return "\n".join(",".join(row) for row in [header, *zip(*cells)])


def conform(
    scene: Scene,
    renderer: Optional[AnyRenderer] = None,
    progress: Progress = None,
    *,
    renderer_options: str = "",
) -> Dict[str, Any]:
    """Checks the properties that every haptic renderer has, over the scene's body, law and surface, along motions from the
    place where the scene's path first touches the body.

    The result has the keys of ``conformance.json``: ``properties`` has a verdict for each, with what was measured and its
    limit. Several runs are made; ``create`` begins each of them, and has to leave nothing of the one before. What the
    renderer raises in a run is a finding about it.

    Raises ``SceneError`` if the scene cannot start, and ``ValueError`` if its path never touches the body.
    """
    parts = Parts.of(renderer, renderer_options)
    with watched(progress, _stickslip.RUNS, f"{scene.name}: conformance") as done:
        return _read(_stickslip.conform(scene._core, parts, done))
