"""Between the compiled module, which passes bytes and tuples, and the classes that users write, which get arrays."""

from __future__ import annotations

import os
from typing import Any, Dict, NamedTuple, Optional, Tuple, Union

import numpy as np
from numpy.typing import NDArray

from ._parts import MODES, Body, Floats, Instrument, Rendered, Renderer, Setup, State, vector

#: A renderer in Python, or the path of a shared library with one.
AnyRenderer = Union[Renderer, str, "os.PathLike[str]"]

#: Types and row lengths of the body's arrays; all others are one number a row.
_TYPES = {"fixed": np.bool_, "spring_nodes": np.uint32, "triangles": np.uint32}
_ROWS = {"rest": 3, "spring_nodes": 2, "triangles": 3}

_Vector = Tuple[float, float, float]
_Contact = Optional[Tuple[int, _Vector, _Vector]]


def _rows(values: bytes) -> Floats:
    return np.frombuffer(values, dtype=np.float64).reshape(-1, 3)


def _array(name: str, values: bytes) -> NDArray[Any]:
    array: NDArray[Any] = np.frombuffer(values, dtype=_TYPES.get(name, np.float64))
    return array.reshape(-1, _ROWS[name]) if name in _ROWS else array


class RendererAdapter:
    """Calls a renderer."""

    def __init__(self, renderer: Renderer) -> None:
        self._renderer = renderer

    def create(self, body: Dict[str, Any], setup: Dict[str, Any]) -> None:
        arrays = {name: _array(name, value) for name, value in body.items() if isinstance(value, bytes)}
        self._renderer.create(Body(**arrays, drag=body["drag"]), Setup(**setup))

    def build(
        self, tick: int, x: bytes, v: bytes, tip: _Vector, last: Tuple[_Vector, int, _Contact]
    ) -> Tuple[ModelAdapter, bool]:
        force, mode, contact = last
        rendered = Rendered(np.array(force), MODES[mode])
        if contact is not None:
            triangle, weights, normal = contact
            rendered = Rendered(np.array(force), MODES[mode], triangle, np.array(weights), np.array(normal))
        model = self._renderer.build(State(tick, _rows(x), _rows(v), np.array(tip), rendered))
        if not callable(getattr(model, "tick", None)):
            raise TypeError(f"build returned {type(model).__name__}, which has no method tick")
        adapter = ModelAdapter(model)
        return adapter, adapter.moved is not None


class ModelAdapter:
    """Calls a model of a renderer."""

    def __init__(self, model: Any) -> None:
        self._model = model
        self._tick = model.tick
        self.moved = getattr(model, "moved", None)

    def take_over(self, old: Optional[ModelAdapter]) -> None:
        take_over = getattr(self._model, "take_over", None)
        if take_over is not None:
            take_over(None if old is None else old._model)

    def tick(
        self, before: _Vector, tip: _Vector
    ) -> Tuple[_Vector, int, _Contact, Optional[Tuple[bytes, bytes, bytes]]]:
        result = _rendered(self._tick(np.array(before), np.array(tip)))
        return (*result, None if self.moved is None else _moved(self.moved()))


def _rendered(result: Any) -> Tuple[_Vector, int, _Contact]:
    if result is None:
        return (0.0, 0.0, 0.0), 0, None
    if not (isinstance(result, tuple) and len(result) == 5):
        force = vector(result, "a force")
        return force, MODES.index("slide") if any(force) else 0, None
    force, mode, triangle, weights, normal = result
    if mode not in MODES:
        raise ValueError(f"the mode {mode!r} is none of {', '.join(MODES)}")
    contact: _Contact = None
    if triangle is not None:
        contact = (int(triangle), vector(weights, "a contact's weights"), vector(normal, "a contact's normal"))
    return vector(force, "a force"), MODES.index(mode), contact


def _moved(moved: Any) -> Tuple[bytes, bytes, bytes]:
    nodes, x, v = moved
    nodes = np.asarray(nodes, dtype=np.uint32)
    x, v = np.asarray(x, dtype=np.float64), np.asarray(v, dtype=np.float64)
    if not x.shape == v.shape == (*nodes.shape, 3) or nodes.ndim != 1:
        raise ValueError(f"moved returned arrays of the shapes {nodes.shape}, {x.shape} and {v.shape}")
    return nodes.tobytes(), x.tobytes(), v.tobytes()


class InstrumentAdapter:
    """Calls an instrument."""

    def __init__(self, instrument: Instrument) -> None:
        self._instrument = instrument

    def start(self) -> _Vector:
        return vector(self._instrument.start(), "the tip")

    def sense(self, begin_s: float, end_s: float, contact_force: _Vector) -> Tuple[_Vector, Optional[_Vector]]:
        tip = vector(self._instrument.sense(begin_s, end_s, np.array(contact_force)), "the tip")
        velocity = self._instrument.tip_velocity()
        return tip, None if velocity is None else vector(velocity, "the tip's velocity")

    def command(self, contact_force: _Vector) -> _Vector:
        return vector(self._instrument.command(np.array(contact_force)), "a force")

    def release(self) -> None:
        self._instrument.release()


class Parts(NamedTuple):
    """Custom parts of a run, as the compiled module takes them."""

    #: The name and the adapter of a renderer in Python.
    renderer: Optional[Tuple[str, RendererAdapter]] = None
    #: The path and the options of a renderer in a library.
    library: Optional[Tuple[str, str]] = None
    #: The adapter of an instrument.
    instrument: Optional[InstrumentAdapter] = None

    @classmethod
    def of(cls, renderer: Optional[AnyRenderer], options: str = "", instrument: Optional[Instrument] = None) -> Parts:
        """Wraps what a user gives."""
        adapter = None if instrument is None else InstrumentAdapter(instrument)
        if renderer is None:
            return cls(instrument=adapter)
        if isinstance(renderer, (str, os.PathLike)):
            return cls(library=(os.fspath(renderer), options), instrument=adapter)
        kind = type(renderer)
        return cls(renderer=(f"{kind.__module__}.{kind.__qualname__}", RendererAdapter(renderer)), instrument=adapter)
