"""People's xacro files: expanded by the `xacro` package where that is installed."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from taskspec.robot.errors import RobotError
from taskspec.robot.files import Roots, note_program, read_part
from taskspec.robot.ros_packages import find_package
from taskspec.text.confines import REMEDY, Confines
from taskspec.text.suggest import suggestion

SUFFIX = ".xacro"

_SECONDS = 30
#: Packages of which one file may include files.
_MOST_PACKAGES = 50
#: What defines something for elements that come after, and is nothing in a robot by itself.
_DEFINITIONS = ("property", "arg", "macro")
_COMPUTED = re.compile(r"\$[({]")
_ARGUMENT = re.compile(rb"<\s*xacro:arg\b([^>]*)>")
_USED = re.compile(rb"\$\(arg\s+([\w.-]+)\s*\)")
_ATTRIBUTE = re.compile(rb"\b(name|default)\s*=\s*(\"[^\"]*\"|'[^']*')")
#: xacro ends the process on some mistakes, and what a file computes may take for ever. Where
#: packages lie is for whoever called it to find. The process is isolated (`-I`): a module that lies
#: beside a robot of other people is not imported, however it is called.
_PROGRAM = """
import contextlib, json, sys
sys.path += json.loads(sys.argv[2])
arguments, packages = json.loads(sys.argv[3]), json.loads(sys.argv[4])
import xacro
class Missing(BaseException):
    pass
def find(name):
    if name not in packages:
        raise Missing("package", name)
    return packages[name]
with contextlib.suppress(ImportError):
    from xacro import substitution_args
    substitution_args._eval_find = substitution_args._eval_dict["find"] = find
attributes = getattr(xacro, "check_attrs", None)
def with_default(tag, required, optional):
    # An argument without a default is refused even where it is given.
    if tag.tagName == "xacro:arg" and not tag.hasAttribute("default"):
        name = tag.getAttribute("name")
        if name not in arguments:
            raise Missing("argument", name)
        tag.setAttribute("default", "")
    return attributes(tag, required, optional)
xacro.check_attrs = with_default
xacro.all_includes.clear()
done = {}
try:
    with contextlib.redirect_stdout(sys.stderr):
        document = xacro.parse(None, sys.argv[1])
        xacro.process_doc(document, mappings=arguments)
    done["text"] = document.toxml()
except Missing as missing:
    done[missing.args[0]] = missing.args[1]
except (Exception, SystemExit) as error:
    done["error"] = str(error) or type(error).__name__
json.dump({"files": xacro.all_includes, **done}, sys.stdout)
"""


def finished(root: ElementTree.Element) -> bool:
    """Whether nothing in a file is left to be expanded; definitions that nothing uses are removed.

    CAD programs and vendors leave namespaces and properties in files that are whole without them.
    """
    for element in list(root):
        if _xacro_name(element) in _DEFINITIONS:
            root.remove(element)
    return not any(
        _xacro_name(element)
        or any(_COMPUTED.search(text) for text in (element.text or "", *element.attrib.values()))
        or any("xacro" in key and key.startswith("{") for key in element.attrib)
        for element in root.iter()
    )


def _xacro_name(element: ElementTree.Element) -> str:
    """The name of one of xacro's elements without its namespace; empty for any other."""
    space, _, name = str(element.tag).rpartition("}")
    return name if "xacro" in space else ""


def expanded(
    path: Path, shown: str, roots: Roots, arguments: Mapping[str, str]
) -> tuple[str, Confines]:
    """The URDF text that a xacro file stands for, and where files of the packages in it may lie.

    Args:
        path: Where it is.
        shown: How the user wrote it.
        roots: Where it and what it includes may lie.
        arguments: Values of its arguments.

    Raises:
        RobotError: TS402 when the package is not installed or cannot expand it, TS409 when it
            includes a file from elsewhere.
    """
    if find_spec("xacro") is None:
        stem = Path(shown).name.removesuffix(SUFFIX).removesuffix(".urdf")
        raise RobotError(
            "TS402",
            f"'{shown}' is xacro, and the package that expands it is not installed",
            "install it: pip install xacro; or expand the file where it is installed, into another "
            f"one: xacro {Path(shown).name} -o {stem}.expanded.urdf",
        )
    note_program()
    packages: dict[str, Path] = {}
    done = _run(path, shown, arguments, packages)
    while "package" in done and len(packages) < _MOST_PACKAGES:
        name = str(done["package"])
        folder = find_package(name, roots)
        if folder is None:
            raise RobotError(
                "TS402",
                f"'{shown}' needs the package '{name}', $(find {name}), which is nowhere",
                f"put a folder '{name}' with its package.xml beside the file or above it, or name "
                "where it is in ROS_PACKAGE_PATH or AMENT_PREFIX_PATH, as a ROS workspace that is "
                "sourced does",
            )
        packages[name] = folder.resolve()
        done = _run(path, shown, arguments, packages)
    opened = Confines((*roots.confines.folders, *packages.values()))
    declared = _declared([path, *(path.parent / name for name in done["files"])], opened)
    if "text" not in done:
        raise _failed(done, shown, declared)
    unknown = next((name for name in arguments if name not in declared), None)
    if unknown is not None:
        raise RobotError(
            "TS402",
            f"'{shown}' has no argument '{unknown}'",
            suggestion(unknown, declared, "arguments") or "it has none: leave `xacro` out",
            ("xacro", unknown),
        )
    for name in done["files"]:
        included = path.parent / name
        if not (opened.hold(included) or _below(included, packages.values())):
            raise RobotError(
                "TS409", f"'{shown}' includes '{name}' from outside of the task's project", REMEDY
            )
        read_part(included, name)
    return str(done["text"]), opened


def _run(
    path: Path, shown: str, arguments: Mapping[str, str], packages: Mapping[str, Path]
) -> dict[str, Any]:
    """What xacro makes of a file: its text, the package that it misses, or its error."""
    own = {path.parent.resolve(), Path.cwd()}
    modules = [each for each in sys.path if Path(each).is_absolute() and Path(each) not in own]
    inputs = (modules, dict(arguments), {name: str(each) for name, each in packages.items()})
    command = [sys.executable, "-I", "-c", _PROGRAM, str(path.resolve()), *map(json.dumps, inputs)]
    try:
        done = subprocess.run(
            command, capture_output=True, timeout=_SECONDS, cwd=path.parent, check=False
        )
    except subprocess.TimeoutExpired:
        raise RobotError(
            "TS402", f"'{shown}' is not expanded after {_SECONDS} s", "expand it yourself"
        ) from None
    if done.returncode:
        lines = done.stderr.decode(errors="replace").strip().splitlines()
        return {"files": [], "error": lines[-1].strip() if lines else "no reason given"}
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def _failed(done: Mapping[str, Any], shown: str, declared: Mapping[str, str | None]) -> RobotError:
    """The error of a file that xacro does not expand."""
    reason = str(done.get("error", "it includes files of too many packages"))
    undefined = re.search(r"Undefined substitution argument (\S+)", reason)
    name = done.get("argument") or (undefined[1] if undefined else "")
    if not name:
        return RobotError("TS402", f"xacro cannot expand '{shown}': {reason[:200]}")
    listed = ", ".join(
        each if default is None else f"{each} (else {default or 'empty'})"
        for each, default in declared.items()
    )
    return RobotError(
        "TS402",
        f"'{shown}' is xacro with an argument '{name}' that has no value",
        f"give it one: robot: {{model: {shown}, xacro: {{{name}: VALUE}}}}; "
        f"arguments of the file: {listed}",
    )


def _declared(files: list[Path], opened: Confines) -> dict[str, str | None]:
    """The arguments that files declare or use, each with its default; None where it has none."""
    found: dict[str, str | None] = {}
    for path in files:
        try:
            data = path.read_bytes() if opened.hold(path) else b""
        except OSError:
            continue
        for argument in _ARGUMENT.finditer(data):
            given = {key: text[1:-1].decode() for key, text in _ATTRIBUTE.findall(argument[1])}
            name, default = given.get(b"name"), given.get(b"default")
            if name is not None and found.get(name) is None:
                found[name] = default
        for used in _USED.finditer(data):
            found.setdefault(used[1].decode(), None)
    return found


def _below(path: Path, folders: Any) -> bool:
    """Whether a path leads into a folder by its names; links of a workspace lead out of it."""
    return ".." not in path.parts and any(path.absolute().is_relative_to(each) for each in folders)
