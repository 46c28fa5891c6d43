#!/usr/bin/env bash
# xacro 2.1.1: reading a property once, for a comment's sake, changes the robot that follows.
#
# Three properties: tool_mass = 1, arm_mass = ${tool_mass * 2}, and later tool_mass
# = 5 for another tool. Two files differ in one thing: the second mentions
# ${arm_mass} in a label before tool_mass is set anew.
# The xacro page shows properties as named values put in where they are used. So
# one expects the same arm mass from both files: whichever rule holds, looking at
# a property should not alter it.
# A property is evaluated when it is first used, with the values of then, and kept.
# Not mentioned before: 10 kg. Mentioned before: 2 kg.
# A debug label, or the order of two included files, doubles or divides a mass
# or a joint limit of the URDF, and with it gravity compensation.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile xacro==2.1.1

"$work/venv/bin/python" - <<'PY'
import importlib.metadata as metadata

import xacro

robot = """<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:property name="tool_mass" value="1"/>
<xacro:property name="arm_mass" value="${tool_mass * 2}"/>
%s
<xacro:property name="tool_mass" value="5"/>
<link name="arm"><inertial><mass value="${arm_mass}"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""


def mass(between):
    document = xacro.parse(robot % between)
    xacro.process_doc(document)
    return float(document.getElementsByTagName("mass")[0].getAttribute("value"))


unused, used = mass(""), mass('<link name="arm_of_${arm_mass}_kg"/>')
print("xacro", metadata.version("xacro"))
print("mass of the arm: expected the same in both files")
print("observed: property not mentioned before", unused, "kg; mentioned before", used, "kg")
assert (unused, used) == (10.0, 2.0)
PY
