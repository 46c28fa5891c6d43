"""Sliders of live params: what a page shows of them, and what it has them set to."""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping, Sequence
from typing import Any

from markupsafe import Markup

from taskspec.deferred_methods import dataclass
from taskspec.program.execution.live_params import LiveParams
from taskspec.spec.params import LiveParam
from taskspec.text.suggest import suggestion
from taskspec.text.units import number
from taskspec_runner.live.server import RefusedError
from taskspec_runner.loop.live_schedule import LiveMove
from taskspec_runner.loop.tap import ticks_between
from taskspec_runner.pages.document import section
from taskspec_runner.pages.html import element, prose
from taskspec_runner.pages.numbers import plain_scale

#: The name under which a page sets a param.
SET = "set"
#: Requests are taken so often in simulated time [Hz].
_RATE = 50.0
#: A slider has so many steps or more; each is 1, 2 or 5 of a decimal place.
_STEPS = 100
#: Of a step: bounds that are so little off a place are there.
_ROUNDING = 1e-6


class Sliders:
    """Has a page set live params: a `Hand` of the run.

    Requests come from threads of the page's server; they wait for the next tick that takes them.
    """

    def __init__(self, params: Mapping[str, LiveParam], period: float) -> None:
        """Takes the params of a task by name, at least one, and the period of control [s]."""
        self.params, self._period = dict(params), period
        self._every = ticks_between(_RATE, period)
        self._lock = threading.Lock()
        self._wanted: dict[str, float] = {}
        self._targets = {name: param.value for name, param in self.params.items()}
        self._moves: list[LiveMove] = []
        self._over = False

    def request(self, content: Any) -> dict[str, Any]:
        """Takes a request of a page.

        Args:
            content: its JSON: a mapping of `name` and `value` [SI].

        Returns:
            The name, and what the param goes to: the nearest value within its bounds [SI].

        Raises:
            RefusedError: it is none, or the run is over.
        """
        if not isinstance(content, dict) or content.keys() != {"name", "value"}:
            raise RefusedError('a request is {"name": .., "value": ..}')
        name, value = content["name"], content["value"]
        if not isinstance(name, str) or name not in self.params:
            known = suggestion(str(name)[:60], self.params, "live are")
            raise RefusedError(f"the task has no live param of that name; {known}")
        if isinstance(value, bool) or not isinstance(value, int | float):
            value = math.nan
        if not math.isfinite(value):
            raise RefusedError("'value' is a finite number in SI units")
        param = self.params[name]
        wanted = min(max(float(value), param.low), param.high)
        with self._lock:
            if self._over:
                raise RefusedError("the run is over", conflict=True)
            self._wanted[name] = wanted
        return {"name": name, "target": wanted}

    def set(self, live: LiveParams, ticks: int) -> int | None:
        """Sets what pages have requested since the last time; see `Hand`."""
        with self._lock:
            for name, value in self._wanted.items():
                if value != live.target(name):
                    live.set(name, value)
                    dimension = self.params[name].dimension
                    self._moves.append(LiveMove(name, value, ticks * self._period, dimension))
            self._wanted.clear()
            self._targets = {name: float(live.target(name)) for name in self.params}
        return self._every

    def finish(self) -> None:
        """Learns that no more ticks will come: requests are refused from now on."""
        with self._lock:
            self._over = True

    @property
    def lines(self) -> tuple[str, ...]:
        """The moves so far, as `--live` takes them."""
        return tuple(map(str, self._moves))

    @property
    def targets(self) -> dict[str, float]:
        """What each param goes to, by whoever set it last [SI]."""
        with self._lock:
            return {**self._targets, **self._wanted}


@dataclass(frozen=True, slots=True)
class Slider:
    """What a page has of a live param, in the unit that it shows.

    Attributes:
        name: of the param.
        unit: that is shown.
        factor: from SI to that unit.
        low, high: bounds.
        step: between two places of the slider; places are whole numbers of it, and the bounds.
        value: declared.
        rate: how fast it goes, in words; empty where it jumps.
    """

    name: str
    unit: str
    factor: float
    low: float
    high: float
    step: float
    value: float
    rate: str


def sliders_of(params: Mapping[str, LiveParam]) -> tuple[Slider, ...]:
    """The sliders of some params, in their order."""
    return tuple(_slider(name, param) for name, param in params.items())


def _slider(name: str, param: LiveParam) -> Slider:
    factor, unit = plain_scale(param.dimension, max(abs(param.low), abs(param.high)))
    low, high, value = (factor * each for each in (param.low, param.high, param.value))
    step = _nice((high - low) / _STEPS)
    return Slider(name, unit, factor, low, high, step, value, param.pace)


def _nice(size: float) -> float:
    """The greatest of 1, 2 and 5 times a power of ten that is no more than a size; 1 of none."""
    if size <= 0:
        return 1.0
    decade = math.floor(math.log10(size) + 1e-9)
    lead = next(k for k in (5, 2, 1) if k * 10.0**decade <= size * (1 + 1e-9))
    return float(f"{lead}e{decade}")


def slider_section(sliders: Sequence[Slider]) -> Markup:
    """The part of a page with its sliders; empty without any."""
    rows = [_row(slider) for slider in sliders]
    if not rows:
        return Markup("")
    box = element("div", *rows, class_="sliders")
    refused = element("p", id="refused", class_="empty", role="status")
    return section("Live params", box, refused)


def _row(slider: Slider) -> Markup:
    key = f"live-{slider.name}"
    # A bound between two places is reached by the one beyond it.
    first = math.floor(slider.low / slider.step + _ROUNDING)
    last = math.ceil(slider.high / slider.step - _ROUNDING)
    bounds = f"{_with_unit(slider.low, '')} to {_with_unit(slider.high, slider.unit)}"
    rate = f", at {slider.rate}" if slider.rate else ""
    now = _with_unit(slider.value, slider.unit)
    control = element(
        "input",
        type="range",
        id=key,
        min=first,
        max=last,
        step=1,
        value=round(slider.value / slider.step),
        aria_valuetext=now,
        aria_describedby=f"{key}-bounds",
        autocomplete="off",
    )
    return element(
        "div",
        element("label", slider.name, for_=key),
        element("b", now, class_="now"),
        control,
        element("small", prose(f"{bounds}{rate}"), id=f"{key}-bounds"),
        element("span", class_="goes"),
        data_param=slider.name,
    )


def _with_unit(value: float, unit: str) -> str:
    return f"{number(value)} {unit}".rstrip().replace("-", "−")
