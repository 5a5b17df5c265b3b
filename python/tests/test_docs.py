"""The code of docs/python.md runs, and prints what the page says."""

import re

from conftest import ROOT


def test_the_code_of_the_page_runs_and_prints_what_the_page_says(tmp_path, monkeypatch, capsys):
    page = (ROOT / "docs" / "python.md").read_text()
    blocks = re.findall(r"```(python|text)\n(.*?)```", page, flags=re.DOTALL)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    names = {}
    ran = compared = 0
    for kind, block in blocks:
        if kind == "python":
            exec(compile(block, "docs/python.md", "exec"), names)
            printed = capsys.readouterr().out
            ran += 1
        else:
            assert printed == block
            compared += 1
    assert (ran, compared) == (4, 1)
