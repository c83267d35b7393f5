"""One backend for the whole suite: double precision is asked for per solver."""

import os

os.environ.setdefault("MUJOCO_GL", "egl")

import mpm

mpm.init(arch="cpu", precision="f32", threads=1)
