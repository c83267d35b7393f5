"""The eight sub-tasks as Gymnasium environments; their pages are made from configs/tasks."""

from robosim.envs.grain_env import GrainEnv
from robosim.tasks.page import page


class SubTask(GrainEnv):
    """A sub-task by its class's name."""

    def __init_subclass__(cls) -> None:
        cls.TASK = cls.__name__
        cls.__doc__ = page(cls.TASK)


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
