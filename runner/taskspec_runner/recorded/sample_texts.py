"""A column of texts, of which there are few: each once, and its number in every sample."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec_runner.errors import InputError
from taskspec_runner.record.mapped import GrowingColumns

#: Texts beyond which a column is not that of a name.
_MOST_TEXTS = 10_000


@dataclass(frozen=True, slots=True)
class SampleTexts:
    """Texts of samples.

    Attributes:
        names: each text once, in the order of their first samples.
        codes: (n,) number of each sample's text among the names.
    """

    names: tuple[str, ...]
    codes: NDArray[np.int64]

    def first(self, code: int) -> int:
        """The first sample with a text."""
        return int(np.argmax(self.codes == code))

    def ordered(self, order: NDArray[np.int64]) -> SampleTexts:
        """The same of the samples in another order (n,)."""
        return SampleTexts(self.names, np.asarray(self.codes)[order])


class SampleTextsBuilder:
    """Texts as they come."""

    def __init__(self) -> None:
        self._codes: dict[str, int] = {}
        self._columns = GrowingColumns()

    def add(self, texts: Sequence[str]) -> None:
        """Takes the texts of some more samples."""
        once = {text: code for code, text in enumerate(dict.fromkeys(texts))}
        self.add_coded([*once], np.array([once[text] for text in texts], dtype=np.int64))

    def add_coded(self, texts: Sequence[str], codes: NDArray[np.int64]) -> None:
        """Takes the texts of some more samples: each once, and its number in every sample (n,)."""
        if len(self._codes) > _MOST_TEXTS:
            return
        known = self._codes
        own = np.array([known.setdefault(text, len(known)) for text in texts], dtype=float)
        self._columns.add({"codes": own[codes]})

    def words(self, what: str) -> SampleTexts:
        """All of them, once.

        Args:
            what: has the texts, for the message.

        Raises:
            InputError: there are too many different ones.
        """
        if len(self._codes) > _MOST_TEXTS:
            raise InputError(
                f"{what} has more than {_MOST_TEXTS} different texts, so it names no stages"
            )
        codes = self._columns.build().get("codes", np.zeros(0)).astype(np.int64)
        return SampleTexts(tuple(self._codes), codes)
