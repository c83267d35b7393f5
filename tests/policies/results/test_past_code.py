"""The code of an earlier commit, from the history of a checkout made for the test."""

import subprocess
from pathlib import Path

import pytest

import mpm
from policies.results.past_code import past_code, run_git


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A repository whose file says 1 in its first commit and 2 in its second."""
    root = tmp_path / "checkout"
    root.mkdir()
    run_git(root, "init", "--quiet")
    for text in ("1", "2"):
        (root / "code.py").write_text(text)
        run_git(root, "add", "code.py")
        subprocess.run(["git", "-c", "user.name=t", "-c", "user.email=t@example.org", "commit", "--quiet", "-m", text],
                       cwd=root, check=True)
    return root


def test_an_earlier_commit_is_unpacked_beside_the_present_files(checkout: Path) -> None:
    """And removed at the end."""
    with past_code(run_git(checkout, "rev-parse", "--short", "HEAD~1"), checkout) as folder:
        assert (folder / "code.py").read_text() == "1"
        assert (checkout / "code.py").read_text() == "2"
    assert not folder.exists()


@pytest.mark.parametrize("commit", ["0123456", "HEAD-dirty", "none, version 0.1.0", "--output=code.py"])
def test_what_is_no_commit_is_refused_and_changes_nothing(checkout: Path, commit: str) -> None:
    """Options of git among it."""
    with pytest.raises(mpm.InvalidValue) as error, past_code(commit, checkout):
        pass
    assert commit in str(error.value)
    assert (checkout / "code.py").read_text() == "2"
