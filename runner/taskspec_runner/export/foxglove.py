"""A layout of Foxglove for an exported run: the scene, forces beside their references, stages."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from taskspec_runner.export.scene import TASK_FRAME, WORLD, RunScene

#: Panels, named as Foxglove does it: kind and identity.
_SCENE, _FORCES, _TORQUES, _ERRORS, _STAGES = (
    "3D!scene", "Plot!forces", "Plot!torques", "Plot!errors", "StateTransitions!stages",
)  # fmt: skip
_AXES = "xyz"


def foxglove_layout(
    signals: str, columns: Mapping[str, str], stages: str, topics: Sequence[str], scene: RunScene
) -> dict[str, Any]:
    """The layout, as Foxglove imports it from a file.

    Args:
        signals: topic of all columns.
        columns: of the log by the paths of their fields there.
        stages: topic of the stages.
        topics: that the scene is made of.
        scene: of the run.
    """
    paths = {column: f"{signals}.{field}" for field, column in columns.items()}
    plots = {
        _FORCES: _plot("Force [N]", paths, [f"force.{a}{s}" for a in _AXES for s in ("", ".ref")]),
        _TORQUES: _plot(
            "Torque [N m]", paths, [f"torque.r{a}{s}" for a in _AXES for s in ("", ".ref")]
        ),
        _ERRORS: _plot("Position error [m]", paths, [f"error.{a}" for a in _AXES]),
    }
    plots = {name: plot for name, plot in plots.items() if plot["paths"]}
    panels: dict[str, Any] = {_SCENE: _scene_panel(topics, scene)}
    panels |= plots
    panels[_STAGES] = {
        "isSynced": True,
        "paths": [{"value": f"{stages}.data", "label": "stage", "timestampMethod": "receiveTime"}],
    }
    beside = _column([*plots, _STAGES])
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {
            "direction": "row",
            "first": _SCENE,
            "second": beside,
            "splitPercentage": 60,
        },
    }


def _scene_panel(topics: Sequence[str], scene: RunScene) -> dict[str, Any]:
    """The 3D panel: all of the arm in sight, from the side of its base's left front."""
    ends = [track.starts[track.shown] for track in scene.arrows.values()]
    tips = [scene.placed(link.name)[:, :3] for link in scene.links]
    points = np.vstack([*tips, *ends])
    low, high = points.min(axis=0), points.max(axis=0)
    quiet = {f"frame:{link.name}": {"visible": False} for link in scene.links}
    return {
        "cameraState": {
            "perspective": True,
            "distance": 1.5 * float(np.linalg.norm(high - low)) + 0.5,
            "phi": 65,
            "thetaOffset": 55,
            "target": [0, 0, 0],
            "targetOffset": ((low + high) / 2).tolist(),
            "targetOrientation": [0, 0, 0, 1],
            "fovy": 45,
            "near": 0.01,
            "far": 100,
        },
        "followMode": "follow-none",
        "followTf": WORLD,
        "scene": {"transforms": {"axisScale": 0.12, "labelSize": 0.04, "lineWidth": 0}},
        "transforms": quiet | {f"frame:{TASK_FRAME}": {"visible": False}},
        "topics": {topic: {"visible": True} for topic in topics},
        "layers": {
            "floor": {
                "layerId": "foxglove.Grid", "instanceId": "floor", "label": "Floor", "order": 1,
                "visible": True, "frameLocked": True, "frameId": WORLD,
                "size": 2, "divisions": 10, "lineWidth": 1, "color": "#8c96a8ff",
                "position": [0, 0, 0], "rotation": [0, 0, 0],
            }
        },
        "publish": {},
        "imageMode": {},
    }  # fmt: skip


def _plot(title: str, paths: Mapping[str, str], columns: Iterable[str]) -> dict[str, Any]:
    found = [column for column in columns if column in paths]
    return {
        "title": title,
        "paths": [
            {
                "value": paths[column],
                "label": column,
                "enabled": True,
                "timestampMethod": "receiveTime",
            }
            for column in found
        ],
        "xAxisVal": "timestamp",
        "isSynced": True,
        "showLegend": True,
        "legendDisplay": "floating",
        "showXAxisLabels": True,
        "showYAxisLabels": True,
    }


def _column(panels: Sequence[str]) -> Any:
    """Panels below each other, of equal height."""
    first, *rest = panels
    if not rest:
        return first
    share = 100 / len(panels)
    return {
        "direction": "column", "first": first, "second": _column(rest), "splitPercentage": share,
    }  # fmt: skip
