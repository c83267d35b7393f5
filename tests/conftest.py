"""One backend for the whole suite: double precision is asked for per solver."""

import mpm
from robosim.graphics import choose_graphics

choose_graphics()

mpm.init(arch="cpu", precision="f32", threads=1)
