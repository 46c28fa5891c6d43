"""What counts as an oscillation that does not end: closed forms, and runs that chatter."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from typer.testing import CliRunner

from taskspec.compiler import admit, compile_unchecked
from taskspec.examination import examine
from taskspec.spec import load_text
from taskspec_runner.cli.app import app
from taskspec_runner.report.page import render
from taskspec_runner.runs import Run
from taskspec_runner.session import execute_program
from taskspec_runner.verdict import oscillation as oscillations
from taskspec_runner.verdict.oscillation import LEAST_TICKS, References, oscillation
from taskspec_runner.verdict.run_finding import read_finding

T = 1e-3
t = np.arange(4000) * T


def sine(frequency: float, amplitude: float = 1.0, phase: float = 0.4) -> np.ndarray:
    return amplitude * np.sin(2 * math.pi * frequency * t + phase)


# ---- signals in closed form


@pytest.mark.parametrize("frequency", [2.5, 7.3, 40.0, 123.4, 333.3, 480.0])
def test_a_sine_is_found_with_its_frequency_and_amplitude(frequency):
    """Half a visit is 2 s, so bins are 0.5 Hz wide; a Hann lobe of two bins to either side holds
    all but 3e-3 of a sine's power wherever it lies between them."""
    found = oscillation(sine(frequency, 2.0) - 15.0, T, 1.0)
    assert found is not None
    assert found.frequency == pytest.approx(frequency, abs=0.1)
    assert found.amplitude == pytest.approx(2.0, rel=2e-3)
    assert found.growth == pytest.approx(1.0, abs=0.02)


def test_a_signal_that_alternates_is_found_at_half_the_rate():
    found = oscillation(np.where(np.arange(4000) % 2, 3.0, -3.0), T, 1.0)
    assert found is not None
    assert found.frequency == pytest.approx(500.0, abs=0.5)
    # Its power is that of a sine of sqrt(2) times the size.
    assert found.amplitude == pytest.approx(3.0 * math.sqrt(2), rel=2e-3)


def test_an_amplitude_below_the_bound_is_let_pass():
    assert oscillation(sine(20.0, 0.99), T, 1.0) is None
    assert oscillation(sine(20.0, 1.01), T, 1.0) is not None


@pytest.mark.parametrize("frequency", [0.5, 2.5, 40.0, 123.4, 333.3, 480.0])
def test_of_a_long_half_its_end_and_its_means_are_looked_at(frequency, monkeypatch):
    """20 s by spectra of 2048 ticks: the last 2 s, and means of 10 ms. A mean of k ticks has of a
    sine of f the share sin(pi f k T) / (k sin(pi f T)): 0.4 % less at 5 Hz, below which it is
    what finds a sine."""
    monkeypatch.setattr(oscillations, "MOST_TICKS", 2048)
    long = np.arange(40_000) * T
    values = 2.0 * np.sin(2 * math.pi * frequency * long + 0.4) - 15.0
    found = oscillation(values, T, 1.0)
    assert found is not None
    assert found.frequency == pytest.approx(frequency, abs=0.1)
    assert found.amplitude == pytest.approx(2.0, rel=1e-2)
    assert oscillation(values, T, 1.0, References([values + 3.0])) is None
    # What has died away before the end, and was fast, is none.
    gone = values * (np.arange(40_000) < 25_000)
    assert oscillation(gone, T, 1.0) is None


def test_noise_over_a_long_half_is_no_oscillation(monkeypatch):
    monkeypatch.setattr(oscillations, "MOST_TICKS", 2048)
    rng = np.random.default_rng(5)
    for _ in range(20):
        # In a band of 2048 ticks it has 0.1 s.
        assert oscillation(rng.normal(size=40_000), T, 0.05, noisy=True) is None


def test_a_sine_under_noise_is_found_and_noise_alone_is_not():
    """Noise of deviation s has in a band the amplitude s sqrt(20/n): 0.1 s for n = 2000."""
    rng = np.random.default_rng(12)
    for _ in range(200):
        noise = rng.normal(size=4000)
        assert oscillation(noise, T, 0.05, noisy=True) is None
        found = oscillation(noise + sine(31.0, 1.0), T, 0.5, noisy=True)
        assert found is not None
        assert found.frequency == pytest.approx(31.0, abs=0.5)


def test_noise_that_a_loop_has_shaped_is_no_oscillation():
    """White noise through a second-order loop at 12 Hz with a damping ratio of 0.3."""
    w, zeta = 2 * math.pi * 12.0, 0.3
    rng = np.random.default_rng(3)
    found = 0
    for _ in range(100):
        x = v = 0.0
        out = np.empty(4000)
        for k, u in enumerate(rng.normal(size=4000)):
            v += T * (w * w * (u - x) - 2 * zeta * w * v)
            x += T * v
            out[k] = x
        found += oscillation(out, T, 0.1 * float(np.std(out)), noisy=True) is not None
    assert found == 0


@pytest.mark.parametrize("frequency", [8.0, 37.0])
def test_what_decays_by_a_tenth_in_a_quarter_is_let_pass(frequency):
    """Over a quarter of the visit, 1 s, e^(-s t) falls by e^-s; 0.9 is s = 0.105 /s."""
    for rate, decays in ((0.0, False), (0.08, False), (0.13, True), (1.0, True), (10.0, True)):
        values = np.exp(-rate * t) * sine(frequency, 10.0)
        found = oscillation(values, T, 1e-3)
        assert (found is None) == decays
        if found is not None:
            assert found.growth == pytest.approx(math.exp(-rate), abs=0.01)


def test_what_begins_late_is_looked_at_from_there():
    """Bounces that decay would grow beside the rest before them; what stays is found all the same.

    The last half begins at 2 s, the signal at 3.2 s."""
    bounces = np.where(t < 3.2, 0.0, -5.0 * np.exp(-4 * (t - 3.2)) * (1 - np.cos(90 * (t - 3.2))))
    assert oscillation(bounces, T, 1.0) is None
    found = oscillation(np.where(t < 3.2, 0.0, sine(25.0, 2.0)), T, 1.0)
    assert found is not None
    assert found.amplitude == pytest.approx(2.0, rel=0.02)
    few = np.where(t < 3.96, 0.0, sine(250.0, 2.0))  # 40 ticks of it
    assert oscillation(few, T, 1.0) is None


def test_what_grows_is_found_with_its_growth():
    found = oscillation(np.exp(0.5 * t) * sine(25.0, 1.0), T, 1.0)
    assert found is not None
    assert found.growth == pytest.approx(math.exp(0.5), rel=0.02)


def test_the_frequency_of_a_reference_is_taken_out_and_no_other():
    reference = sine(3.0, 0.05)
    answer = sine(3.0, 8.0, 1.3)
    assert oscillation(answer, T, 1.0) is not None
    assert oscillation(answer, T, 1.0, References([reference])) is None
    found = oscillation(answer + sine(22.0, 2.0), T, 1.0, References([reference]))
    assert found is not None
    assert found.frequency == pytest.approx(22.0, abs=0.1)


def test_a_chirp_of_a_reference_is_taken_out():
    chirp = np.sin(2 * math.pi * (2.0 * t + 3.0 * t**2))
    answer = 5.0 * np.sin(2 * math.pi * (2.0 * t + 3.0 * t**2) + 0.8)
    assert oscillation(answer, T, 1.0, References([chirp])) is None
    # From 14 to 26 Hz in the last half; an oscillation beyond that is seen.
    assert oscillation(answer + sine(60.0, 2.0), T, 1.0, References([chirp])) is not None


def test_the_square_wave_that_friction_makes_of_a_sine_is_taken_out():
    reference = sine(1.0, 0.05)
    friction = 12.0 * np.sign(np.cos(2 * math.pi * t + 0.4))
    assert oscillation(friction, T, 1.0, References([reference])) is None
    assert oscillation(friction + sine(33.0, 4.0), T, 1.0, References([reference])) is not None


@pytest.mark.parametrize(
    "values",
    [
        np.where(t > 3.1, 5.0, 0.0),
        np.where(t > 3.1, 50.0 * (t - 3.1), 0.0),
        30.0 * np.exp(-(((t - 3.0) / 0.02) ** 2)),
        np.where(t > 2.5, 20.0 * np.exp(-8 * (t - 2.5)) * np.sin(90 * (t - 2.5)), 0.0),
        40.0 * np.exp(-t / 1.5),
        5.0 * t**2,
        np.zeros(4000),
    ],
    ids=["step", "kink", "blow", "ringing that decays", "drift", "parabola", "nothing"],
)
def test_what_happens_once_is_no_oscillation(values):
    assert oscillation(values, T, 1.0) is None


def test_a_visit_too_short_to_tell_is_not_judged():
    short = sine(100.0, 5.0)[: 2 * LEAST_TICKS - 1]
    assert oscillation(short, T, 1.0) is None
    assert oscillation(sine(100.0, 5.0)[: 2 * LEAST_TICKS], T, 1.0) is not None
    # Slower than four cycles in the half visit is a drift.
    assert oscillation(sine(1.4, 5.0), T, 1.0) is None


def test_a_signal_without_a_value_is_not_judged():
    values = sine(20.0, 5.0)
    values[-10] = np.nan
    assert oscillation(values, T, 1.0) is None


# ---- runs

PRESS = """\
taskspec: 1
name: press
robot:
  model: panda
  tool: {{shape: sphere, radius: 10 mm}}
  start: {{xyz: [500 mm, 0, 299.5 mm]}}{sensor}
world: {{table: {{shape: plane, xyz: [0, 0, 300 mm], stiffness: 10 kN/m{moves}}}}}
frame: table
law: {{kind: {law}}}
stages:
  press: {{axes: {{z: {{force: -10 N}}{axes}}}, time: {time}{allow}}}
"""
_PARALLEL = "parallel, damping: 60 N*s/m, stiffness: 400 N/m"
#: Of hybrid with these gains the largest integral is 67 /s.
_HYBRID = "hybrid, force: {integral: 12 /s, damping: 200 N*s/m}"
_RINGS = "hybrid, force: {integral: 90 /s, damping: 200 N*s/m}"
_CHATTERS = f"{_PARALLEL}, force: {{proportional: 0.5, integral: 55 /s}}"


def made(folder, **parts: str) -> Run:
    given = {"law": _HYBRID, "sensor": "", "moves": "", "axes": "", "time": "4 s", "allow": ""}
    text = PRESS.format(**given | parts)
    program = compile_unchecked(load_text(text, "press.yaml"))
    return execute_program(program, folder / "run", report=False)


_TABLE = ", motion: {z: 0.3 mm * sin(2*pi*clock/(0.25 s))}"
_SLIDE = ", x: {position: 10 mm * sin(2*pi*t/(1 s))}"
_NOISE = "\n  sensor: {noise: 0.5 N}"


@pytest.mark.parametrize(
    "parts",
    [
        {},
        {"moves": _TABLE},
        {"moves": ", friction: 0.3", "axes": _SLIDE},
        {"sensor": _NOISE},
        {"sensor": _NOISE, "law": "parallel"},
        {"law": "hybrid, solve: qp", "axes": _SLIDE},
    ],
    ids=["still", "moving table", "friction", "noise", "noise, parallel", "qp"],
)
def test_runs_that_settle_have_no_finding(tmp_path, parts):
    run = made(tmp_path, **parts)
    assert run.findings == ()
    assert run.verdict == "done"
    assert run.exit_code == 0


def crossings(values: np.ndarray) -> float:
    """How often per second a signal rises through its mean from well below it [Hz]."""
    low, high = (values.mean() + sign * 0.3 * values.std() for sign in (-1, 1))
    above, rises = False, []
    for k, value in enumerate(values):
        if value > high and not above:
            rises.append(k)
        above = value > high or (above and value > low)
    return (len(rises) - 1) / ((rises[-1] - rises[0]) * T)


@pytest.mark.parametrize(
    "parts",
    [
        {"law": _CHATTERS},
        {"law": _RINGS},
        {"law": _RINGS, "moves": _TABLE},
        {"law": _RINGS, "sensor": _NOISE},
    ],
    ids=["parallel at 55 /s", "hybrid at 90 /s", "on a moving table", "under noise"],
)
def test_runs_that_chatter_are_missed(tmp_path, parts):
    run = made(tmp_path, **parts)
    assert run.summary["status"] == "done"
    assert (run.verdict, run.exit_code) == ("missed", 1)
    (found,) = run.findings
    assert (found.kind, found.stage, found.signal) == ("oscillation", "press", "force.z")
    force = run.columns["force.z"][2000:]
    # Two ways to measure it, each to about a bin of the spectrum, 0.5 Hz.
    assert found.frequency == pytest.approx(crossings(force), abs=0.5)
    assert found.amplitude == pytest.approx(math.sqrt(2) * np.std(force), rel=0.3)
    assert "Oscillation and saturation" in render(run)


def test_a_program_that_clamps_each_tick_chatters_and_saturates(tmp_path):
    """Motion gains beyond their bound: under `qp` joints go to and fro between their velocities."""
    run = made(tmp_path, law="hybrid, solve: qp, bandwidth: 160 Hz", time="1 s")
    assert run.summary["status"] == "done"
    assert {each.kind for each in run.findings} == {"oscillation", "saturation"}
    assert run.exit_code == 1
    for kind in ("oscillation", "saturation"):
        folder = tmp_path / kind
        law, allow = "hybrid, solve: qp, bandwidth: 160 Hz", f", allow: {kind}"
        one = made(folder, law=law, time="1 s", allow=allow)
        assert [each.kind for each in one.findings if each.allowed] == [kind]
        assert one.exit_code == 1
    allow = ", allow: [oscillation, saturation]"
    both = made(
        tmp_path / "both", law="hybrid, solve: qp, bandwidth: 160 Hz", time="1 s", allow=allow
    )
    assert all(each.allowed for each in both.findings)
    assert (both.verdict, both.exit_code) == ("done", 0)


SPINS = """
taskspec: 1
robot: {model: ur5e, tool: {shape: sphere, radius: 10 mm, length: 118 mm, mass: 330 g},
  start: {xyz: [456 mm, 58 mm, 260 mm]}}
world: {work: {shape: plane, xyz: [0, 0, 100 mm]}}
frame: world
law: {kind: parallel-pid, solve: qp, stiffness: {angular: ANGULAR}}
control: {rate: 250 Hz}
stages:
  hold: {axes: {z: {velocity: -5 mm/s}}, time: 2 s}
"""


@pytest.mark.parametrize(("angular", "verdict"), [("79 N*m/rad", "missed"), ("4 N*m/rad", "done")])
def test_a_joint_that_spins_at_its_velocity_limit_is_saturated(tmp_path, angular, verdict):
    """Sampled every T a spring k on a mass h is unstable from k T^2/h = 4 on at the latest: here at
    66 N m/rad. The program keeps the joint from passing its limit, and there it stays.
    """
    loaded = load_text(SPINS.replace("ANGULAR", angular), "t.yaml", base=tmp_path)
    run = execute_program(admit(examine(loaded), force=True), tmp_path / "run", report=False)
    assert run.verdict == verdict
    if verdict == "missed":
        (found,) = [each for each in run.findings if each.kind == "saturation"]
        assert found.signal == "joint.6.velocity"
        fastest = run.program.context.robot.velocity_limit[5]
        spun = np.abs(run.history.columns["joint.6.velocity"][250:])
        assert found.share == pytest.approx(float(np.mean(spun > 0.5 * fastest)), abs=0.1)
    else:
        assert run.findings == ()


def test_a_stage_that_allows_it_passes(tmp_path):
    run = made(tmp_path, law=_CHATTERS, allow=", allow: [oscillation]")
    assert [each.allowed for each in run.findings] == [True]
    assert (run.verdict, run.exit_code) == ("done", 0)


def test_a_run_that_breaks_off_is_judged_as_far_as_it_came(tmp_path):
    """The outcome stays that of what ended it."""
    run = made(tmp_path, law=_RINGS, allow=", fail_if: t > 3 s")
    assert (run.verdict, run.exit_code) == ("failed", 6)
    (found,) = run.findings
    assert found.kind == "oscillation"
    assert (found.start, found.end) == pytest.approx((1.5, 3.0), abs=5e-3)


def test_the_console_and_the_summary_say_it(tmp_path):
    file = tmp_path / "press.yaml"
    parts = {"sensor": "", "moves": "", "axes": "", "time": "4 s", "allow": "", "law": _CHATTERS}
    file.write_text(PRESS.format(**parts))
    arguments = ["run", str(file), "--force", "--out", str(tmp_path / "run")]
    result = CliRunner().invoke(app, arguments, env={"COLUMNS": "200"})
    assert result.exit_code == 1
    assert "press: force.z oscillates at" in result.output
    assert "1 finding beside" in result.output
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    (entry,) = summary["findings"]
    assert entry["kind"] == "oscillation"
    found = read_finding(entry)
    assert found.as_data() == entry
    loaded = Run.load(tmp_path / "run")
    assert loaded.findings == (found,)
    assert loaded.verdict == "missed"


def test_a_blow_comes_after_the_stage_that_a_touch_ends(tmp_path):
    """What TS725 refuses: the stage that ends by the touch has a tenth of what follows."""
    text = (
        "taskspec: 1\nname: knock\nrobot: {model: panda, start: {xyz: [500 mm, 0, 310 mm]}}\n"
        "world: {table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 40 kN/m}}\nframe: table\n"
        "stages:\n"
        "  knock: {axes: {z: {velocity: -80 mm/s}}, until: force.z < -2 N, within: {time: 1 s}}\n"
        "  press: {axes: {z: {force: -10 N}}, time: 0.5 s}\n"
    )
    program = compile_unchecked(load_text(text, "knock.yaml"))
    run = execute_program(program, tmp_path / "run", report=False)
    peaks = {name: each["force"] for name, each in run.summary["peaks"].items()}
    assert peaks["press"] > 3 * peaks["knock"]
