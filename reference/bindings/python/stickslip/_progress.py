"""Progress of long calls."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from typing import Callable, Iterator, Optional, Union

#: ``None``: a bar if tqdm is installed and standard error is a terminal. ``True``: a bar, or a line without tqdm.
#: ``False``: nothing. A function is called with the ticks done and their total.
Progress = Union[None, bool, Callable[[int, int], object]]


@contextmanager
def watched(progress: Progress, total: int, label: str) -> Iterator[Optional[Callable[[int], object]]]:
    """Gives the function that the compiled module calls with the ticks done, or ``None``."""
    if callable(progress):
        call = progress
        yield lambda done: call(done, total)
        call(total, total)
        return
    if progress is False or (progress is None and not sys.stderr.isatty()):
        yield None
        return
    try:
        from tqdm.auto import tqdm  # type: ignore[import-untyped, unused-ignore]
    except ImportError:
        if progress is None:
            yield None
            return

        def write(done: int) -> None:
            print(f"\r{label}: {100 * done // max(total, 1)} %", end="", file=sys.stderr, flush=True)

        yield write
        write(total)
        print(file=sys.stderr)
        return
    with tqdm(total=total, desc=label, unit="tick", leave=False) as bar:
        yield lambda done: bar.update(done - bar.n)
        bar.update(total - bar.n)
