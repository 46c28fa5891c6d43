"""What was found about a file before, as the commands use it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from taskspec.kept_findings import KeptFindings, findings_key, keep_findings, known_findings
from taskspec_runner.cli.given import STDIN

if TYPE_CHECKING:
    from taskspec.examined import Examination

#: What is found follows from the runner as well: a trial is run by it.
_RUNNER = Path(__file__).parents[1]


class Before:
    """What was found about a file the last time, as long as it stays as it is now."""

    def __init__(
        self,
        path: Path,
        sets: Sequence[str],
        law: str | None,
        *,
        static: bool = False,
        keeps: bool = True,
    ) -> None:
        """Of a file with its overrides; where nothing is to be kept, nothing is known either."""
        options = (*sets, law or "", "static" if static else "")
        self._ask = partial(findings_key, path, options, (_RUNNER,))
        self._key = self._ask() if keeps and path != STDIN else None

    def found(self) -> KeptFindings | None:
        """What was found; None where the file, or what it names, is another than then."""
        return None if self._key is None else known_findings(self._key)

    @property
    def stays(self) -> bool:
        """Whether the file has not changed meanwhile."""
        return self._key is not None and self._ask() == self._key

    def keep(self, examined: Examination) -> None:
        """Keeps what is found now, unless the file has changed while it was read."""
        if self._key is not None and self.stays:
            keep_findings(self._key, examined)
