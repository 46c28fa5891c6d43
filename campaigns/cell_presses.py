"""Presses on a cell that others have recorded, as the CSV files of `docs/how-to/cell`.

The source distribution of afmformats 0.18.7 (MIT, Copyright (c) 2019 Paul Müller) has them in
`examples/data/10.1002_btm2.10294_fig5d-cell1.zip`: 15 stress relaxations of one cell by a JPK
CellHesion, of figure 5d of Battistella et al. 2022, doi 10.1002/btm2.10294. In each the cantilever
goes down by 20 um in 1 s, which is the part taken here, and holds for 30 s.

Of a file's readings 20 in a row are averaged, which leaves 102 a second. The place of the tip is
measured height and the cantilever's deflection together; the force is that of the deflection, less
its median over the last quarter of a second before the press.

    make cell-presses
"""

from __future__ import annotations

import sys
import tempfile
import zipfile
from pathlib import Path

import afmformats
import numpy as np

OUT = Path(__file__).resolve().parents[1] / "docs" / "how-to" / "cell"
ZIP = "examples/data/10.1002_btm2.10294_fig5d-cell1.zip"
#: Readings that make a row; those before the press whose median is no force.
AVERAGED, RESTING = 20, 64
#: Numbers of a file's segments.
REST, PRESS = 0, 1


def press(path: Path) -> str:
    """One press as a CSV file."""
    (curve,) = afmformats.load_data(path)
    spring = curve.metadata["spring constant"]  # N/m, which is nN/nm
    segment = np.array(curve["segment"])
    force, height = 1e9 * np.array(curve["force"]), 1e6 * np.array(curve["height (measured)"])
    force -= np.median(force[segment == REST][-RESTING:])
    rows = np.flatnonzero(segment == PRESS)
    rows = rows[: len(rows) // AVERAGED * AVERAGED].reshape(-1, AVERAGED)
    time = np.array(curve["time"])[rows].mean(axis=1)
    tip = (height + np.array(curve["force"]) * 1e6 / spring)[rows].mean(axis=1)
    lines = ["time [s],tip [um],force [nN]"]
    for t, x, f in zip(time - time[0], tip, force[rows].mean(axis=1), strict=True):
        lines.append(f"{t:.5f},{x:.4f},{f:.2f}")
    return "\n".join(lines) + "\n"


def main(source: Path) -> None:
    """Writes them.

    Args:
        source: folder of the unpacked source distribution.
    """
    with tempfile.TemporaryDirectory() as folder, zipfile.ZipFile(source / ZIP) as packed:
        packed.extractall(folder)
        files = sorted(Path(folder).glob("*.jpk-force"))
        assert len(files) == 15
        for number, path in enumerate(files, 1):
            (OUT / f"press-{number:02d}.csv").write_text(press(path), encoding="utf-8")
    licence = (source / "LICENSE").read_text(encoding="utf-8")
    (OUT / "LICENSE").write_text(licence, encoding="utf-8")
    sys.stdout.write(f"{len(files)} presses in {OUT}\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
