"""Digests of code: which modules they read, and how often."""

import pkgutil

import mpm
import policies
import robosim
from policies.learning import code_digests


def test_a_second_look_at_every_module_reads_no_file(monkeypatch):
    names = [module.name for package in (mpm, robosim, policies)
             for module in pkgutil.walk_packages(package.__path__, package.__name__ + ".") if not module.ispkg]
    assert len(names) > 200  # more than a bounded cache would keep
    first = [code_digests.module_digest(name) for name in names]
    monkeypatch.setattr(code_digests, "source_digest", None)  # raises where it is called
    assert [code_digests.module_digest(name) for name in names] == first
