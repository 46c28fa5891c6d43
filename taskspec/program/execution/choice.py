"""Which generalised coordinates the constraints of a stage decide, (4.80), chosen as it runs.

Around a full circle no fixed choice survives: every coordinate's share of the gradient changes its
sign once. So the choice is made again before it degrades. The acceleration that the old choice
asked for is held, and fades, so that the torque does not jump.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from taskspec.program.stages.stage import CompiledStage

Vector = NDArray[np.float64]

#: More exchanges than this are rounding.
_EXCHANGES = 50


def choose_first(
    stage: CompiledStage, inputs: Sequence[Vector], memory: Vector, parameters: Vector
) -> None:
    """Chooses at entry; writes the selection into the parameters.

    Args:
        stage: the stage.
        inputs: of its tick before memory and parameters.
        memory, parameters: of the stage at t = 0.
    """
    if stage.choice is None:
        return
    gradient, _, _ = _look(stage, inputs, memory, parameters)
    _write(stage, parameters, choose(gradient, stage.choice.weights))


def choose_again(
    stage: CompiledStage, inputs: Sequence[Vector], memory: Vector, parameters: Vector, t: float
) -> None:
    """Chooses at stage time t [s] and holds what the last choice asked for at these inputs."""
    assert stage.choice is not None
    gradient, wanted, kept = _look(stage, inputs, memory, parameters)
    _write(stage, parameters, choose(gradient, stage.choice.weights))
    # Of an acceleration that keeps the constraints, elimination changes nothing.
    stage.parameters.write(parameters, "held", kept - wanted)
    stage.parameters.write(parameters, "chosen_at", t)


def _look(
    stage: CompiledStage, inputs: Sequence[Vector], memory: Vector, parameters: Vector
) -> tuple[Vector, Vector, Vector]:
    """J_phi on the candidates (m, c), wanted q'' (n,), and q'' that keeps the constraints (n,)."""
    assert stage.choice is not None
    memory, parameters = memory[: stage.memory.size], parameters[: stage.parameters.size]
    gradient, wanted, kept = stage.choice.look(*inputs, memory, parameters)
    return np.array(gradient), np.array(wanted).ravel(), np.array(kept).ravel()


def _write(stage: CompiledStage, parameters: Vector, selection: Vector) -> None:
    stage.parameters.write(parameters, "selection", selection.ravel(order="F"))


def choose(gradient: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """(c, m) selection of m coordinates whose minor of the weighted gradient (m, c) is large.

    Pivoting gives a first choice; then coordinates are exchanged as long as that makes it larger.
    """
    scaled = gradient * weights
    m, c = scaled.shape
    rest, chosen = scaled.copy(), []
    for _ in range(m):
        pivot = int(np.argmax(np.linalg.norm(rest, axis=0)))
        chosen.append(pivot)
        direction = rest[:, pivot] / max(float(np.linalg.norm(rest[:, pivot])), 1e-300)
        rest = rest - np.outer(direction, direction @ rest)
        rest[:, pivot] = 0.0
    for _ in range(_EXCHANGES):
        gains = np.abs(np.linalg.lstsq(scaled[:, chosen], scaled)[0])
        i, j = np.unravel_index(int(np.argmax(gains)), gains.shape)
        if gains[i, j] < 1 + 1e-6:
            break
        chosen[int(i)] = int(j)
    selection = np.zeros((c, m))
    selection[chosen, range(m)] = 1.0
    return selection
