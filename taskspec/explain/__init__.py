"""What a plan tells of its stages in closed form: their constraints, and forces at rest."""

from taskspec.explain.beside import Described, beside
from taskspec.explain.natural import Natural, natural
from taskspec.explain.reactions import State
from taskspec.explain.rest import RestValue, rest_values
from taskspec.explain.selection import Selection, selection

__all__ = [
    "Described",
    "Natural",
    "RestValue",
    "Selection",
    "State",
    "beside",
    "natural",
    "rest_values",
    "selection",
]
