"""The bundled tasks as Gymnasium environments; their pages are made from configs/tasks."""

from robosim.envs.grain_env import GrainEnv
from robosim.tasks.page import build_page


class SubTask(GrainEnv):
    """Base of the sub-tasks: the class's name is the task's, and its docstring the task's page."""

    def __init_subclass__(cls) -> None:
        cls.TASK = cls.__name__
        cls.__doc__ = build_page(cls.TASK)


class SpoonScoop(SubTask):
    pass


class SpoonTranslate(SubTask):
    pass


class SpoonPour(SubTask):
    pass


class ScoopScoop(SubTask):
    pass


class ScoopTranslate(SubTask):
    pass


class ScoopPour(SubTask):
    pass


class BottlePickPour(SubTask):
    pass


class ShovelMove(SubTask):
    pass


class DoseSpoon(SubTask):
    pass


class DoseScoop(SubTask):
    pass


class DoseBottle(SubTask):
    pass


class DoseShaker(SubTask):
    pass


class ScoopTo(SubTask):
    pass
