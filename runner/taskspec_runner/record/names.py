"""The files of the folders of runs, comparisons and sweeps, for those who do not look into them."""

from __future__ import annotations

from pathlib import Path

MANIFEST = "manifest.json"
TASK, LOG = "task.yaml", "log.arrow"
#: The ticks of the batch that is not full yet; gone when the log is whole.
BLOCK = "log.block"
SUMMARY, REPORT, CRASH = "summary.json", "report.html", "crash.txt"
#: What `export` puts beside them.
EXPORTS = ("log.csv", "log.parquet", "log.mcap", "log.foxglove.json", "log.rrd")
#: What is said of all laws of a comparison.
COMPARISON = "compare.json"
#: Of a sweep: what is said of it, a row a world as they come, and all of them as a table.
SWEEP, JOURNAL, TABLE = "sweep.json", "worlds.jsonl", "worlds.parquet"
#: Each of them says of what its folder is.
_MARKERS = (MANIFEST, COMPARISON, SWEEP)


def has_results(folder: Path) -> bool:
    """Whether it is a folder of a run, a comparison or a sweep, whose files are copies."""
    return any((folder / name).is_file() for name in _MARKERS)
