#!/usr/bin/env bash
# fmpy 0.3.32: `fmpy compile` makes a binary of a source FMU that fmpy cannot load.
#
# The sources do what FMI 3.0 says a source FMU must ("Header Files and Naming of
# Functions"): they define FMI3_FUNCTION_PREFIX as the model identifier and "_",
# then include fmi3Functions.h, which the importer has. The same section has the
# importer leave the prefix out for a shared library: by a header of its own, or
# by FMI3_OVERRIDE_FUNCTION_PREFIX. So one expects functions without prefix.
# fmpy compiles with the standard's header and without that definition: the
# library has m_fmi3GetVersion, and no fmi3GetVersion. It succeeds in silence.
# On Windows it defines FMI3_FUNCTION_PREFIX as nothing, which the sources then
# define anew. An exporter can put the definition into buildDescription.xml; it
# is then in the way of whoever links statically.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile fmpy==0.3.32
export PATH="$work/venv/bin:$PATH"

cd "$work"
python - <<'PY'
import ctypes
import importlib.metadata as metadata
from pathlib import Path

import fmpy
from fmpy.build import build_platform_binary

MODEL = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="m" instantiationToken="m">
<CoSimulation modelIdentifier="m"/><ModelVariables>
<Float64 name="time" valueReference="0" causality="independent" variability="continuous"/>
</ModelVariables><ModelStructure/></fmiModelDescription>
"""
BUILD = """<?xml version="1.0" encoding="UTF-8"?>
<fmiBuildDescription fmiVersion="3.0"><BuildConfiguration modelIdentifier="m">
<SourceFileSet language="C99"><SourceFile name="m.c"/>%s</SourceFileSet>
</BuildConfiguration></fmiBuildDescription>
"""
SOURCE = """#define FMI3_FUNCTION_PREFIX m_
#include "fmi3Functions.h"
const char *fmi3GetVersion(void) { return "3.0"; }
"""


def functions(definition):
    """Which of two names the compiled library has."""
    folder = Path("with" if definition else "without").resolve()
    (folder / "sources").mkdir(parents=True)
    (folder / "modelDescription.xml").write_text(MODEL)
    (folder / "sources" / "buildDescription.xml").write_text(BUILD % definition)
    (folder / "sources" / "m.c").write_text(SOURCE)
    build_platform_binary(folder)
    name = f"m{fmpy.sharedLibraryExtension}"
    library = ctypes.CDLL(str(folder / "binaries" / fmpy.platform_tuple / name))
    return [name for name in ("fmi3GetVersion", "m_fmi3GetVersion") if hasattr(library, name)]


plain = functions("")
defined = functions('<PreprocessorDefinition name="FMI3_OVERRIDE_FUNCTION_PREFIX" value="1"/>')
print("fmpy", metadata.version("fmpy"))
print("functions of the compiled library: expected ['fmi3GetVersion'], observed", plain)
print("with the definition in buildDescription.xml:", defined)
assert plain == ["m_fmi3GetVersion"]
assert defined == ["fmi3GetVersion"]
PY
