"""Fenced blocks of the documentation, with the marks that stand in a comment in front of them.
`slow`: more than a few seconds. `file: NAME`: written to this file before the page runs. `run`: a shell block that is
run, not only parsed. `skip: REASON`. `needs: MODULE`: left out without it. A block `output` holds what is printed."""

import re
import textwrap
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
BLOCK = re.compile(r"^(?: *<!-- (?P<marks>[^>\n]+) -->\n)?"
                   r"(?P<indent> *)```(?P<language>\w+)\n(?P<text>.*?)^(?P=indent)```$", re.M | re.S)


@dataclass(frozen=True)
class Block:
    """A fenced block and what its marks say."""

    language: str
    text: str
    marks: dict[str, str]
    line: int

    @property
    def is_run(self) -> bool:
        needed = self.marks.get("needs")
        return "skip" not in self.marks and (needed is None or find_spec(needed) is not None)


def pages() -> list[Path]:
    """README and every page of docs/, generated ones and built ones aside."""
    written = [path for path in sorted((ROOT / "docs").rglob("*.md"))
               if not {"_build", "_generated"} & set(path.relative_to(ROOT).parts)]
    return [ROOT / name for name in ("README.md", "CONTRIBUTING.md") if (ROOT / name).is_file()] + written


def blocks(page: Path) -> list[Block]:
    """The fenced blocks of a page, in order."""
    text = page.read_text()
    found = []
    for match in BLOCK.finditer(text):
        marks = dict((part.split(":", 1) + [""])[:2] for part in (match["marks"] or "").split(",") if part)
        marks = {key.strip(): value.strip() for key, value in marks.items()}
        line = text.count("\n", 0, match.start()) + 1
        found.append(Block(match["language"], textwrap.dedent(match["text"]), marks, line))
    return found


def name(page: Path) -> str:
    """A page's path below the repository, for test ids."""
    return page.relative_to(ROOT).as_posix()
