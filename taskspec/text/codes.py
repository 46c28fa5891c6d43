"""Every stable diagnostic code, with a title in one line. A code is never given a new meaning."""

from __future__ import annotations

READING: dict[str, str] = {
    # The text and the shape of the file.
    "TS001": "the file is not readable as YAML",
    "TS002": "a character that task files may not contain",
    "TS003": "a tab",
    "TS004": "a key is given twice",
    "TS005": "an anchor or an alias",
    "TS006": "a merge key",
    "TS007": "a tag",
    "TS008": "more than one document",
    "TS009": "the file is too large or too deeply nested",
    "TS010": "the file holds no task",
    "TS011": "a key without a value",
    "TS012": "a comma that ends a value too early",
    "TS013": "no space after a colon",
    "TS014": "a key that is not a word",
    "TS015": "a number that is not finite",
    "TS016": "a text that a comment cuts short",
    "TS020": "an unknown key",
    "TS021": "a missing key",
    "TS022": "a value of the wrong kind",
    "TS023": "a list of the wrong length",
    "TS024": "an unknown version of the language",
    "TS025": "not one of the words that fit",
    "TS026": "keys that do not go together",
    "TS027": "an override of something that the task does not have",
    "TS090": "part of the language, but not supported yet",
    # Names, units, dimensions, the syntax of expressions.
    "TS101": "an expression that cannot be read",
    "TS102": "an expression that is too long or too deeply nested",
    "TS103": "`==` in an expression",
    "TS104": "chained comparisons",
    "TS105": "`and` and `or` mixed without parentheses",
    "TS110": "a number without its unit",
    "TS111": "an unknown unit",
    "TS112": "the wrong dimension",
    "TS113": "dimensions that do not go together",
    "TS114": "the wrong kind of value in an expression",
    "TS115": "the wrong number of arguments",
    "TS116": "a name that cannot be used here",
    "TS117": "a value that is not finite",
    "TS118": "a number out of its range",
    "TS119": "`for`, a reducer or an interval where it has no meaning",
    "TS120": "an unknown name in an expression",
    "TS121": "an unknown function",
    "TS122": "an unknown frame",
    "TS123": "an unknown object",
    "TS124": "an unknown stage",
    "TS125": "a name that cannot be given",
    "TS126": "a name given twice",
    "TS127": "params that define each other in a circle",
    "TS128": "something that cannot be held",
    "TS130": "a name that nothing uses",
    # Axes, laws, frames.
    "TS201": "an axis without a mode",
    "TS202": "two motions on one axis",
    "TS203": "a motion and a force on one axis",
    "TS204": "a key that does not belong to the axis's mode",
    "TS205": "a force on a rotation, or a torque on a translation",
    "TS206": "an unknown law",
    "TS207": "a gain that the law does not have",
    "TS208": "frames that are placed in each other in a circle",
    "TS209": "a frame that is both fixed and following",
    "TS210": "a damping of an axis under a law that damps no axis",
    "TS211": "set points of equations under a law without multipliers",
    "TS212": "a soft axis under a law that has none",
    "TS213": "a goal in the null space under a law that leaves it alone",
    # Contact and objects.
    "TS301": "a shape's size is missing",
    "TS302": "a size that the shape does not have",
    "TS310": "an equation that is no constraint",
    # Stages.
    "TS601": "a guard without a bound",
    "TS602": "a stage that nothing ends",
    "TS603": "a stage with two ends",
    "TS604": "a cycle of stages without `attempts`",
    "TS605": "a stage that is never reached",
    "TS606": "a path that is not one path",
    "TS607": "`path_done` in a stage without a path",
    # Expectations and variation.
    "TS710": "a variation of something that cannot vary",
    "TS711": "an interval whose ends are the wrong way round",
}
"""Codes of what reading a file finds, to their titles."""

CODES: dict[str, str] = dict(READING)
"""All codes, to their titles: TS0xx text and shape, TS1xx names, units and expressions, TS2xx axes,
laws and frames, TS3xx contact, TS4xx robots and reach, TS5xx stability, TS6xx stages, TS7xx
expectations. Other layers `register` theirs."""


def register(codes: dict[str, str]) -> None:
    """Add codes of another layer.

    Raises:
        ValueError: a code is already taken by another title.
    """
    for code, title in codes.items():
        if CODES.setdefault(code, title) != title:
            raise ValueError(f"diagnostic code {code} is already taken")
