"""The files of a run's folder, for those who do not look into it."""

from __future__ import annotations

MANIFEST = "manifest.json"
TASK, LOG = "task.yaml", "log.arrow"
#: The ticks of the batch that is not full yet; gone when the log is whole.
BLOCK = "log.block"
SUMMARY, REPORT, CRASH = "summary.json", "report.html", "crash.txt"
#: What `export` puts beside them.
EXPORTS = ("log.csv", "log.parquet", "log.mcap", "log.rrd")
