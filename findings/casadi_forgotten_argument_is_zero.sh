#!/usr/bin/env bash
# casadi 3.8.2: a Function called by names takes every argument left out as zero.
#
# tau = M(q) a + D v as a Function with named inputs q, v, a, called with keywords,
# as the user guide's section on Function objects shows.
# In Python a required argument that is missing is an error, and CasADi does raise
# one for a name that it does not know or for a missing positional argument. So one
# expects an error when v or a is forgotten.
# It evaluates with v = 0 and a = 0 and returns a number. An empty list as a
# positional argument, such as a velocity not yet received, is zero as well.
# A call that forgets the velocity gives torque without damping, silently: 3 N*m
# instead of 33.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile casadi==3.8.2 numpy==2.4.6

"$work/venv/bin/python" - <<'PY'
import casadi as ca

q, v, a = (ca.SX.sym(name, 2) for name in "qva")
tau = ca.Function("tau", [q, v, a], [(2 + ca.cos(q)) * a + 30 * v], ["q", "v", "a"], ["tau"])
full = tau(q=[0, 0], v=[1, 1], a=[1, 1])["tau"]
without_v = tau(q=[0, 0], a=[1, 1])["tau"]
empty_v = tau([0, 0], [], [1, 1])
nothing = tau()["tau"]


def raises(call):
    try:
        call()
    except Exception:
        return True
    return False


print("casadi", ca.__version__)
print("all given:          ", full)
print("v forgotten:         expected an error, observed", without_v)
print("v = []:              expected an error, observed", empty_v)
print("no argument at all:  expected an error, observed", nothing)
assert raises(lambda: tau(q=[0, 0], w=[1, 1], a=[1, 1]))  # an unknown name is an error
assert raises(lambda: tau([0, 0], [1, 1]))  # so is a missing positional argument
assert float(full[0]) == 33 and float(without_v[0]) == 3 and float(empty_v[0]) == 3
assert float(nothing[0]) == 0
PY
