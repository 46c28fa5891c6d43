"""By what a run's folder is known, for those who do not look into it."""

from __future__ import annotations

MANIFEST = "manifest.json"
