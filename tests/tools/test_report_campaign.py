"""A campaign that was flown ends with its report, and the report's command flies a run again."""

import json
import re
import shlex
import shutil

import pytest

from tests.tools.conftest import SHORT
from tests.tools.pages import Page
from tools.cli import main

pytestmark = pytest.mark.jit_only


@pytest.fixture
def folder(short_campaign, tmp_path):
    copy = tmp_path / "six flights"  # a name that a shell would take apart
    shutil.copytree(short_campaign.folder, copy)
    return copy


def arguments(folder) -> list[str]:
    """The command line that flew the campaign."""
    words = ["campaign", SHORT.mission, "--dispersions", SHORT.dispersions, "-n", str(SHORT.n)]
    words += ["--seed", str(SHORT.seed), "--law", SHORT.law, "--set", *SHORT.settings]
    return [*words, "--out", str(folder)]


def test_a_campaign_writes_its_report_unless_told_not_to(folder, capsys):
    assert main([*arguments(folder), "--no-report"]) == 0
    assert not (folder / "report.html").exists()
    assert main(arguments(folder)) == 0
    page = Page((folder / "report.html").read_text(encoding="utf-8"))
    (short,) = [row for row in page.tables["Outcome classes"] if row[0] == "short"]
    assert short[1] == "6"  # all were ended by the clock
    assert shlex.join(["aeroshell", *arguments(folder)]) in page.text.replace("&#39;", "'")
    capsys.readouterr()


def test_the_command_beside_a_worst_case_flies_it_again(folder, short_campaign, capsys):
    assert main(["report", str(folder)]) == 0
    page = Page((folder / "report.html").read_text(encoding="utf-8"))
    row = next(row for row in page.tables["Worst cases"] if row[0] == "heat load")
    assert row[1] == "least"
    loads = short_campaign.column("heat_load_mjpm2").tolist()
    run = loads.index(min(loads)) + 1
    command = shlex.split(row[6])
    assert command[-2:] == ["--run", str(run)]
    capsys.readouterr()
    again = [*command[1:], "--bus", "memory", "--no-record", "--json"]
    main([*again, "--out", str(folder / "again")])  # ended by the clock: status 1 or 0
    told = json.loads((folder / "again" / "summary.json").read_text())
    assert told["heat_load_mjpm2"] == min(loads)
    assert re.fullmatch(r"[0-9a-f]{64}", told["command_sha256"])
    assert told["command_sha256"] == short_campaign.results["command_sha256"][run - 1].as_py()
