"""Tests of learning: without the extra `learn` those that need it are left out; torch has one thread, as in runs."""

from importlib.util import find_spec

collect_ignore = [] if find_spec("torch") else ["dynamics", "learners", "methods", "runs"]
if find_spec("torch"):
    import torch

    torch.set_num_threads(1)
