"""constraints.txt: an exact version of everything that an install can need, for each Python version."""

import os
import re
import subprocess
import sys
from functools import cache
from importlib.metadata import PackageNotFoundError, requires, version
from itertools import pairwise
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[1]
PYTHONS = ("3.10", "3.11", "3.12", "3.13")


@cache
def read_project() -> dict[str, list[str]]:
    """Requirements by extra; "" are those without one. Python 3.10 has no reader of TOML: a table is a list a line."""
    lists = re.findall(r"^(\w+) = \[\n(.*?)^\]", (ROOT / "pyproject.toml").read_text(), re.M | re.S)
    wanted = ("dependencies", *re.search(r"^EXTRAS := (.*)$", (ROOT / "Makefile").read_text(), re.M)[1].split(","))
    return {name if name != "dependencies" else "": re.findall(r'^ +"([^"]+)"', body, re.M)
            for name, body in lists if name in wanted}


def environment(python: str, extra: str = "") -> dict[str, str]:
    """What markers are evaluated with."""
    return {"python_version": python, "python_full_version": f"{python}.99", "extra": extra,
            "platform_system": "Linux", "sys_platform": "linux", "platform_machine": "x86_64", "os_name": "posix",
            "implementation_name": "cpython", "platform_python_implementation": "CPython"}


@cache
def pins(python: str) -> dict[str, str]:
    """Versions by name for one Python version."""
    found: dict[str, str] = {}
    for line in (ROOT / "constraints.txt").read_text().splitlines():
        if line and not line.startswith("#"):
            requirement = Requirement(line)
            if requirement.marker is None or requirement.marker.evaluate(environment(python)):
                name = canonicalize_name(requirement.name)
                assert re.fullmatch(r"==[\w.]+", str(requirement.specifier)), f"{line}: not an exact version"
                assert name not in found, f"{line}: a second version for Python {python}"
                found[name] = str(requirement.specifier)[2:]
    return found


def find_faults(requirement: Requirement, python: str, by: str) -> list[str]:
    """What the constraints lack for a requirement that holds on a Python version."""
    pinned = pins(python).get(canonicalize_name(requirement.name))
    if pinned is None:
        return [f"{by} needs {requirement} on Python {python}: no version in constraints.txt"]
    if not requirement.specifier.contains(pinned, prereleases=True):
        return [f"{by} needs {requirement} on Python {python}: constraints.txt has {pinned}"]
    return []


def test_every_extra_is_resolved_and_checked() -> None:
    """`make constraints` and the tests below see all extras of the project."""
    section = (ROOT / "pyproject.toml").read_text().split("[project.optional-dependencies]")[1].split("\n[")[0]
    extras = re.findall(r"^(\w+) = \[", section, re.M)
    assert sorted(extras) == sorted(set(read_project()) - {""})
    assert all(read_project().values())
    assert {"human", "record"} < set(extras)


@pytest.mark.parametrize("python", PYTHONS)
def test_the_requirements_and_what_they_need_in_turn_have_a_version_within_their_bounds(python: str) -> None:
    """In turn: as far as the version for that Python is installed here, most of the extras test and learn at least.

    Another version may need something else."""
    faults, seen = [], set()
    queue = [(Requirement(text), "robosim") for texts in read_project().values() for text in texts]
    while queue:
        requirement, by = queue.pop()
        faults += find_faults(requirement, python, by)
        for extra in ("", *sorted(requirement.extras)):
            if (requirement.name, extra) in seen:
                continue
            seen.add((requirement.name, extra))
            try:
                if version(requirement.name).split("+")[0] != pins(python).get(canonicalize_name(requirement.name)):
                    continue
                needed = [Requirement(text) for text in requires(requirement.name) or ()]
            except PackageNotFoundError:
                continue
            queue += [(one, requirement.name) for one in needed
                      if one.marker is None or one.marker.evaluate(environment(python, extra))]
    assert not faults, "\n".join(faults)
    assert len(seen) > 50


def test_every_bound_has_a_reason() -> None:
    """A comment at the end of its line or on the line above."""
    lines = (ROOT / "pyproject.toml").read_text().split("dependencies = [")[1].split("[project.scripts]")[0]
    lines = lines.splitlines()
    bare = [line for above, line in pairwise(lines)
            if line.startswith('    "') and "#" not in line and not above.strip().startswith("#")]
    assert not bare


def run_make(*words: str) -> subprocess.CompletedProcess:
    """Without what a make that runs the tests hands down."""
    variables = {key: value for key, value in os.environ.items() if key not in ("MAKEFLAGS", "PYTHON", "VENV")}
    return subprocess.run(["make", *words], cwd=ROOT, env=variables, capture_output=True, text=True)


def test_make_uses_the_interpreter_that_it_is_told() -> None:
    commands = run_make("--dry-run", "test", "PYTHON=/somewhere/python3.12")
    assert "/somewhere/python3.12 -m venv .venv-python3.12" in commands.stdout
    assert ".venv-python3.12/bin/python -m pytest" in commands.stdout


def test_make_refuses_an_environment_of_another_version(tmp_path: Path) -> None:
    """Without the refusal the environment that is there would be used, whatever PYTHON says."""
    other = tmp_path / "bin" / "python"
    other.parent.mkdir()
    other.write_text("#!/bin/sh\necho 3.9\n")
    other.chmod(0o755)
    refused = run_make("interpreter", f"PYTHON={sys.executable}", f"VENV={tmp_path}")
    assert refused.returncode != 0
    assert f"{tmp_path} has Python 3.9" in refused.stderr
    other.unlink()
    assert run_make("interpreter", f"PYTHON={sys.executable}", f"VENV={tmp_path}").returncode == 0
