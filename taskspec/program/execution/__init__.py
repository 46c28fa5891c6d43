"""The machine that strings the stages together, tick by tick."""
