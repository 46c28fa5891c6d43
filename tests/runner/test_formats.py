"""`taskspec validate` in forms that other programs read, and the choice of findings."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import jsonschema
import pytest
from short_tasks import TAP
from typer.testing import CliRunner, Result

from taskspec.text.codes import CODES
from taskspec.text.diagnostic import Diagnostic, Note, Severity
from taskspec.text.source import Source, Span
from taskspec_runner.cli import app
from taskspec_runner.cli.codes import choice
from taskspec_runner.cli.formats import DiagnosticFormat
from taskspec_runner.cli.reporters import REPORTERS
from taskspec_runner.cli.validation import Failure, Validation
from taskspec_runner.errors import InputError

SCHEMA = json.loads((Path(__file__).parent / "schemas" / "sarif-2.1.0-rtm.5.json").read_text())
FORMS = [form.value for form in DiagnosticFormat]
MACHINES = ["json", "github", "sarif", "junit"]
TWICE = TAP + "name: again\n"
WARNED = TAP.replace("time: 0.3 s", "time: 0.3 s\n    limits: {force: 4 N}")


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("GITHUB_WORKSPACE", raising=False)
    return tmp_path


def validate(*args: str | Path) -> Result:
    result = CliRunner().invoke(app, ["validate", *map(str, args)])
    assert "Traceback" not in result.output
    return result


def told(form: str, found: Validation) -> str:
    return REPORTERS[DiagnosticFormat(form)].report(found)


def finding(severity: Severity = Severity.ERROR, **changes: Any) -> Diagnostic:
    given = {
        "code": "TS203",
        "severity": severity,
        "message": "100 % wrong: x, y",
        "source": "a,b:c.yaml",
        "span": Span(2, 3, 2, 6),
        "hint": "first\nsecond",
        "notes": (Note("here", "a,b:c.yaml", Span(1, 1, 1, 2)),),
    }
    return Diagnostic(**(given | changes))  # type: ignore[arg-type]


def found(*diagnostics: Diagnostic, strict: bool = False, **failures: Any) -> Validation:
    name = "a,b:c.yaml"
    source = Source(name, "x: 1\ny: {}\n")
    return Validation(
        (name,), {name: diagnostics}, {name: {name: source}}, strict=strict, **failures
    )


def folder_of_everything(here: Path) -> None:
    (here / "a good.yaml").write_text(TAP)
    (here / "b.yaml").write_text(TWICE)
    (here / "c.yaml").write_text("")
    (here / "d.yaml").write_bytes("name: größe".encode("latin-1"))


@pytest.mark.parametrize("form", FORMS)
def test_every_form_tells_every_file_in_one_pass_and_always_the_same(form: str, here: Path) -> None:
    folder_of_everything(here)
    result = validate(".", "--format", form)
    assert result.exit_code == 2
    assert "TS004" in result.stdout
    assert "TS010" in result.stdout, "a finding without a place"
    assert "d.yaml: it is not UTF-8" in result.stderr
    summary = "2 errors in 2 of 4 files, 1 unreadable\n"
    assert (result.stderr if form in MACHINES else result.stdout).endswith(summary)
    assert form not in MACHINES or summary not in result.stdout
    assert "\x1b" not in result.output
    again = validate(".", "--format", form)
    assert (again.stdout, again.stderr) == (result.stdout, result.stderr)


@pytest.mark.parametrize("form", FORMS)
def test_nothing_to_tell(form: str, tap: Path) -> None:
    result = validate(tap, "--format", form)
    assert result.exit_code == 0
    assert "TS" not in result.stdout.replace("TESTS", "")
    chrome = result.stderr if form in MACHINES else result.stdout
    assert chrome == "no errors in 1 file\n"


# github


def test_github_escapes_what_its_commands_are_made_of() -> None:
    assert told("github", found(finding())) == (
        "::error file=a%2Cb%3Ac.yaml,line=2,col=3,endColumn=6,title=TS203::"
        "100 %25 wrong: x, y%0Afirst%0Asecond%0Ahere: line 1"
    )


@pytest.mark.parametrize(
    ("diagnostic", "begins"),
    [
        (finding(Severity.WARNING), "::warning file="),
        (finding(Severity.INFO), "::notice file="),
        (finding(span=None), "::error file=a%2Cb%3Ac.yaml,title=TS203::"),
        (finding(span=Span(1, 2, 2, 1)), "::error file=a%2Cb%3Ac.yaml,line=1,endLine=2,title="),
    ],
)
def test_github_commands(diagnostic: Diagnostic, begins: str) -> None:
    assert told("github", found(diagnostic)).startswith(begins)


def test_a_file_cannot_give_github_commands_of_its_own(here: Path) -> None:
    (here / "evil.yaml").write_text('"\\r\\n::error::mine": 1\n' + TAP)
    result = validate("evil.yaml", "--format", "github")
    assert result.exit_code == 2
    for line in result.stdout.splitlines():
        assert line.startswith("::error file=evil.yaml,line=1,")


def test_github_names_files_as_its_workspace_does(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (here / "sub").mkdir()
    (here / "sub" / "b.yaml").write_text(TWICE)
    monkeypatch.chdir(here / "sub")
    monkeypatch.setenv("GITHUB_WORKSPACE", str(here))
    for path in ("b.yaml", here / "sub" / "b.yaml"):
        assert "::error file=sub/b.yaml,line=" in validate(path, "--format", "github").stdout


# sarif


def sarif_of(text: str) -> dict[str, Any]:
    log = json.loads(text)
    jsonschema.Draft4Validator(SCHEMA).validate(log)
    (run,) = log["runs"]
    return dict(run)


def test_the_schema_of_sarif_can_say_no() -> None:
    log = json.loads(told("sarif", found(finding())))
    log["runs"][0]["results"][0]["locations"][0]["physicalLocation"]["region"]["startLine"] = 0
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.Draft4Validator(SCHEMA).validate(log)


def test_sarif_of_every_kind_of_file(here: Path) -> None:
    folder_of_everything(here)
    run = sarif_of(validate(".", "--format", "sarif").stdout)
    rules = run["tool"]["driver"]["rules"]
    assert [rule["id"] for rule in rules] == ["TS004", "TS010"]
    assert rules[0]["shortDescription"]["text"] == CODES["TS004"]
    assert rules[0]["name"] == "AKeyIsGivenTwice"
    assert rules[0]["help"]["markdown"].startswith("# TS004: ")
    twice, empty = run["results"]
    assert (twice["ruleId"], twice["ruleIndex"], twice["level"]) == ("TS004", 0, "error")
    place = twice["locations"][0]["physicalLocation"]
    assert place["artifactLocation"] == {"uri": "b.yaml", "uriBaseId": "%SRCROOT%"}
    line = TWICE.count("\n")
    region = {"startLine": line, "startColumn": 1, "endLine": line, "endColumn": 5}
    assert place["region"] == region
    assert len(twice["relatedLocations"]) == 1
    assert "region" not in empty["locations"][0]["physicalLocation"]
    (invocation,) = run["invocations"]
    assert (invocation["executionSuccessful"], invocation["exitCode"]) == (False, 2)
    (notification,) = invocation["toolExecutionNotifications"]
    assert "d.yaml" in notification["message"]["text"]


def test_sarif_fingerprints_stay_when_lines_come_and_go(here: Path) -> None:
    marks = []
    for comment in ("", "# a\n# b\n"):
        (here / "b.yaml").write_text(comment + TWICE + "name: again\n")
        run = sarif_of(validate("b.yaml", "--format", "sarif").stdout)
        marks.append([result["partialFingerprints"] for result in run["results"]])
    first, second = marks
    assert first == second
    assert first[0] != first[1], "two findings in lines that read the same are two"


def test_sarif_names_files_elsewhere(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (here / "inner").mkdir()
    (here / "ä b%.yaml").write_text(TWICE)
    monkeypatch.chdir(here / "inner")
    run = sarif_of(validate("../ä b%.yaml", "--format", "sarif").stdout)
    artifact = run["results"][0]["locations"][0]["physicalLocation"]["artifactLocation"]
    assert artifact["uri"].startswith("file:///")
    assert artifact["uri"].endswith("/%C3%A4%20b%25.yaml")
    assert "uriBaseId" not in artifact


@pytest.mark.parametrize("severity", list(Severity))
def test_sarif_levels(severity: Severity) -> None:
    run = sarif_of(told("sarif", found(finding(severity))))
    level = {"error": "error", "warning": "warning", "info": "note"}[severity]
    assert run["results"][0]["level"] == level
    assert run["tool"]["driver"]["rules"][0]["defaultConfiguration"]["level"] == "error", "by page"


def test_sarif_of_a_code_without_a_page(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("taskspec_runner.cli.reporters.sarif.page", lambda _: None)
    found_ = found(finding(Severity.INFO), finding(Severity.WARNING))
    (rule,) = sarif_of(told("sarif", found_))["tool"]["driver"]["rules"]
    assert rule["defaultConfiguration"]["level"] == "warning"
    assert rule["help"] == {"text": "taskspec explain TS203"}


def test_sarif_of_an_internal_error() -> None:
    failed = found(finding(), broken=(Failure("a,b:c.yaml", "internal error"),))
    run = sarif_of(told("sarif", failed))
    assert run["invocations"][0]["exitCode"] == 3


# junit


def test_junit_of_every_kind_of_file(here: Path) -> None:
    folder_of_everything(here)
    root = ET.fromstring(validate(".", "--format", "junit").stdout)
    assert dict(root.attrib) == {
        "name": "taskspec validate", "tests": "4", "failures": "2", "errors": "1", "skipped": "0",
    }  # fmt: skip
    good, twice, empty, unread = root
    assert [s.attrib["name"] for s in root] == ["a good.yaml", "b.yaml", "c.yaml", "d.yaml"]
    assert [len(case) for case in good] == [0]
    assert twice[0].attrib["name"] == f"TS004:{TWICE.count(chr(10))}:1"
    failure = twice[0][0]
    assert (failure.tag, failure.attrib["type"]) == ("failure", "TS004")
    assert "^" in (failure.text or "")
    assert empty[0].attrib["name"] == "TS010"
    assert unread[0][0].tag == "error"
    for suite in root:
        assert suite.attrib["tests"] == "1"


def test_junit_holds_what_xml_cannot() -> None:
    name = "<&\x01\udc80>.yaml"
    bad = finding(message="a\x00b <c>", source=name, hint="\ud800")
    given = Validation((name,), {name: (bad,)}, {name: {name: Source(name, "\x02\n\x03 ]]>\n")}})
    root = ET.fromstring(told("junit", given))
    failure = root[0][0][0]
    assert failure.attrib["message"] == r"a\x00b <c>"
    assert root[0].attrib["name"] == r"<&\x01\udc80>.yaml"


def test_junit_warnings_fail_only_if_strict() -> None:
    for strict in (False, True):
        root = ET.fromstring(told("junit", found(finding(Severity.WARNING), strict=strict)))
        assert root[0][0][0].tag == ("failure" if strict else "system-out")
        assert root.attrib["failures"] == str(int(strict))


# strict, select, ignore


def test_strict_lets_warnings_fail(here: Path) -> None:
    (here / "w.yaml").write_text(WARNED)
    plain = validate("w.yaml", "--format", "concise")
    assert "warning[TS610]" in plain.stdout
    assert plain.exit_code == 0
    strict = validate("w.yaml", "--format", "concise", "--strict")
    assert (strict.exit_code, strict.stdout) == (2, plain.stdout)
    assert validate("w.yaml", "--strict", "--ignore", "TS610,TS616").exit_code == 0
    assert "::warning" in validate("w.yaml", "--format", "github").stdout
    assert "::error" in validate("w.yaml", "--format", "github", "--strict").stdout


@pytest.mark.parametrize(
    ("options", "codes", "exit_code"),
    [
        ([], ["TS004", "TS020"], 2),
        (["--select", "TS02"], ["TS020"], 2),
        (["--select", "ts004,TS3"], ["TS004"], 2),
        (["--select", "TS004", "--select", "TS020"], ["TS004", "TS020"], 2),
        (["--select", "TS3"], [], 0),
        (["--ignore", "TS004"], ["TS020"], 2),
        (["--ignore", "TS0"], [], 0),
        (["--ignore", "TS0", "--select", "TS004"], ["TS004"], 2),
        (["--select", "TS0", "--ignore", "TS004"], ["TS020"], 2),
        (["--select", "TS0", "--ignore", "TS0"], [], 0),
    ],
)
def test_select_and_ignore(
    options: list[str], codes: list[str], exit_code: int, here: Path
) -> None:
    (here / "b.yaml").write_text(TWICE + "nmae: x\n")
    result = validate("b.yaml", "--format", "json", *options)
    data = json.loads(result.stdout)
    assert sorted(d["code"] for d in data["diagnostics"]) == codes
    assert result.exit_code == data["exit_code"] == exit_code


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--select", "TS302,TS20x"], "--select: no code begins with 'TS20X'; there are TS201, TS"),
        (["--ignore", "TS999"], "--ignore: no code begins with 'TS999'; codes begin with TS0, TS1"),
        (["--ignore", ""], "--ignore: no code begins with ''; codes begin with TS0"),
    ],
)
def test_an_unknown_prefix_is_wrong_usage(options: list[str], said: str, tap: Path) -> None:
    result = validate(tap, *options)
    assert (result.exit_code, result.stdout) == (2, "")
    assert said in result.stderr


def test_codes_of_later_layers_can_be_chosen() -> None:
    """TS4xx are registered by the robots, TS420 by the compiler."""
    assert choice(["TS401", "TS420"], [])("TS420")
    with pytest.raises(InputError):
        choice(["TS4444"], [])


# colours


class Terminal:
    """A standard output that says it is a terminal."""

    def __init__(self) -> None:
        self.text = ""

    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("no_color", ["", "1"])
def test_colours_only_for_people_at_a_terminal(
    form: str, no_color: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdout", Terminal())
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("NO_COLOR", no_color)
    colored = "\x1b[" in told(form, found(finding()))
    assert colored == (form in ("full", "concise") and not no_color)


@pytest.mark.parametrize("name", ["FORCE_COLOR", "CLICOLOR_FORCE"])
@pytest.mark.parametrize(("value", "no_color"), [("1", ""), ("0", ""), ("", ""), ("1", "1")])
def test_colours_where_the_environment_asks_for_them(
    name: str, value: str, no_color: str, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (here / "tap.yaml").write_text(WARNED)
    monkeypatch.setenv(name, value)
    monkeypatch.setenv("NO_COLOR", no_color)
    output = validate("tap.yaml").output
    assert "warning" in output
    assert ("\x1b[" in output) == (value == "1" and not no_color)


def test_every_form_has_a_reporter_and_is_named_in_the_help(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert set(REPORTERS) == set(DiagnosticFormat)
    monkeypatch.setenv("COLUMNS", "200")
    help_ = re.sub(r"\x1b\[[0-9;]*m", "", validate("--help").stdout)
    assert "|".join(FORMS) in help_


def test_a_folder_that_cannot_be_listed(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(_: Path) -> Callable[[], None]:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "iterdir", refused)
    result = validate(here)
    assert result.exit_code == 2
    assert "Permission denied" in result.stderr
