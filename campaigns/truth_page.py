"""The page of `make truth`: what was promised, who said what, and every disagreement."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from truth_measured import ELSEWHERE, NOT_SEEN, SEEN

if TYPE_CHECKING:
    from truth import Judged

#: So much of a message is shown at most [characters].
MOST_OF_A_MESSAGE = 160

PREFACE = """\
# Predictions and outcomes

`taskspec validate` says of a file what its run will do. This page holds what it says against runs
of random files. `make truth` makes it.

**The files** come from two generators. [`workshop`](#workshop) has grown with the rules: what its
files showed was put right. [`language`](#language) is written from
[the language](language/README.md) alone and reads nothing of the rules, so that none of them was
fitted to its files. A file is its
seed and its number: `python campaigns/truth_tasks.py SEED NUMBER` and
`python campaigns/language_tasks.py SEED NUMBER` print it.

**The runs.** Each file is validated and run; one that is refused is run in spite of it, if it
compiles. A run is good if it comes to its end, meets its expectations, and neither oscillates nor
saturates. A refused file whose run is good is run again, the stage that is accused ten times as
long, with and without a small push (5 mrad/s on each joint): it is bad if it does not end well
then, or if the difference grows. It is left out if nothing speaks against the file once its
contacts are 4 % softer, or the gains that it gives 4 % lower or higher: errors begin 2 % inside
the boundary, and 2 % beyond it are left out too. So is one whose errors all say that the stage
is on the boundary of stability.

**Announced** is a bad run if there was an error or warning whose code announces its end; which code
announces which is in `campaigns/announcements.yaml`.

**The trial.** `validate` runs each file that no error refuses once, as `run` does: see
[the language](language/trial.md). A refused file counts as announced by its errors.

**Disagreements.** Of a bad run that was not announced a table has why, where it was traced, else
how it ended; of a good run that was warned of, each warning, and what the run did of it, measured
in its log by `campaigns/truth_measured.py`. *Seen* is what came to the size that was told, or to
90 % of the bound that it is near to: the warning is true, and the run ends well all the same. *Not
seen in the run* is a false alarm about this run. *Of what the run does not show* is a warning about
another world, or about what a run has no measure of.
"""
#: What the files of each generator are.
FILES = {
    "workshop": """\
Every robot, law, shape and mechanism; tools that go into holes, slots and grooves,
buttons that are pushed, frames that track a force or a motion; sensors with noise, delay and
filters; 250 Hz to 2 kHz; `solve: qp`; given and designed gains; contacts of 1 to 300 kN/m,
uniform in the logarithm; templates, included files, repeats, limits that lead to a stage, ways
home by the joints. Each is what an engineer may write, a quarter of them with one slip: a gain
that is too high, a motion that is too fast or too far, a limit that is too low, too little time,
a guard on a force that does not come, a sensor that is late.
""",
    "language": """\
Thirteen scenes with round numbers, as different users write them: presses and strokes on planes
that lean, boxes, pipes and domes; planar arms; moves in the air; mechanisms that are held or
pushed; equations; insertion; compliance; probing in loops; contours; loose bodies; things that
move; corners. Beside them habits: gains, sensors, faults, templates, programs, worlds that vary or
are otherwise in truth. A third has one typical mistake: a wrong sign or unit, too fast, too strong,
too far, too little time, a guard that never holds, a limit that is too low, a gain that is too
high, an arm in another place, a world that is otherwise, an expectation that nothing meets, a
payload or a noise that is too large, what breaks on the way, a slip of the pen.
""",
}
#: Of a seed whose disagreements were looked into.
TRACED = (
    "The causes of disagreements were traced on this seed, rules were mended by them, and the rows",
    "of files that a change concerns were made anew: its shares flatter. A seed that nobody has",
    "looked at tells what other files are to expect.",
    "",
)
SEVERITIES = ("silent", "warning", "error")


def listed(rows: Sequence[Judged], reasons: Mapping[int, str]) -> Iterator[str]:
    """A line for each disagreement, for a terminal."""
    for row in rows:
        if row.disagreement:
            said = ", ".join(row.codes) or "-"
            why = f" | {reasons[row.number]}" if row.number in reasons else ""
            where = f" in {row.row['stage']}" if row.row["stage"] else ""
            yield (
                f"{row.number:5} {row.disagreement:13} {row.row['end']}{where} | {said} | "
                f"{row.row['law']}, {row.row['scene']} {row.row['slip']} | "
                f"{row.row['text'][:150]}{why}"
            )


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> list[str]:
    lines = [head, ["---"] * len(head), *rows]
    return ["| " + " | ".join(map(str, line)) + " |" for line in lines]


def page(seed: int, judged: Mapping[str, Sequence[Judged]]) -> str:
    """The text of docs/truth.md: what is promised, and a part for each generator."""
    from truth import explanations

    parts = [
        part
        for name, rows in judged.items()
        for part in section(name, seed, rows, explanations(name, seed))
    ]
    return "\n".join([PREFACE, *parts]).rstrip("\n") + "\n"


def section(
    generator: str, seed: int, rows: Sequence[Judged], reasons: Mapping[int, str]
) -> list[str]:
    """What came of the files of a generator, line by line."""
    from truth import shares

    made = "; ".join(Counter(str(row.row.get("sources", "")) for row in rows))
    ran = [row for row in rows if row.ran]
    cpu = sum(row.row["looked"] for row in rows) / max(len(rows), 1)
    return [
        f"## {generator.capitalize()}",
        "",
        FILES[generator],
        f"Seed {seed}, {len(rows)} files, {len(ran)} of them run; taskspec {made}",
        "(`python campaigns/truth.py --sources` says that of a tree);",
        f"{cpu:.2f} s of processor time to validate one.",
        "",
        *(TRACED if reasons else ()),
        *table(
            ("what", "count", "of", "share", "promised"),
            (
                (
                    share.title,
                    share.count,
                    share.total,
                    f"{share.value:.1%}",
                    f"{'at most' if share.most else 'at least'} {share.bound:.0%}",
                )
                for share in shares(rows)
            ),
        ),
        "",
        f"### {generator.capitalize()}: what was said, and how the runs ended",
        "",
        *by_end(ran, SEVERITIES, lambda row: (row.severity,)),
        "",
        f"### {generator.capitalize()}: by code",
        "",
        "A run counts once for each code that was found in its file.",
        "",
        *by_end(ran, sorted({c for row in ran for c in row.codes}), lambda row: row.codes),
        "",
        f"### {generator.capitalize()}: by law",
        "",
        *by_law(rows),
        "",
        f"### {generator.capitalize()}: disagreements",
        "",
        *disagreements(rows, reasons),
        "",
    ]


def _end(row: Judged) -> str:
    """How a run ended, as a column of the matrix."""
    end = str(row.row["end"])
    return f"well, then {row.row['grew']}" if row.row["grew"] and end == "well" else end


def by_end(rows: Sequence[Judged], names: Sequence[str], of) -> list[str]:  # type: ignore[no-untyped-def]
    """A matrix of what was said by how the run ended."""
    ends = [end for end, _ in Counter(map(_end, rows)).most_common()]
    counts = Counter((name, _end(row)) for row in rows for name in of(row))
    lines = []
    for name in names:
        line = [counts[name, end] for end in ends]
        lines.append((name, *(n or "" for n in line), sum(line)))
    return table(("said", *ends, "all"), lines)


def by_law(rows: Sequence[Judged]) -> list[str]:
    """The promises by law."""
    from truth import shares

    laws = sorted({str(row.row["law"]) for row in rows if row.row["law"]})
    lines = []
    for law in laws:
        of = [row for row in rows if row.row["law"] == law]
        found = [f"{share.count} of {share.total}" for share in shares(of)]
        lines.append((law, len(of), *found))
    head = [share.title for share in shares([])]
    return table(("law", "files", *head), lines)


def disagreements(rows: Sequence[Judged], reasons: Mapping[int, str]) -> list[str]:
    """Every file where what was said is not what was done: how many of which kind, and a table."""
    apart = [row for row in rows if row.disagreement]
    lines = [
        (
            row.number,
            row.disagreement,
            _end(row) + (f" in {row.row['stage']}" if row.row["stage"] else ""),
            ", ".join(row.codes) or "-",
            f"{row.row['law']}, {row.row['scene']}"
            + (f", {row.row['slip']}" if row.row["slip"] else ""),
            (reasons.get(row.number) or "<br>".join(told(row))).replace("|", "/"),
        )
        for row in apart
    ]
    head = ("file", "kind", "end", "said", "what it is", "what was told, and what the run did")
    return [*_how_many(apart), "", *table(head, lines)]


def _how_many(apart: Sequence[Judged]) -> list[str]:
    """Of good runs that were warned of, by code, what the runs did of it."""
    words = (SEEN, NOT_SEEN, ELSEWHERE, "")
    counts: Counter[tuple[str, str]] = Counter()
    for row in apart:
        if row.disagreement == "warned":
            found = {each["code"]: _word(each) for each in _warnings(row)}
            counts.update(found.items())
    codes = sorted({code for code, _ in counts})
    lines = [(code, *(counts[code, word] or "" for word in words)) for code in codes]
    return table(("warned of, and well", *words[:3], "not measured"), lines)


def _warnings(row: Judged) -> list[Mapping[str, str]]:
    return [each for each in row.row["said"] if each["severity"] != "info"]


def _word(said: Mapping[str, str]) -> str:
    return said.get("measured", "").split(":")[0]


def told(row: Judged) -> Iterator[str]:
    """What was told of a file, and what its run did of it; of a bad run how it ended."""
    if row.disagreement != "warned":
        yield str(row.row["text"])
        return
    for each in _warnings(row):
        message = each["text"].partition(": ")[2]
        yield f"{each['code']}: {_cut(message)} - {each.get('measured') or 'not measured'}"


def _cut(message: str) -> str:
    """The beginning of a message, to the end of a word."""
    if len(message) <= MOST_OF_A_MESSAGE:
        return message
    return message[:MOST_OF_A_MESSAGE].rsplit(" ", 1)[0] + " ..."
