"""The energy tank of a stage's law over a visit: what was in it, what left it, what it refused."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.spec.tank import Tank
from taskspec.text.units import joules, show
from taskspec_runner.record.history import History, NotRecordedError, Visit

Vector = NDArray[np.float64]

#: A share below it is no refusal.
_REFUSED = 1e-6


@dataclass(frozen=True)
class TankCourse:
    """A tank over a visit.

    Attributes:
        tank: as the file has it.
        clock: (n,) [s].
        energy: (n,) what is in it [J].
        power: (n,) what has left it over the period up to a tick [W].
        refused: (n,) share of what the law commands.
    """

    tank: Tank
    clock: Vector
    energy: Vector
    power: Vector
    refused: Vector

    @classmethod
    def of(cls, tank: Tank, history: History, visit: Visit) -> TankCourse:
        """That of a visit.

        Raises:
            NotRecordedError: the log does not have it.
        """
        names = ("clock", "tank.energy", "tank.power", "tank.refused")
        for name in names:
            if name not in history.columns:
                raise NotRecordedError(name)
        return cls(tank, *(history.columns[name][visit.rows] for name in names))

    def as_data(self) -> dict[str, Any]:
        """The entry of a summary."""
        refuses = self.refused > _REFUSED
        data: dict[str, Any] = {
            "first": float(self.energy[0]),
            "least": float(np.min(self.energy)),
            "last": float(self.energy[-1]),
            "power": float(np.max(self.power)),
            "refused": float(np.max(self.refused)),
        }
        if refuses.any():
            began = float(self.clock[int(np.argmax(refuses))])
            data |= {"from": began, "time": float(np.sum(refuses) * self._period)}
        return data

    @property
    def _period(self) -> float:
        return float(self.clock[1] - self.clock[0])


def sentences(summary: Mapping[str, Any]) -> Iterator[str]:
    """What tanks refused, by the entry `energy` of a summary."""
    for each in summary.get("energy", ()):
        tank = each.get("tank", {})
        if "time" in tank:
            yield refusal(each["stage"], tank)


def refusal(stage: str, tank: Mapping[str, Any]) -> str:
    """What a tank refused, of its entry in a summary."""
    share = 100 * tank["refused"]
    return (
        f"the tank of stage {stage} refused up to {share:.3g} % of what its law commands, for "
        f"{show(tank['time'], 's', 3)} from {tank['from']:.3f} s on; it came down to "
        f"{joules(tank['least'])}"
    )
