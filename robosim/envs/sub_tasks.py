"""The bundled tasks as Gymnasium environments; their pages are made from configs/tasks."""

from robosim.envs import BUNDLED
from robosim.envs.grain_env import GrainEnv
from robosim.tasks.page import build_page

for _name in BUNDLED:
    globals()[_name] = type(_name, (GrainEnv,), {
        "TASK": _name, "__doc__": build_page(_name), "__module__": __name__, "__qualname__": _name})
