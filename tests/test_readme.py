"""The README: its length, its picture and the files that it names. Its code blocks run in tests/docs."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text()


def test_it_is_short() -> None:
    assert len(README.splitlines()) <= 150


@pytest.mark.parametrize("target", sorted(set(re.findall(r"\]\(([^)#]+)\)", README))))
def test_what_it_links_to_exists(target: str) -> None:
    assert (ROOT / target).exists()


@pytest.mark.parametrize("folder", re.findall(r"^\| `(\w+/)` \|", README, re.M))
def test_folders_of_the_map_exist(folder: str) -> None:
    assert (ROOT / folder).is_dir()


def test_the_picture_is_small() -> None:
    for picture in re.findall(r"!\[[^\]]+\]\(([^)]+)\)", README):
        assert (ROOT / picture).stat().st_size < 300_000


def test_both_kinds_of_snippet_say_what_they_print() -> None:
    """tests/docs compares the output with the block after it; a block without one would pass with any output."""
    kinds = re.findall(r"^ *```(\w+)$", README, re.M)
    assert kinds.count("python") == 2
    assert all(kinds[k + 1] == "output" for k, kind in enumerate(kinds) if kind == "python")
