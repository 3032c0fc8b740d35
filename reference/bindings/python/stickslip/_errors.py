"""The error of a scene."""

from __future__ import annotations

from typing import Optional


class SceneError(ValueError):
    """A scene that cannot be read, or cannot start.

    The message, the place and the help are those that the program ``stickslip`` prints.

    >>> import stickslip
    >>> try:
    ...     stickslip.Scene.shipped("fig5-stick-slip").with_keys(duration=-1.0)
    ... except stickslip.SceneError as error:
    ...     print(error)
    change:1:10: `duration` cannot be -1
        duration=-1.0
                 ^^^^
    help: accepted: a finite number above 0, in s, that is a whole number of ticks of `local.rate`
    """

    # Tracebacks name what users import.
    __module__ = "stickslip"

    #: What is wrong.
    message: str
    #: File, or the name of a scene without one; "change" for a key that was set from Python.
    file: Optional[str]
    #: Line and column of the place, from 1, where there is one.
    line: Optional[int]
    column: Optional[int]
    #: What is accepted, or the way out, where there is one.
    help: Optional[str]
    #: The line of the file.
    source_line: Optional[str]

    def __init__(
        self,
        message: str,
        file: Optional[str] = None,
        line: Optional[int] = None,
        column: Optional[int] = None,
        help: Optional[str] = None,
        source_line: Optional[str] = None,
        width: int = 1,
    ) -> None:
        # All of them, so that the exception can be pickled.
        super().__init__(message, file, line, column, help, source_line, width)
        self.message, self.file, self.line, self.column = message, file, line, column
        self.help, self.source_line, self._width = help, source_line, width

    def __str__(self) -> str:
        place = [str(part) for part in (self.file, self.line, self.column) if part is not None]
        lines = [f"{':'.join(place)}: {self.message}" if place else self.message]
        if self.source_line is not None and self.column is not None and len(self.source_line) <= 160:
            before = self.source_line[: self.column - 1]
            lines += [f"    {self.source_line}", f"    {' ' * len(before)}{'^' * self._width}"]
        if self.help is not None:
            lines.append(f"help: {self.help}")
        return "\n".join(lines)
