"""Progress of long work: a bar on a terminal, lines elsewhere."""

import sys
from collections.abc import Callable, Iterable
from typing import Any, TextIO

from tqdm import tqdm

LINE_INTERVAL = 30.0
"""Time [s] between two lines where stderr is no terminal, as in a log of a cluster."""
SMOOTHING = 0.1
"""Weight of the latest rate in the estimate of the time that is left: enough to follow work that becomes slower."""
LINE = "{desc}: {n_fmt} of {total_fmt}{unit}, {percentage:.0f} %, {elapsed} elapsed, about {remaining} left{postfix}"
COUNT = "{desc}: {n_fmt}{unit}, {elapsed} elapsed{postfix}"
"""Of work whose extent is not known."""
BAR = "{l_bar}{bar}| {n_fmt}/{total_fmt}{unit} [{elapsed}<{remaining}{postfix}]"


class Progress(tqdm):
    """A bar of tqdm on stderr; where that is no terminal, a line every LINE_INTERVAL seconds, and one at the end.
    total: of the work. unit: of its parts, in the plural. decimals: of both, where they are no whole numbers. The other
    arguments are those of tqdm."""

    def __init__(self, work: Iterable[Any] | None = None, *, total: float | None = None, desc: str = "progress",
                 unit: str = "", decimals: int = 0, **options: Any) -> None:
        is_terminal = sys.stderr.isatty()
        form = BAR if is_terminal else COUNT if total is None and not hasattr(work, "__len__") else LINE
        if decimals:
            form = form.replace("{n_fmt}", f"{{n:.{decimals}f}}").replace("{total_fmt}", f"{{total:.{decimals}f}}")
        super().__init__(work, total=total, desc=desc, unit=f" {unit}" if unit else "", file=sys.stderr,
                         bar_format=form, smoothing=SMOOTHING, miniters=1,
                         mininterval=0.5 if is_terminal else LINE_INTERVAL, **options)

    @staticmethod
    def status_printer(file: TextIO) -> Callable[[str], None]:
        """Return what prints a state: over the last one on a terminal, else as a line of its own."""
        if file.isatty():
            return tqdm.status_printer(file)
        last = [""]

        def write_line(text: str) -> None:
            text = text.strip()
            if text and text != last[0]:
                last[0] = text
                file.write(f"{text}\n")
                file.flush()

        return write_line

    def set_postfix_str(self, s: str = "", refresh: bool = True) -> None:
        """Set what stands behind a state; a bar shows it at once, a line waits for its time."""
        super().set_postfix_str(s, refresh and sys.stderr.isatty())

    def set_postfix(self, ordered_dict: Any = None, refresh: bool = True, **values: Any) -> None:
        """Set it from names and values."""
        super().set_postfix(ordered_dict, refresh and sys.stderr.isatty(), **values)

    def moveto(self, n: int) -> None:
        """Move to the n-th of several bars; lines need no place."""
        if sys.stderr.isatty():
            super().moveto(n)

    def close(self) -> None:
        """Print the last state. May be called twice."""
        if self.disable or sys.stderr.isatty():
            super().close()
            return
        self.display()
        self.disable = True
        self._decr_instances(self)  # pyright: ignore[reportAttributeAccessIssue]
