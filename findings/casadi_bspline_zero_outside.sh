#!/usr/bin/env bash
# casadi 3.8.2: the same lookup table is 0 outside its grid as a B-spline, but not as linear.
#
# A force-depth table, F = 1000 * d**2, on the grid d = 0, 1, 2, 3; the force is
# wanted 0.1 % beyond the last grid point.
# The user guide introduces interpolant with the two plugins 'linear' and 'bspline'
# as ways of interpolating one and the same table. So one expects about 9000 N
# from both, or an error outside the grid.
# 'linear' extends the last segment; 'bspline' returns 0 and slope 0, no warning.
# At the edge itself it is exact, so the force falls from 9000 N to 0 at once.
# An optimiser that steps over the edge finds a flat force of zero there and stays;
# a contact that is pressed deeper than the table has no force at all.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile casadi==3.8.2 numpy==2.4.6

"$work/venv/bin/python" - <<'PY'
import casadi as ca
import numpy as np

depth = np.array([0.0, 1.0, 2.0, 3.0])
force = 1000 * depth**2
print("casadi", ca.__version__)
x = ca.MX.sym("x")
result = {}
for plugin in ("linear", "bspline"):
    table = ca.interpolant("table", plugin, [depth], force)
    f = ca.Function("f", [x], [table(x), ca.jacobian(table(x), x)])
    result[plugin] = [[float(y) for y in f(d)] for d in (3.0, 3.003)]
    (edge, slope), (out, slope_out) = result[plugin]
    print(f"{plugin:8} at 3.0: {edge:8.1f} N, slope {slope:7.1f}   at 3.003: expected about "
          f"{1000 * 3.003**2:.0f}, observed {out:8.1f} N, slope {slope_out:7.1f}")
assert abs(result["linear"][1][0] - 9015) < 1
assert abs(result["bspline"][0][0] - 9000) < 1e-3 and result["bspline"][0][1] > 5000
assert result["bspline"][1] == [0.0, 0.0]
PY
