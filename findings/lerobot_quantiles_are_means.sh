#!/usr/bin/env bash
# lerobot 0.6.1: the 99 % quantile of a dataset's force is 27.5 N, where half of its frames have 50 N.
#
# Two episodes of 300 frames each: one presses with 5 N, one with 50 N, both +- 0.1 N.
# LeRobotDataset.save_episode merges the statistics of each episode into meta/stats.json
# by aggregate_stats. Mean and standard deviation are merged by the parallel algorithm, exactly,
# least and greatest values too; so one expects q01 and q99 to be quantiles as well, or not to be there.
# They are the means of the episodes' quantiles, weighted by frames: q01 = q50 = q99 = 27.5 N,
# a force that no frame has.
# Policies that scale by quantiles (NormalizationMode.QUANTILES maps q01..q99 to -1..1) divide by
# q99 - q01 of 0.2 instead of 45 N: the pressing forces come to them as -225 and +225.
# compute_stats.py is run as it is; three modules that it imports for other functions need torch,
# gigabytes, and are left empty here.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
# Of the package one file is run, which needs no Python 3.12.
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile numpy==2.2.6
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile --no-deps --ignore-requires-python \
  lerobot==0.6.1

"$work/venv/bin/python" - <<'PY'
import importlib.metadata as metadata
import sys
from importlib.util import module_from_spec, spec_from_file_location
from types import ModuleType

import numpy as np

empty = {
    "lerobot": {},
    "lerobot.utils": {},
    "lerobot.datasets": {},
    "lerobot.processor": {"RelativeActionsProcessorStep": None},
    "lerobot.utils.constants": {"ACTION": "action", "OBS_STATE": "observation.state"},
    "lerobot.datasets.io_utils": {"load_image_as_numpy": None},
}
for name, content in empty.items():
    module = ModuleType(name)
    module.__path__ = []
    module.__dict__.update(content)
    sys.modules[name] = module
[path] = [f.locate() for f in metadata.files("lerobot") if str(f).endswith("datasets/compute_stats.py")]
spec = spec_from_file_location("lerobot.datasets.compute_stats", path)
compute_stats = module_from_spec(spec)
spec.loader.exec_module(compute_stats)

features = {"force": {"dtype": "float32", "shape": (1,)}}
noise = np.random.default_rng(0)
episodes = [(f + noise.uniform(-0.1, 0.1, (300, 1))).astype(np.float32) for f in (5.0, 50.0)]
stats = [compute_stats.compute_episode_stats({"force": each}, features) for each in episodes]
merged = compute_stats.aggregate_stats(stats)["force"]
every = np.concatenate(episodes)
true = {name: float(np.quantile(every, q)) for name, q in (("q01", 0.01), ("q99", 0.99))}
found = {name: float(merged[name][0]) for name in ("q01", "q50", "q99")}
scaled = 2 * (every - found["q01"]) / (found["q99"] - found["q01"]) - 1

print("lerobot", metadata.version("lerobot"))
print(f"expected: q01 {true['q01']:.1f} N, q99 {true['q99']:.1f} N; or none")
print("observed:", {name: round(value, 2) for name, value in found.items()})
print(f"mean {merged['mean'][0]:.2f}, std {merged['std'][0]:.2f}, as of all frames: exact")
print(f"scaled to -1..1 by them: from {scaled.min():.0f} to {scaled.max():.0f}")
assert abs(merged["std"][0] - every.std()) < 1e-3
assert all(27.3 < value < 27.7 for value in found.values())
assert scaled.min() < -100 and scaled.max() > 100
PY
