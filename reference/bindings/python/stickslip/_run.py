"""Runs."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Dict, Optional

import numpy as np
from numpy.typing import NDArray

from . import _stickslip
from ._adapters import AnyRenderer, Parts
from ._parts import Floats, Instrument
from ._progress import Progress, watched
from ._scene import Scene

if TYPE_CHECKING:
    import pandas


class Result:
    """Result of a run.

    >>> import stickslip
    >>> result = stickslip.run(stickslip.Scene.shipped("fig5-stick-slip"))
    >>> sorted(set(result.trace["mode"].tolist()))
    ['free', 'slip', 'stick']
    >>> result.summary["verdict"]["verdict"], result.fault
    ('PASS', None)
    """

    #: The columns of ``trace.csv``, one value per tick. An empty cell is NaN in a column of floats, -1 in ``triangle``,
    #: and an empty word in ``timing``. A run that has not completed a tick has no columns.
    trace: Dict[str, NDArray[Any]]
    #: The contents of ``summary.json``.
    summary: Dict[str, Any]

    def __init__(self, trace: Dict[str, NDArray[Any]], summary: Dict[str, Any]) -> None:
        self.trace, self.summary = trace, summary

    @property
    def fault(self) -> Optional[str]:
        """The fault that ended the run, if one did; the ticks before it are kept."""
        fault: Optional[str] = self.summary["fault"]
        return fault

    @property
    def t(self) -> Floats:
        """Times at the ends of the ticks, s."""
        return self.trace["t"]

    @property
    def forces(self) -> Floats:
        """Forces commanded to the instrument, N: (ticks, 3)."""
        return np.stack([self.trace[name] for name in ("fx", "fy", "fz")], axis=1)

    def to_pandas(self) -> pandas.DataFrame:
        """The trace as a data frame of pandas, which has to be installed."""
        import pandas

        frame: pandas.DataFrame = pandas.DataFrame(self.trace)
        return frame

    def __repr__(self) -> str:
        ticks, verdict = self.summary["ticks"], self.summary["verdict"]["verdict"]
        return f"Result({self.summary['scene']!r}, {ticks} ticks, {verdict})"


def run(
    scene: Scene,
    renderer: Optional[AnyRenderer] = None,
    instrument: Optional[Instrument] = None,
    progress: Progress = None,
    *,
    renderer_options: str = "",
) -> Result:
    """Runs a scene in virtual time.

    ``renderer`` takes the place of the scene's local model, contact scheme and contact law: an object in Python, or the
    path of a shared library, which then runs in this process with ``renderer_options``. ``instrument`` takes the place of
    the scene's. A fault ends the run and is part of the result. Other threads go on in the meantime, and Ctrl-C ends it.

    Raises ``SceneError`` if the scene cannot start, and whatever a renderer or an instrument in Python raises.

    >>> import stickslip
    >>> result = stickslip.run(stickslip.Scene.shipped("fig3-sliding"))
    >>> result
    Result('fig3-sliding', 1200 ticks, PASS)
    >>> bool(result.trace["fn"].max() > 1.0)
    True
    """
    with watched(progress, scene.tick_count, scene.name) as done:
        columns, summary = _stickslip.run(scene._core, Parts.of(renderer, renderer_options, instrument), done)
    return Result({name: _column(*column) for name, column in columns.items()}, json.loads(summary))


def _column(kind: str, values: Any) -> NDArray[Any]:
    return np.array(values, dtype=np.str_) if kind == "U" else np.frombuffer(values, dtype=kind)

