"""Environments of task files: the run's own ticks, bounds, ends and rewards."""

from __future__ import annotations

import importlib
import re
import shutil
import subprocess
import sys
import warnings
from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from taskspec import load, missing
from taskspec.text.diagnostic import SpecError
from taskspec_runner import gym, run
from taskspec_runner.errors import InputError
from taskspec_runner.gym.env import TaskEnv
from taskspec_runner.record.history import History

TASKS = Path(__file__).resolve().parents[2] / "tasks"
PRESS = """
taskspec: 1
name: press
robot:
  model: panda
  tool: {shape: sphere, radius: 10 mm, length: 100 mm, mass: 300 g}
  start: {xyz: [500 mm, 0, 302 mm]}
  sensor: {noise: {force: 0.1 N}}
world:
  table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 20 kN/m, damping: 30 N*s/m, friction: 0.2}
params: {press: {value: 12 N, live: 5..20 N, rate: 20 N/s}}
frames: {task: {surface: table}}
frame: task
limits: {force: 60 N, speed: 250 mm/s}
stages:
  approach:
    axes: {z: {velocity: -20 mm/s}}
    until: force.z < -2 N for 5 ms
    within: {time: 2 s, travel: 40 mm}
  slide:
    axes:
      x: {position: 5 mm * sin(2*pi*t/(1 s))}
      z: {force: -press}
    time: 400 ms
expect:
  bound: max(norm(force)) < 30 N
  pressed: last(slide.force.z) within -press +- 4 N
vary: {world.table.stiffness: 5..20 kN/m, world.table.xyz: [0, 0, +- 0.5 mm]}
reward: {rate: {slide: 1 - abs(force.z + press)/(5 N)}, passed: 10, missed: -3, stopped: -7}
"""
ACT = {"press": True, "z": ["force +- 3 N", "velocity +- 5 mm/s"], "x": "position +- 1 mm"}


@pytest.fixture(scope="module")
def press(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("gym") / "press.yaml"
    path.write_text(PRESS)
    return path


@pytest.fixture(scope="module")
def env(press: Path) -> TaskEnv:
    """One that all may use who reset it: residuals, live params and random worlds."""
    return gym.make(press, ACT, worlds=True)


def to_the_end(env: TaskEnv, *action: float) -> tuple[float, bool, bool, dict[str, Any]]:
    """The reward of an episode that begins now under one action, and how it ends."""
    total, given = 0.0, np.array(action or np.zeros(env.action_space.shape), np.float32)
    while True:
        _, reward, terminated, truncated, info = env.step(given)
        total += reward
        if terminated or truncated:
            return total, terminated, truncated, info


def history(env: TaskEnv) -> History:
    assert env.episode is not None
    return env.episode.trial().history


def the_same(one: History, run_of_file: History) -> None:
    """All columns of the file's log bit for bit; residuals are beside them."""
    assert len(run_of_file.columns) > 50
    for name, values in run_of_file.columns.items():
        assert one.columns[name].tobytes() == np.ascontiguousarray(values).tobytes(), name
    assert one.stages.tolist() == run_of_file.stages.tolist()
    beside = [name for name in one.columns if name not in run_of_file.columns]
    assert all(name.startswith("param.residual_") for name in beside)


def test_it_is_an_environment(press: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gym.make(press, ACT, worlds=True), skip_render_check=True)
        named = gymnasium.make(f"taskspec_runner.gym:{gym.ID}", task=press, worlds=True)
        check_env(named.unwrapped, skip_render_check=True)
    assert named.action_space.shape == (1,)


@pytest.mark.parametrize(
    ("task", "act"),
    [
        ("press-admittance", {"z": "force +- 5 N at 20 N/s"}),
        ("peg-in-hole", {"z": "force +- 1 N"}),
        ("press-qp", {"z": ["force +- 5 N", "velocity +- 5 mm/s"]}),
        ("wrist-sensor", {"z": ["force +- 5 N", "velocity +- 5 mm/s at 20 mm/s^2"]}),
    ],
)
def test_a_zero_action_is_the_run_of_the_file(
    task: str, act: Mapping[str, Any], tmp_path: Path
) -> None:
    path = TASKS / f"{task}.yaml"
    env = gym.make(path, act, decide=False)
    env.reset(seed=4)
    to_the_end(env, *np.full(env.action_space.shape, 0.3))
    # Nothing is left of an episode in the one that follows it.
    env.reset(seed=5)
    to_the_end(env)
    the_same(history(env), run(load(path), tmp_path / "run", seed=5, report=False).history)


def test_so_is_each_random_world(press: Path, env: TaskEnv, tmp_path: Path) -> None:
    _, first = env.reset(seed=7)
    _, info = env.reset()
    assert (first["seed"], first["world"]) == (7, 0)
    assert (info["seed"], info["world"]) == (7, 1)
    to_the_end(env)
    file = run(load(press), tmp_path / "run", seed=7, world=1, report=False)
    the_same(history(env), file.history)
    _, again = env.reset(seed=7, options={"world": 1})
    assert again["world"] == 1
    to_the_end(env)
    the_same(history(env), file.history)


def rolled(press: Path, workers: Any, threads: int | None = None) -> str:
    """The digest of all that two environments show under random actions, resets among them."""
    both = gym.make_vec(press, 2, workers=workers, threads=threads, act=ACT, worlds=True)
    observation, _ = both.reset(seed=11)
    digest, random = sha256(observation.tobytes()), np.random.default_rng(0)
    ends = 0
    for _ in range(60):
        action = random.uniform(-1, 1, both.action_space.shape).astype(np.float32)
        *arrays, _ = both.step(action)
        digest.update(b"".join(each.tobytes() for each in arrays))
        ends += int(arrays[2].sum())
    both.close()
    assert ends >= 2
    return digest.hexdigest()


def test_episodes_do_not_depend_on_who_runs_them(press: Path) -> None:
    alone = rolled(press, "threads", 1)
    assert alone == rolled(press, "threads", 8)
    assert alone == rolled(press, "processes")


def test_actions_are_bounded_in_value_and_rate(env: TaskEnv) -> None:
    env.reset(seed=1)
    to_the_end(env, -9.0, 9.0, 0.5, -9.0)
    columns, period = history(env).columns, 1e-3
    assert columns["param.press"].min() == 5.0
    assert columns["param.residual_force_z"].max() == 3.0
    assert columns["param.residual_velocity_z"].max() == pytest.approx(2.5e-3)
    assert columns["param.residual_position_x"].min() == -1e-3
    steps = np.diff(columns["param.press"])
    # A sum of rounded ticks may be an ulp of 20 N beyond the rate.
    assert np.abs(steps).max() <= 20.0 * period + 4e-15
    assert np.abs(steps).max() == pytest.approx(20.0 * period)


def test_a_residual_moves_what_it_is_added_to(press: Path) -> None:
    env = gym.make(press, {"z": "force +- 3 N"}, decide=False)
    env.reset(seed=1)
    to_the_end(env, 1.0)
    pressed = history(env)
    slide = pressed.window("slide")
    # -12 N and 3 N, within the noise of 0.1 N that the loop follows.
    assert np.mean(pressed.columns["force.z"][slide][-100:]) == pytest.approx(-9.0, abs=0.5)


def test_where_a_residual_has_no_effect_is_said(env: TaskEnv) -> None:
    _, info = env.reset(seed=1)
    assert info["without_effect"] == ("press", "z.force", "x.position")
    *_, info = to_the_end(env)
    assert info["stage"] == "slide"
    assert info["without_effect"] == ("z.velocity",)


def test_an_expectation_that_is_missed_ends_an_episode(press: Path) -> None:
    given = {"expect.bound": "max(norm(force)) < 5 N"}
    env = gym.make(press, set=given)
    env.reset(seed=1)
    reward, terminated, _, info = to_the_end(env)
    assert terminated
    assert info["decided"] == {"bound: max(norm(force)) < 5 N": False}
    assert info["verdict"] == "missed"
    assert info["expect"]["pressed: last(slide.force.z) within -press +- 4 N"] is None
    force = np.linalg.norm([history(env).columns[f"force.{a}"] for a in "xyz"], axis=0)
    # It ends with the step in which that was.
    assert (force[:-20] < 5.0).all()
    assert (force[-20:] >= 5.0).any()
    assert reward < 0
    whole = gym.make(press, set=given, decide=False)
    whole.reset(seed=1)
    *_, info = to_the_end(whole)
    assert (info["reason"], info["verdict"]) == ("end", "missed")


def test_a_limit_ends_an_episode(press: Path) -> None:
    env = gym.make(press, set={"limits.force": "6 N"})
    env.reset(seed=1)
    _, terminated, truncated, info = to_the_end(env)
    assert (terminated, truncated) == (True, False)
    assert (info["verdict"], info["reason"]) == ("stopped", "force")
    with pytest.raises(InputError, match="reset"):
        env.step(np.zeros(1, np.float32))


def test_time_truncates_an_episode(press: Path) -> None:
    env = gym.make(press, max_time=0.25, observe=["clock"])
    env.reset(seed=1)
    reward, terminated, truncated, info = to_the_end(env)
    assert (terminated, truncated) == (False, True)
    assert (info["verdict"], info["clock"]) == ("open", 0.25)
    assert env.observation_space.high.tolist() == [0.25]
    # No term of the end: what it earned so far is bounded by the rate of 1 per second.
    assert abs(reward) < 0.25


def test_the_reward_is_the_files(env: TaskEnv) -> None:
    env.reset(seed=3)
    reward, *_, info = to_the_end(env)
    columns = history(env).columns
    slide = history(env).window("slide")
    expected = np.where(slide, 1 - np.abs(columns["force.z"] + columns["param.press"]) / 5, 0)
    assert columns["reward"] == pytest.approx(expected, abs=1e-12)
    assert info["verdict"] == "passed"
    assert reward == pytest.approx(columns["reward"].sum() * 1e-3 + 10)


def test_the_reward_is_a_function_or_of_margins(press: Path) -> None:
    env = gym.make(press, reward=lambda observed, _: observed["force.z"])
    env.reset(seed=3)
    observation, reward, *_ = env.step(np.zeros(1, np.float32))
    assert reward == observation[env.setup.observations.names.index("force.z")]
    plain = press.parent / "plain.yaml"
    plain.write_text("\n".join(line for line in PRESS.splitlines() if "reward" not in line))
    env = gym.make(plain)
    env.reset(seed=3)
    reward, *_, info = to_the_end(env)
    assert reward == min(info["margins"].values())
    assert 0 < reward < 1
    env = gym.make(plain, set={"limits.force": "6 N"})
    env.reset(seed=3)
    assert to_the_end(env)[0] == -1.0


def test_observations_are_what_the_controller_measures(press: Path) -> None:
    wanted = {"force.z": 20, "force.z.true": 1, "table.force.true": 1, "touching": 1, "t": 1}
    env = gym.make(press, observe=wanted | {"joint.position": 1, "position.z.ref": 1, "stage": 1})
    names = env.setup.observations.names
    assert names[0] == "force.z[-19]"
    assert names[19:24] == ("force.z[0]", "force.z.true", "table.force.true", "touching", "t")
    assert names[-2:] == ("stage.approach", "stage.slide")
    assert len(names) == 24 + 7 + 1 + 2
    env.reset(seed=3)
    for _ in range(12):
        observation, *_ = env.step(np.zeros(1, np.float32))
    columns = history(env).columns
    measured = columns["force.z.measured"][-20:].astype(np.float32)
    assert observation[:20].tobytes() == measured.tobytes()
    last = {name: float(np.float32(values[-1])) for name, values in columns.items()}
    shown = dict(zip(names, observation.tolist(), strict=True))
    assert shown["force.z.true"] == last["force.z"] != last["force.z.measured"]
    assert shown["table.force.true"] == last["table.force"]
    assert shown["t"] == last["t"]
    assert shown["joint.4.position"] == last["joint.4.position"]
    assert (shown["touching"], shown["stage.slide"]) == (1.0, 1.0)
    assert env.observation_space.low[0] == -60.0


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"act": ["pres"]}, "no param 'pres'; did you mean 'press'?"),
        ({"act": {"z": "force 5 N"}}, "no residual of 'z'"),
        ({"act": {"y": "force +- 5 N"}}, "no stage has a force on y"),
        ({"act": {"z": {"force": "5 N"}}}, "no residual of 'z'"),
        ({"act": ["z"]}, "what is added to the axis 'z'?"),
        ({"act": {"w": "force +- 5 N"}}, "'w' is no axis"),
        ({"act": {"z": ["force +- 5 N", "force +- 2 N"]}}, "z.force stands there twice"),
        ({"act": []}, "act names nothing"),
        ({"observe": ["forse"]}, "did you mean 'force'?"),
        ({"observe": ["force.w"]}, "'force' has no 'w'"),
        ({"observe": ["slide.force.z"]}, "write 'force.z'"),
        ({"observe": "force"}, "observe=['force']"),
        ({"max_time": 0}, "no step"),
        ({"observe": ["table.force"]}, "'table.force.true'"),
        ({"observe": ["param.pres"]}, "no live param 'pres'"),
        ({"observe": {"force": 0}}, "one tick or more"),
        ({"observe": []}, "needs a signal"),
        ({"rate": 300}, "no whole share"),
        ({"rate": 60}, "such as 62.5"),
        ({"rate": 2000}, "such as 1000"),
        ({"rate": "50"}, "rate is a number"),
        ({"max_time": 1e-4}, "no step"),
        ({"max_time": "3"}, "max_time is a number"),
        ({"act": "press"}, "a list or a mapping"),
        ({"act": 5}, "a list or a mapping"),
        ({"act": [5]}, "5 is no name"),
        ({"act": {1: "force +- 5 N"}}, "1 is no name"),
        ({"act": {"z": 5}}, "5 is no residual of 'z'"),
        ({"act": {"z": None}}, "None is no residual of 'z'"),
        ({"act": {"z": []}}, "nothing is added to 'z'"),
        ({"act": {"press": "+- 5 N"}}, "'press' is a live param"),
        ({"act": {}}, "leave it out for all live params: press"),
        ({"observe": 5}, "a list or a mapping"),
        ({"observe": [5]}, "5 is no name of a signal"),
        ({"observe": ["press"]}, "'press' is a live param: write 'param.press'"),
        ({"observe": ["q"]}, "unknown signal 'q'; signals: "),
        ({"size": (0, 0)}, "width and height"),
        ({"size": "640x480"}, "width and height"),
        ({"loop": "pyton"}, "not 'pyton'"),
        ({"reward": 3}, "reward is a function"),
        ({"render_mode": "human"}, "rgb_array"),
        ({"set": {"vary": "{}"}, "worlds": True}, "nothing varies"),
    ],
)
def test_arguments_that_do_not_fit_are_refused(
    press: Path, given: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError) as found:
        gym.make(press, **given)
    assert message in str(found.value)


@pytest.mark.parametrize("action", ["a", None, {}, [1j], 0.0, [0.0, 0.0]])
def test_actions_that_are_no_numbers_are_refused(press: Path, action: Any) -> None:
    env = gym.make(press)
    env.reset(seed=0)
    with pytest.raises(InputError, match="an action has 1 numbers: press"):
        env.step(action)


@pytest.mark.parametrize("world", [-1, "3", 2.7])
def test_a_world_is_a_whole_number(press: Path, world: Any) -> None:
    env = gym.make(press, worlds=True)
    with pytest.raises(InputError, match="a whole number from 0 on"):
        env.reset(seed=0, options={"world": world})


def test_a_reward_that_is_no_number_is_refused(press: Path) -> None:
    def forgotten(*_given: Any) -> Any:
        return None

    env = gym.make(press, reward=forgotten)
    env.reset(seed=0)
    with pytest.raises(InputError, match="the function returned None"):
        env.step(np.zeros(1))


def test_without_a_time_the_task_ends_an_episode(press: Path) -> None:
    assert gym.make(press, max_time=float("inf")).setup.most == float("inf")


def test_slow_steps_have_a_frame_rate_that_films_can_have(press: Path) -> None:
    assert gym.make(press, rate=0.1).metadata["render_fps"] == 1


def test_a_param_may_have_the_name_of_a_stage(tmp_path: Path) -> None:
    """An expectation of every tick compares with the param, which is no signal of the stage."""
    path = tmp_path / "press.yaml"
    every = "  held: slide.force.z within -press +- 11 N\nvary:"
    text = PRESS.replace(
        "  slide:\n", "  press: {axes: {z: {force: -press}}, time: 50 ms}\n  slide:\n"
    )
    path.write_text(text.replace("vary:", every), encoding="utf-8")
    env = gym.make(path)
    env.reset(seed=0)
    over = False
    while not over:
        _, _, over, _, info = env.step(np.zeros(1))
    assert info["expect"]["held: slide.force.z within -press +- 11 N"] is True


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"num_envs": 0}, "one environment or more"),
        ({"num_envs": 2.5}, "one environment or more"),
        ({"num_envs": 2, "workers": "procs"}, "'threads' or 'processes', not 'procs'"),
        ({"num_envs": 2, "threads": 0}, "one or more, not 0"),
    ],
)
def test_numbers_of_environments_that_do_not_fit_are_refused(
    press: Path, given: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        gym.make_vec(press, **given)


def test_an_interval_of_another_dimension_is_refused(press: Path) -> None:
    with pytest.raises(SpecError) as found:
        gym.make(press, {"z": "force +- 5 mm"})
    assert "TS11" in str(found.value)


def test_an_action_that_does_not_fit_is_refused(env: TaskEnv) -> None:
    env.reset(seed=1)
    with pytest.raises(InputError, match=r"4 numbers: press, z\.force, z\.velocity, x\.position"):
        env.step(np.zeros(2, np.float32))
    with pytest.raises(InputError, match="number that is none"):
        env.step(np.full(4, np.nan, np.float32))


def test_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    page = TASKS.parent / "docs" / "how-to" / "learning.md"
    shutil.copy(page.parent / "learning.yaml", "quick-touch.yaml")
    names: dict[str, Any] = {}
    blocks = re.findall(r"^```python\n(.*?)^```$", page.read_text(), re.M | re.S)
    assert len(blocks) == 3
    for block in blocks:
        if "render" not in block:
            exec(compile(block, page.name, "exec"), names)
    assert len(names["rewards"]) == 8


def test_without_gymnasium_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(missing, "find_spec", lambda _: None)
    monkeypatch.delitem(sys.modules, "taskspec_runner.gym")
    with pytest.raises(missing.MissingLibraryError, match=r"taskspec-robotics\[gym\]"):
        importlib.import_module("taskspec_runner.gym")


def test_other_commands_do_not_import_it() -> None:
    code = "import sys, taskspec_runner.session; sys.exit('gymnasium' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_pictures(press: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from taskspec_runner.video.canvas import NoCanvasError

    monkeypatch.delenv("MUJOCO_GL", raising=False)
    env = gym.make(press, render_mode="rgb_array", size=(120, 90))
    with pytest.raises(InputError, match="reset"):
        env.render()
    env.reset(seed=1)
    try:
        first = env.render()
    except NoCanvasError as error:
        pytest.skip(str(error))
    assert first is not None
    assert (first.shape, first.dtype) == ((90, 120, 3), np.uint8)
    to_the_end(env)
    assert (env.render() != first).any()
    env.close()
