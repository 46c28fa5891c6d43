#!/usr/bin/env bash
# fmpy 0.3.32: an FMU for co-simulation alone cannot be loaded.
#
# A binary has every function that FMI 3.0 declares as common or as one of
# co-simulation, and none of model exchange and scheduled execution.
# The standard wants the functions of the interface types that an FMU has to be
# present (FMI 3.0, "FMU Distribution"), and this one is for co-simulation. So
# one expects the class for co-simulation to load it.
# FMU3Slave looks up all functions of the standard, fmi3SetTime and
# fmi3ActivateModelPartition among them, and raises "undefined symbol".
# An exporter that tests with other tools finds out from its users; the remedy is
# to export functions that are never called. FMI 2.0 has no such trouble.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile fmpy==0.3.32

cd "$work"
"$work/venv/bin/python" - <<'PY'
import importlib.metadata as metadata
import re
import subprocess
from pathlib import Path

import fmpy
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave


def made(version, others):
    """An FMU's folder, and the names of its functions: all, or those of co-simulation."""
    header = (Path(fmpy.__file__).parent / "c-code" / f"fmi{version}Functions.h").read_text()
    parts = re.split(r"/\*{20,}\s*(.*?)\s*\*{20,}/", header, flags=re.S)
    names = []
    for title, text in zip(parts[1::2], parts[2::2], strict=True):
        if others or not re.search("Model Exchange|Scheduled Execution", title):
            names += re.findall(rf"FMI{version}_Export fmi{version}\w+TYPE +(fmi{version}\w+);", text)
    folder = Path(f"fmi{version}-{others}")
    binaries = folder / "binaries" / (fmpy.platform if version == 2 else fmpy.platform_tuple)
    binaries.mkdir(parents=True)
    # Only loaded, never called.
    Path("m.c").write_text("".join(f"int {name}(void) {{ return 0; }}\n" for name in names))
    library = binaries / f"m{fmpy.sharedLibraryExtension}"
    subprocess.run(["cc", "-shared", "-fPIC", "-o", library, "m.c"], check=True)
    return folder, names


def load(version, others):
    folder, names = made(version, others)
    slave = FMU2Slave if version == 2 else FMU3Slave
    assert any(name.endswith("DoStep") for name in names)
    try:
        slave(guid="", unzipDirectory=str(folder.resolve()), modelIdentifier="m", instanceName="m")
    except AttributeError as error:
        return len(names), str(error).rpartition(": ")[2]
    return len(names), "loaded"


print("fmpy", metadata.version("fmpy"))
alone, whole, older = load(3, False), load(3, True), load(2, False)
print("FMI 3.0, functions of co-simulation alone: expected loaded, observed", alone)
print("FMI 3.0, functions of all interface types:", whole)
print("FMI 2.0, functions of co-simulation alone:", older)
assert alone[1] == "fmi3ActivateModelPartition", alone
assert whole[1] == older[1] == "loaded"
PY
