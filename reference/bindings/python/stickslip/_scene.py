"""Scenes."""

from __future__ import annotations

import os
from typing import Any, List, Mapping, Optional, Tuple, Union

from . import _stickslip

#: Name in errors of a scene that has no file; files that it mentions are relative to the working directory.
_NO_FILE = "scene.toml"


class Scene:
    """The settings of a simulation, read and checked. Scenes never change: ``with_keys`` returns another.

    >>> scene = Scene.shipped("fig5-stick-slip")
    >>> scene
    Scene('fig5-stick-slip', 1200 ticks of 0.001 s)
    >>> scene.with_keys({"contact.friction": 0.5, "local.rings": 2}, duration=0.3).tick_count
    300

    The keys are those of scene files (``reference/docs/scenes.md``).
    """

    __slots__ = ("_core",)
    _core: _stickslip.Scene

    def __init__(self) -> None:
        raise TypeError("use Scene.shipped, from_file, from_toml or from_dict")

    @classmethod
    def _of(cls, core: _stickslip.Scene) -> Scene:
        scene = object.__new__(cls)
        scene._core = core
        return scene

    @staticmethod
    def shipped_names() -> List[str]:
        """Names of the scenes that are shipped with the package.

        >>> Scene.shipped_names()[:2]
        ['fig3-sliding', 'fig4-sticking']
        """
        return _stickslip.Scene.shipped_names()

    @classmethod
    def shipped(cls, name: str) -> Scene:
        """A scene that is shipped with the package. Raises ``ValueError`` if there is none of this name."""
        core = _stickslip.Scene.shipped(name)
        if core is None:
            raise ValueError(f"no shipped scene is called {name!r}; there are {', '.join(cls.shipped_names())}")
        return cls._of(core)

    @classmethod
    def from_file(cls, path: Union[str, os.PathLike[str]]) -> Scene:
        """Reads a scene file. Raises ``SceneError`` if it is not a scene."""
        return cls._of(_stickslip.Scene.load(os.fspath(path)))

    @classmethod
    def from_toml(cls, text: str, path: Union[str, os.PathLike[str]] = _NO_FILE) -> Scene:
        """Reads a scene from TOML. ``path`` names it in errors, and files that it mentions are relative to ``path``.

        Raises ``SceneError`` if the text is not a scene.
        """
        return cls._of(_stickslip.Scene.parse(text, os.fspath(path)))

    @classmethod
    def from_dict(cls, keys: Mapping[str, Any], path: Union[str, os.PathLike[str]] = _NO_FILE) -> Scene:
        """Reads a scene from nested dictionaries, in the shape of a scene file; dotted keys reach into tables.

        Numbers and arrays of numpy are accepted, and a value of ``None`` is left out. Raises ``SceneError`` if they are
        not a scene.

        >>> import numpy as np
        >>> scene = Scene.from_dict({
        ...     "name": "press",
        ...     "duration": 0.2,
        ...     "mesh": {"nodes": [9, 9, 4], "spacing": 0.01},
        ...     "material": {"node_mass": 0.005, "stiffness": 200.0, "damping": 0.2},
        ...     "contact": {"law": "stick-slip", "friction": 0.5},
        ...     "instrument.waypoints": np.array([[0.0, 0.0, 0.0, 0.002], [0.2, 0.0, 0.0, -0.002]]),
        ... })
        >>> scene.name, scene.tick_count
        ('press', 200)
        """
        return cls._of(_stickslip.Scene.build(list(keys.items()), os.fspath(path)))

    def with_keys(self, keys: Optional[Mapping[str, Any]] = None, /, **more: Any) -> Scene:
        """The scene with other values of some keys. ``None`` removes a key, so that its default applies.

        A key in a table is written with dots, in a dictionary; a dictionary as a value changes the keys in it. All changes
        are made before the scene is read again, so that keys which depend on each other can be changed together;
        comments and layout of the file stay. Raises ``SceneError`` if the result is not a scene.

        >>> scene = Scene.shipped("deep-stick-slip").with_keys({"local.exterior": "condensed"})
        >>> 'exterior = "condensed"' in scene.toml
        True
        """
        return self._of(self._core.with_keys([*(keys or {}).items(), *more.items()]))

    @property
    def name(self) -> str:
        """Name of the scene."""
        return self._core.name

    @property
    def toml(self) -> str:
        """The scene as TOML."""
        return self._core.text

    @property
    def path(self) -> str:
        """Path of its file, or the name of a shipped scene."""
        return self._core.path

    @property
    def tick_s(self) -> float:
        """Time between two ticks, s."""
        return self._core.tick_s

    @property
    def duration_s(self) -> float:
        """Duration of a run, s."""
        return self._core.duration_s

    @property
    def tick_count(self) -> int:
        """Number of ticks of a run."""
        return self._core.tick_count

    @property
    def warnings(self) -> List[str]:
        """Settings that are accepted and may be unintended, in words."""
        return self._core.warnings

    def __repr__(self) -> str:
        return f"Scene({self.name!r}, {self.tick_count} ticks of {self.tick_s:g} s)"

    def __reduce__(self) -> Tuple[Any, Tuple[str, str]]:
        return (Scene.from_toml, (self.toml, self.path))
