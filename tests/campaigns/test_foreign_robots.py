"""The campaign over foreign robots tells good ones from those that cannot be loaded."""

from __future__ import annotations

import foreign_robots

GOOD = """
a-package==1.0:
  root: data
  robots:
    urdf: {file: own.urdf, flange: palm}
    mjcf: {file: own.xml, flange: grip}
"""


def test_listed_robots_are_held_against_pinocchio(monkeypatch, tmp_path, capsys):
    listed = tmp_path / "robots.yaml"
    monkeypatch.setattr(foreign_robots, "LIST", listed)
    listed.write_text(GOOD, "utf-8")
    folder = foreign_robots.ROOT / "tests" / "robot"
    assert foreign_robots.main(["--packages", str(folder)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == ["robot", "urdf", "mjcf"]
    listed.write_text(GOOD + "    gone: {file: gone.urdf}\n", "utf-8")
    assert foreign_robots.main(["--packages", str(folder)]) == 1
    assert "gone         TS4" in capsys.readouterr().out


def test_packages_are_named_for_pip(capsys):
    assert foreign_robots.main(["--names"]) == 0
    names = capsys.readouterr().out.split()
    assert all("==" in name for name in names)
    listed = foreign_robots.packages()
    assert sum(len(listed[name]["robots"]) for name in names) >= 20
