"""Random presses and wipes whose worlds vary: how many of them `taskspec tune` makes succeed.

A task is its number: arm, what it takes, law, contact, sensor, intervals and what is expected are
drawn. Half of them have designed gains, the others those of another cell: designed ones times
random factors. Each is tuned, and then run in fresh worlds of a seed that neither the search nor
its own verification used:

    python campaigns/tuned_worlds.py --tasks 14 --fresh 50 --page docs/how-to/tune.md

Numbers below `JUDGING` are to try the search with; those from there on judge it.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from boundaries import keep
from draws import Draws

from taskspec.compiler import compile_unchecked
from taskspec.program.program import Program
from taskspec.program.worlds import random_world
from taskspec.spec import load_text
from taskspec_runner.sweep.world_run import run_world
from taskspec_runner.tune.gains import knobs_of, overrides
from taskspec_runner.tune.tuned import Tuned, Wanted, tune

JUDGING = 100
#: Of the fresh worlds that judge; a search has 0, and its verifications follow that.
SEED = 9_000
_LAWS = {"torque": ("hybrid", "parallel"), "velocity": ("admittance", "force-velocity"),
         "position": ("admittance",)}  # fmt: skip


def task_text(number: int) -> str:
    """The task of a number, with designed gains."""
    draw = Draws(47, number)
    command = draw.one_of(("torque", "velocity", "position"), (2, 1, 1))
    law = draw.one_of(_LAWS[command])
    stiffness, force = draw.spread(5, 60), draw.between(8, 25)
    softer, harder = draw.spread(1.5, 4), draw.spread(1.5, 4)
    wipes, height = draw.chance(0.5), draw.between(0.5, 2)
    delay, friction = draw.between(2, 8), draw.between(0.05, 0.25)
    servo = (
        f"\n  servo: {{bandwidth: {draw.spread(8, 30):.3g} Hz, delay: {draw.between(2, 8):.1f} ms}}"
    )
    across = "x: {position: 15 mm * sin(2*pi*t/(1.5 s))}, " if wipes else ""
    late, share = draw.between(4, 8), draw.between(60, 80)
    error = f"\n  - max(abs(work.error.x)) < {draw.between(1.5, 4):.2g} mm" if wipes else ""
    nominal = f"{stiffness:.3g} kN/m, friction: {friction:.2f}"
    return f"""\
taskspec: 1
name: tuned-{number}
robot:
  model: ur5e
  command: {command}{"" if command == "torque" else servo}
  tool: {{shape: sphere, radius: 10 mm, length: 100 mm, mass: 300 g}}
  start: {{xyz: [480 mm, 60 mm, 306 mm]}}
  sensor: {{at: wrist, delay: {delay:.1f} ms, filter: 80 Hz}}
world:
  table: {{shape: plane, xyz: [0, 0, 300 mm], stiffness: {nominal}}}
frames: {{task: {{surface: table}}}}
frame: task
law: {law}
limits: {{force: {4 * force:.3g} N, speed: 250 mm/s}}
stages:
  approach:
    axes: {{z: {{velocity: -15 mm/s}}}}
    until: force.z < -2 N for 8 ms
    within: {{time: 2 s, travel: 20 mm}}
  work:
    axes: {{{across}z: {{force: -{force:.3g} N}}}}
    time: 2 s
expect:
  - work.force.z within -{force:.3g} N +- {late:.2g} % for {share:.0f} %
  - max(norm(force)) < {draw.between(1.2, 1.5) * force:.3g} N{error}
vary:
  world.table.stiffness: {stiffness / softer:.3g}..{stiffness * harder:.3g} kN/m
  world.table.xyz: [0, 0, +- {height:.2g} mm]
  world.table.friction: 0..{2 * friction:.2f}
"""


def given(number: int) -> Program:
    """The task as its cell has it: of every second one the gains are off by random factors."""
    text = task_text(number)
    program = compile_unchecked(load_text(text, f"tuned-{number}.yaml"))
    if number % 2 == 0:
        return program
    draw = Draws(48, number)
    knobs = knobs_of(program)
    setting = tuple(knob.times(None, draw.spread(0.3, 3)) for knob in knobs)
    return compile_unchecked(
        load_text(text, f"tuned-{number}.yaml", overrides(program, knobs, setting))
    )


def row_of(number: int, fresh: int, budget: int) -> dict[str, Any]:
    """What tuning made of a task, judged in fresh worlds."""
    program = given(number)
    found = tune(program, Wanted(fresh=20, most=budget))
    loaded = program.context.loaded
    changed = {**loaded.overrides, **found.overrides}
    after = compile_unchecked(load_text(loaded.source.text, loaded.source.name, changed))
    task = loaded.task
    return {
        "number": number,
        "takes": task.robot.command,
        "law": task.law.kind,
        "gains": "designed" if number % 2 == 0 else "of another cell",
        "found": found.after.good,
        "before": _good(program, fresh),
        "after": _good(after, fresh),
        "fresh": fresh,
        "worst": min((a for _, _, a in found.margins() if a is not None), default=None),
        "moved": len(found.moved),
        "tried": found.tried,
        "in_the_way": [*_in_the_way(found)],
    }


def _in_the_way(found: Tuned) -> Iterator[str]:
    for each in found.obstacles:
        if each.works is not None:
            yield f"{each.interval.name} works {each.interval.text(each.works)}"


def _good(program: Program, count: int) -> int:
    context = program.context
    rows = (run_world(program, i, random_world(context, SEED, i)) for i in range(count))
    return sum(bool(row["success"]) for row in rows)


def lines(rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """The table of a page."""
    yield "| task | takes | law | gains before | fresh worlds before | after | tried | else |"
    yield "| --- | --- | --- | --- | --- | --- | --- | --- |"
    for row in rows:
        left = "" if row["found"] else "none found; " + "; ".join(row["in_the_way"])
        yield (
            f"| {row['number']} | {row['takes']} | `{row['law']}` | {row['gains']} "
            f"| {row['before']} of {row['fresh']} | {row['after']} of {row['fresh']} "
            f"| {row['tried']} | {left.strip('; ')} |"
        )
    failing = [row for row in rows if row["before"] < row["fresh"]]
    brought = [row for row in failing if row["found"] and row["after"] == row["fresh"]]
    found = [row for row in rows if row["found"]]
    worlds = sum(row["fresh"] for row in found)
    good = sum(row["after"] for row in found)
    yield ""
    yield (
        f"Of {len(rows)} tasks {len(failing)} failed in at least one of their fresh worlds. "
        f"Tuning made {len(brought)} of these succeed in all of them. Where it reported gains "
        f"({len(found)} tasks), {good} of {worlds} fresh worlds succeed."
    )


def main(arguments: Sequence[str]) -> int:
    """Runs the campaign."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else "")
    parser.add_argument("--tasks", type=int, default=14)
    parser.add_argument("--first", type=int, default=JUDGING)
    parser.add_argument("--fresh", type=int, default=50)
    parser.add_argument("--budget", type=int, default=50)
    parser.add_argument("--rows", type=Path, default=Path("runs/tuned-worlds.jsonl"))
    parser.add_argument("--page", type=Path)
    options = parser.parse_args(arguments)
    options.rows.parent.mkdir(parents=True, exist_ok=True)
    known = {}
    if options.rows.exists():
        for line in options.rows.read_text("utf-8").splitlines():
            row = json.loads(line)
            known[row["number"]] = row
    numbers = range(options.first, options.first + options.tasks)
    for number in numbers:
        if number in known:
            continue
        known[number] = row_of(number, options.fresh, options.budget)
        with options.rows.open("a", encoding="utf-8") as file:
            file.write(json.dumps(known[number]) + "\n")
        print(json.dumps(known[number]), file=sys.stderr, flush=True)  # noqa: T201
    table = [*lines([known[number] for number in numbers])]
    print("\n".join(table))  # noqa: T201
    if options.page is not None:
        keep(options.page, "tuned", table)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
