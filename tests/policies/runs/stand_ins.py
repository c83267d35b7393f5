"""Stand-ins for physics that takes long, so that hundreds of commands can be interrupted: files and signals are real.

`install` puts them into a process; each step sleeps, so that an interrupt comes at any part of the work.
"""

import json
import os
import signal
import sys
import threading
import time
import traceback
from pathlib import Path
from types import SimpleNamespace

import gymnasium
import mujoco
import numpy as np
from stand_in_rehearsal import install_rehearsal
from tqdm import tqdm

RESTING = '<mujoco><worldbody><body><geom size="0.1"/></body></worldbody></mujoco>'
STEP, DECISIONS = 2e-3, 20
"""Time [s] of a step; steps of an episode."""


class PointEnv(gymnasium.Env):
    """A point that actions move to a goal."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (3,), np.float32)
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (3,), np.float32)

    def reset(self, *, seed=None, options=None):
        gymnasium.Env.reset(self, seed=seed)
        self.position, self.steps = self.np_random.uniform(-1.0, 1.0, 3), 0
        return self.position.astype(np.float32), {}

    def step(self, action):
        time.sleep(STEP)
        self.position, self.steps = self.position + 0.1 * np.asarray(action, float), self.steps + 1
        distance, info = float(np.abs(self.position - 0.5).sum()), {}
        if hasattr(self, "task"):
            info = {"tcs": -distance, "tcs_terms": {}, "is_success": False, "readings": {"delivered": -distance}}
        return self.position.astype(np.float32), -distance, False, self.steps == DECISIONS, info


class PointTask(PointEnv):
    """The point as a sub-task of its own."""

    source = TASK = "SpoonTranslate"

    def __init__(self, **_):
        from robosim.config.materials import load_material
        from robosim.tasks.task import load_task

        self.task, self.material = load_task(self.source), load_material("salt")

    def objective(self):
        return None


def make_filmed_task():
    """Return the point in the place of a sub-task, with pictures of noise."""
    from robosim.envs.grain_env import GrainEnv

    class FilmedTask(PointTask, GrainEnv):
        metadata = {"render_fps": 50}  # noqa: RUF012

        def render(self):
            return np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8)

        def close(self):
            pass

    return FilmedTask()


class Valley:
    """A loss of a motion that is known in closed form; each evaluation is counted in a file."""

    def __init__(self, env, action_repeat, **_):
        self.rollout = SimpleNamespace(last=SimpleNamespace(norms=np.zeros((DECISIONS, 2))))

    def set_start(self):
        time.sleep(10 * STEP)

    def value(self, actions):
        return self.value_and_grad(actions)[0]

    def value_and_grad(self, actions):
        time.sleep(20 * STEP)
        with open(os.environ["EVALUATIONS"], "a") as file:
            file.write(".")
        scale = np.linspace(1.0, 30.0, actions.shape[1])
        return float(np.sum(scale * (actions - 0.3) ** 2)), 2.0 * scale * (actions - 0.3)

    def check_gradient(self, actions):
        return np.zeros((4, 2))


class ForkedProcess:
    """A command in a fork of this process, with the interface of `subprocess.Popen`."""

    def __init__(self, words, stdout=None, stderr=None, **_):
        sys.stdout.flush(), sys.stderr.flush()
        self.returncode = None
        self.pid = os.fork()
        if self.pid == 0:
            run_forked(words[3:], stdout)

    def poll(self):
        if self.returncode is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                self.returncode = os.waitstatus_to_exitcode(status)
        return self.returncode

    def wait(self, timeout=None):
        end = time.monotonic() + (timeout or 3600)
        while self.poll() is None and time.monotonic() < end:
            time.sleep(0.01)
        return self.returncode

    def send_signal(self, number):
        if self.poll() is None:
            os.kill(self.pid, number)

    def terminate(self):
        self.send_signal(signal.SIGTERM)

    def kill(self):
        self.send_signal(signal.SIGKILL)


class EpisodeRecorder:
    """Records a body that rests in the place of a sub-task's scene."""

    def __init__(self, env, path, policy):
        from robosim.recordings.header import CurveEntry
        from robosim.recordings.scene_recorder import SceneRecorder

        model = mujoco.MjModel.from_xml_string(RESTING)
        self._data = mujoco.MjData(model)
        self.recorder = SceneRecorder(path, model, self._data, None, kind="task", title=policy, frame_rate=50.0,
                                      curves=[CurveEntry(name="return", chart="return")])

    def add(self, reward, info):
        self._data.time += 0.02
        self.recorder.add(self._data, lambda grains: [reward])

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        self.recorder.close()


def run_forked(arguments, log):
    """Run a command in this forked process, with its output in an open file, and end the process."""
    code = 70
    try:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL)
        for stream in (1, 2):
            os.dup2(log.fileno(), stream)
        sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w", 1)
        tqdm.set_lock(threading.RLock())  # tqdm's own is shared by forks, and one that is killed may hold it
        from robosim.commands.main import main

        code = main(arguments)
    except SystemExit as end:
        code = end.code
    except KeyboardInterrupt:  # before or after the command
        code = 130
    except BaseException:
        traceback.print_exc()
    finally:
        try:
            sys.stdout.flush(), sys.stderr.flush()
        finally:
            os._exit(code)


def install():
    """Load what the commands need and put the stand-ins in the place of their physics."""
    import policies.demonstrations.demo
    import policies.demonstrations.request
    import policies.methods.method
    import robosim.rehearsal.session
    import robosim.studies.evaluation.evaluate
    import robosim.studies.evaluation.motion_chain
    import robosim.studies.verification.report
    import robosim.viewer.embed
    from policies.demonstrations import generator
    from policies.runs import pipeline, sweep, training
    from robosim.studies.verification import runs

    gymnasium.register("Point-v0", PointEnv, max_episode_steps=DECISIONS)
    make = training.make_training_environment
    training.make_training_environment = lambda task, *a, **o: make(task if task.startswith("Point-v") else "Point-v0",
                                                                    "flat", 1)
    for module in (policies.demonstrations.demo, policies.demonstrations.request):
        module.make_environment = lambda task, **options: PointTask()
    generator.MotionLoss = Valley

    robosim.studies.evaluation.evaluate.EpisodeRecorder = EpisodeRecorder
    # a server's threads are not for a process that is killed a thousand times
    robosim.viewer.embed.embed_html = robosim.studies.evaluation.motion_chain.embed_html = lambda recording: "a scene"
    robosim.studies.evaluation.evaluate.make = lambda task, **options: make_filmed_task()
    runs.WORKER = "stand_in_job"
    os.environ["PYTHONPATH"] = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    pipeline.subprocess = sweep.subprocess = SimpleNamespace(Popen=ForkedProcess, TimeoutExpired=TimeoutError)
    robosim.studies.evaluation.motion_chain.run_chain = stand_in_results("chain.json", {"sub_tasks": []})
    install_rehearsal(robosim.rehearsal.session)


def stand_in_results(name, content):
    """Return a command that works for a while and writes one file."""
    def run(rehearsal, out: Path, **_):
        from robosim.base.output_folder import OutputFolder

        with OutputFolder(out) as folder:
            folder.clear((name,))
            time.sleep(100 * STEP)
            folder.write_json(name, content)
        return 0

    return run


def strip(path: Path, *names: str):
    """Return a JSON file's content without the entries of some names, anywhere in it."""
    def walk(value):
        if isinstance(value, dict):
            return {key: walk(part) for key, part in value.items() if key not in names}
        return [walk(part) for part in value] if isinstance(value, list) else value

    return walk(json.loads(path.read_text()))
