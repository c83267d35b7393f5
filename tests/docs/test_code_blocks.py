"""Every code block of the documentation runs: Python page by page, commands through the real parser."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from pages import ROOT, Block, blocks, name, pages

BREAK = "---- end of block ----"
NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?", re.I)
RELATIVE = 0.02
"""Share by which a printed number may differ from the page's: threads and processors round sums differently."""
SHELL = ("cd", "pip", "python", "python3", "pytest", ".venv/bin/pip", ".venv/bin/python", ".", "sudo", "git", "export",
         "tensorboard", "ros2", "ssh")
"""First words of commands that are not ours."""


def python_of(page: Path) -> list[Block]:
    return [b for b in blocks(page) if b.language == "python" and b.is_run]


def is_slow(page: Path) -> bool:
    return any("slow" in b.marks for b in python_of(page))


PYTHON = [pytest.param(page, id=name(page), marks=[pytest.mark.slow] * is_slow(page)) for page in pages()
          if python_of(page)]
COMMANDS = [pytest.param(page, block, id=f"{name(page)}:{block.line}") for page in pages() for block in blocks(page)
            if block.language == "bash"]
RUN = [param for param in COMMANDS if "run" in param.values[1].marks]


def folder_for(page: Path, folder: Path) -> None:
    """Write the page's files into a folder; configs is there, too."""
    (folder / "configs").symlink_to(ROOT / "configs")
    for block in blocks(page):
        if "file" in block.marks:
            (folder / block.marks["file"]).write_text(block.text)


def expected_after(page: Path) -> list[str | None]:
    """For every Python block, the text of the output block that follows it, or None."""
    found = [b for b in blocks(page) if b.is_run]
    return [found[k + 1].text if k + 1 < len(found) and found[k + 1].language == "output" else None
            for k, b in enumerate(found) if b.language == "python"]


def same(printed: str, shown: str) -> bool:
    """Whether two outputs agree: words exactly, numbers to RELATIVE."""
    if NUMBER.sub("#", printed).split() != NUMBER.sub("#", shown).split():
        return False
    pairs = zip(NUMBER.findall(printed), NUMBER.findall(shown))
    return all(abs(float(a) - float(b)) <= RELATIVE * abs(float(b)) + 1e-12 for a, b in pairs)


@pytest.mark.long
@pytest.mark.parametrize("page", PYTHON)
def test_python_runs_and_prints_what_the_page_shows(page: Path, tmp_path: Path) -> None:
    """All blocks of a page in one process, in order, without a warning; those of the README each by itself."""
    folder_for(page, tmp_path)
    texts = [b.text for b in python_of(page)]
    scripts = texts if page.name == "README.md" else [f"\nprint({BREAK!r})\n".join(texts)]
    outputs: list[str] = []
    for script in scripts:
        (tmp_path / "page.py").write_text(script)
        done = subprocess.run([sys.executable, "-W", "error::UserWarning", "page.py"], cwd=tmp_path, text=True,
                              capture_output=True, timeout=900)
        assert done.returncode == 0, done.stderr[-3000:]
        outputs += done.stdout.split(BREAK)
    for printed, shown in zip(outputs, expected_after(page), strict=True):
        assert "nan" not in printed
        if shown is not None:
            lines = [line for line in printed.splitlines() if not line.startswith("[Taichi]")]
            assert same("\n".join(lines), shown), printed


def lines_of(block: Block) -> list[str]:
    """The commands of a shell block: continued lines joined, comments left out."""
    joined = block.text.replace("\\\n", " ")
    return [part.strip() for line in joined.splitlines() for part in line.split(" #")[0].split("&&")
            if part.strip() and not part.strip().startswith("#")]


@pytest.mark.parametrize(("page", "block"), COMMANDS)
def test_commands_parse(page: Path, block: Block, capsys: pytest.CaptureFixture) -> None:
    """With the parser of the command line, or as a target of the Makefile."""
    from robosim.commands.main import parser

    targets = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.M))
    for line in lines_of(block):
        words = shlex.split(re.split(r"\s[|>]", line)[0])
        while words and re.fullmatch(r"\w+=\S*", words[0]):
            words = words[1:]
        if words and words[0] in ("robosim", ".venv/bin/robosim"):
            try:
                parser().parse_args(words[1:])
            except SystemExit as ended:
                assert ended.code in (0, None), f"{line}\n{capsys.readouterr().err}"
        elif words and words[0] == "make":
            assert all("=" in word or word in targets for word in words[1:]), line
        else:
            assert not words or words[0] in SHELL, f"{line!r}: a command that is not known here"


@pytest.mark.slow
@pytest.mark.parametrize(("page", "block"), RUN)
def test_commands_run(page: Path, block: Block, tmp_path: Path) -> None:
    """Those that take a few minutes at most, in an empty folder."""
    folder_for(page, tmp_path)
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(["bash", "-e", "-c", block.text], cwd=tmp_path, text=True, capture_output=True, timeout=1800,
                          env={**os.environ, "PATH": path})
    assert done.returncode == 0, (done.stdout + done.stderr)[-3000:]
