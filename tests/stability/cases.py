"""The grid: laws, gains, contacts and delays, and one gain that is moved over its boundary."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

from theory.presses import ARMS, Arm

TRANSLATIONS = "xyz"
UNITS = {
    "force.integral": "/s",
    "force.proportional": "",
    "force.damping": "N*s/m",
    "damping": "N*s/m",
    "mass": "kg",
    "stiffness": "N/m",
    "bandwidth": "Hz",
    "joint_damping": "N*m*s/rad",
}
#: Inside and past the boundary; the innermost are as near as a run of bounded length can tell.
FACTORS = (0.6, 0.9, 0.975, 1.025, 1.1, 1.4)


@dataclass(frozen=True)
class Family:
    """One law with its gains on one contact.

    Attributes:
        law: its name. arm: of `ARMS`. gains: SI values of translations; `joint_damping` of joints.
        swept: which of them is moved, on the normal axis alone.
        k_e: of the contact [kN/m], or "rigid". delay: of the sensor [ms]. rate: of the plant [kHz].
        axis: that the gain is moved on, if it is not the normal one. more: keys of the robot.
        angular: gains of rotations, as YAML flow text.
    """

    law: str
    arm: str
    gains: Mapping[str, float]
    swept: str
    k_e: float | str
    delay: float = 0.0
    rate: int = 1
    axis: str = ""
    more: str = ""
    angular: Mapping[str, str] = field(default_factory=dict)

    @property
    def place(self) -> Arm:
        return ARMS[self.arm]

    @property
    def on(self) -> str:
        """The axis on which the gain is moved."""
        return self.axis or self.place.normal

    @property
    def name(self) -> str:
        given = ", ".join(f"{g} {v:g}" for g, v in self.gains.items() if g != self.swept)
        contact = self.k_e if self.k_e == "rigid" else f"{self.k_e:g} kN/m"
        rate = f", plant at {self.rate} kHz" if self.rate > 1 else ""
        angular = ", ".join(f"angular {g} {v}" for g, v in self.angular.items())
        return ", ".join(p for p in (self.arm, given, angular, contact) if p) + rate

    def with_gain(self, value: float) -> Family:
        return replace(self, gains={**self.gains, self.swept: value})

    def law_text(self, value: float) -> str:
        """The law with its swept gain at a value [SI]."""
        keys, force = [f"kind: {self.law}"], []
        for gain, given in {**self.gains, self.swept: value}.items():
            text = self._one(gain, given)
            if gain.startswith("force."):
                force.append(f"{gain.removeprefix('force.')}: {text}")
            else:
                keys.append(f"{'damping' if gain == 'joint_damping' else gain}: {text}")
        if force:
            keys.append(f"force: {{{', '.join(force)}}}")
        return f"{{{', '.join(keys)}}}"

    def _one(self, gain: str, given: float) -> str:
        unit = UNITS[gain]
        value = f"{given:.9g} {unit}".strip()
        if gain == "joint_damping":
            return value
        if gain.startswith("force."):
            return f"{{{self.place.normal}: {value}}}"
        base = f"{self.gains.get(gain, given):.9g} {unit}".strip()
        axes = [a for a in self.place.axes.split() if a in TRANSLATIONS]
        parts = [f"{a}: {value if a == self.on and gain == self.swept else base}" for a in axes]
        if gain in self.angular:
            turning = [a for a in self.place.axes.split() if a not in TRANSLATIONS]
            parts += [f"{a}: {self.angular[gain]}" for a in turning]
        return f"{{{', '.join(parts)}}}"

    def task(self, settled: float, value: float, settling: float, seconds: float) -> str:
        """The text of a task: a press with a gain that settles, then with the one in question."""
        sensor = f"sensor: {{delay: {self.delay:g} ms}}" if self.delay else ""
        stiffness = self.k_e if self.k_e == "rigid" else f"{self.k_e:g} kN/m"
        damping = "" if self.k_e == "rigid" else ", damping: 0"
        return self.place.task(
            self.law_text(settled),
            f"settle: {{axes: {{N: {{force: +10 N}}}}, time: {settling:.6g} s}}",
            f"try: {{law: {self.law_text(value)}, axes: {{N: {{force: +10 N, ramp: 0}}}}, "
            f"time: {seconds:.6g} s}}",
            contact=f"stiffness: {stiffness}{damping}",
            more=", ".join(part for part in (sensor, self.more) if part),
            rest=f"control: {{rate: 1 kHz, plant_rate: {self.rate} kHz}}\n",
        )


SOFT = {"mass": 1, "damping": 40, "stiffness": 400, "force.proportional": 0.5}
STIFF = {"mass": 1, "damping": 90, "stiffness": 500, "force.proportional": 1.0}
HEAVY = {**STIFF, "mass": 2.5, "damping": 150}
SLOW = {"mass": 2, "damping": 90, "stiffness": 400, "force.integral": 2.0}
PID = {"stiffness": 400, "damping": 60, "force.proportional": 0.5}
HYBRID = {"force.proportional": 0.2, "force.damping": 120}
PUSHED = {"force.integral": 3.0, "force.damping": 80}
LIGHT = {"damping": "2 N*m*s/rad", "stiffness": "20 N*m/rad"}


def families() -> Iterator[Family]:
    """All of the grid."""
    yield from _parallel()
    yield from _regulator()
    yield from _hybrid()
    yield from _multipliers()
    yield from _springs()


def _parallel() -> Iterator[Family]:
    law, integral, proportional = "parallel", "force.integral", "force.proportional"
    for k_e, delays in ((2, (0, 2, 5)), (10, (0, 2, 5)), (50, (0, 1, 2))):
        for delay in delays:
            yield Family(law, "panda", SOFT, integral, k_e, delay)
    yield Family(law, "planar2", STIFF, integral, 80)
    yield Family(law, "planar2", STIFF, integral, 80, rate=5)
    for delay in (1, 3):
        yield Family(law, "planar2", HEAVY, integral, 80, delay)
    for delay in (0, 4):
        yield Family(law, "ur5e", {**SOFT, "damping": 70}, integral, 15, delay)
    for k_e, delay in ((20, 0), (80, 0), (20, 3)):
        yield Family(law, "planar2", SLOW, proportional, k_e, delay)


def _regulator() -> Iterator[Family]:
    for k_e in (5, 20):
        for delay in (0, 3):
            yield Family("parallel-pid", "planar2", PID, "force.integral", k_e, delay)
    for delay in (0, 2):
        yield Family("parallel-pid", "planar3", PID, "force.integral", 10, delay, angular=LIGHT)


def _hybrid() -> Iterator[Family]:
    for k_e in (5, 20, 80):
        for delay in (0, 5):
            yield Family("hybrid", "panda", HYBRID, "force.integral", k_e, delay)
    for delay in (0, 3):
        yield Family("hybrid", "ur5e", HYBRID, "force.integral", 15, delay)
    for k_e, delay in ((10, 1), (10, 3), (40, 2)):
        yield Family("hybrid", "planar2", PUSHED, "force.proportional", k_e, delay)
    yield Family("hybrid", "planar2", PUSHED, "force.proportional", "rigid", rate=20)
    yield Family("hybrid", "planar2", {}, "bandwidth", 10, axis="y")


def _multipliers() -> Iterator[Family]:
    for k_e in (10, 50):
        for delay in (0, 3):
            yield Family("hybrid-multipliers", "panda", HYBRID, "force.integral", k_e, delay)
    for delay in (1, 3):
        yield Family("hybrid-multipliers", "planar2", PUSHED, "force.proportional", 10, delay)
    damped = {"force.damping": 80}
    for k_e, delay in ((10, 1), (10, 3), (50, 2)):
        yield Family("hybrid-reaction", "panda", damped, "force.proportional", k_e, delay)


def _springs() -> Iterator[Family]:
    for mass, delay in ((0.6, 0), (1, 0), (1, 2), (0.6, 4)):
        given = {"mass": mass, "stiffness": 500, "damping": 60}
        yield Family("impedance", "planar2", given, "damping", 10, delay)
    for delay in (0, 2):
        given = {"damping": 30, "stiffness": 300, "mass": 4}
        yield Family("impedance", "panda", given, "mass", 20, delay)
    for law in ("impedance-natural", "pd"):
        given = {"stiffness": 500, "damping": 60}
        yield Family(law, "planar2", given, "damping", 10)
        yield Family(law, "planar3", given, "damping", 5, angular=LIGHT)
    yield Family("pd-joint", "planar2", {"stiffness": 800}, "joint_damping", 10)
    yield Family("pd-joint", "panda", {"stiffness": 2000}, "joint_damping", 10)
    damped = "joint_damping: 2 N*m*s/rad"
    yield Family("stiffness", "planar2", {"stiffness": 500}, "stiffness", 10, more=damped)
