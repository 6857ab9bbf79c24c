"""Study files: found by name or path, loaded once, and refused in one sentence."""

from pathlib import Path

import pytest

from critflow.engine.code_digest import load_file, load_study, named_studies
from critflow.result import StudyError

STUDY = Path(__file__).with_name("plain_study.py").read_text()


def changed(old, new):
    assert STUDY.count(old) == 1
    return STUDY.replace(old, new)


FILES = {  # contents, and a word of the message
    "empty": ("", "study"),
    "wrong object": ("study = {'name': 'plain'}", "top level"),
    "a class": ("from critflow.engine import Study as study", "top level"),
    "not UTF-8": (b"study = 'caf\xe9'", "SyntaxError"),
    "UTF-16": (STUDY.encode("utf-16"), "loaded"),
    "zeros": (bytes(1000), "loaded"),
    "syntax error": ("def case(:", "SyntaxError"),
    "raises": ("x = 1\n1 / 0", "line 2"),
    "exits": ("import sys\nsys.exit(0)", "SystemExit"),
    "recursion": ("def f():\n    f()\nf()", "RecursionError"),
    "missing module": ("import no_such_module_at_all", "ModuleNotFoundError"),
    "import from outside": ("from ..elsewhere import x", "ImportError"),
    "circular import": ("from ._first import x", "circular"),
    "unknown key": (changed("    title=", "    titel="), "titel"),
    "missing key": (changed("    case=case,\n", ""), "case"),
    "case that is no function": (changed("case=case,", "case=3,"), "function"),
    "case without an axis": (changed("*, seed", "*, place"), "seed"),
    "case with one more argument": (changed("*, seed", "*, seed, size"), "size"),
    "version that is a word": (changed("    case=case,\n", "    case=case, version='2',\n"), "version"),
    "figure outside": (changed("    case=case,\n", "    case=case, figures={'../../up': case},\n"), "figure"),
    "needs of no figure": (changed("    case=case,\n", "    case=case, needs={'figur': ()},\n"), "figur"),
}


@pytest.mark.parametrize("mistake", FILES)
def test_a_malformed_study_file_is_refused(tmp_path, mistake):
    source, word = FILES[mistake]
    path = tmp_path / "bad.py"
    path.write_bytes(source.encode() if isinstance(source, str) else source)
    (tmp_path / "_first.py").write_text("from ._second import x\n")
    (tmp_path / "_second.py").write_text("from ._first import x\n")
    with pytest.raises(StudyError, match=word) as caught:
        load_study(str(path))
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize("word", ["nowhere.py", "folder", "/dev/zero", "", "../plain", "\udcff.py", "large.py"])
def test_a_path_that_is_no_study_file_is_refused(tmp_path, monkeypatch, word):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    with open(tmp_path / "large.py", "wb") as file:
        file.truncate(10**8)
    with pytest.raises(StudyError):
        load_study(word)


def test_studies_are_found_by_name_in_the_working_directory(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "workflows").mkdir()
    (tmp_path / "workflows" / "plain.py").write_text(STUDY)
    (tmp_path / "workflows" / "_part.py").write_text("")
    (tmp_path / "workflows" / "other.py").write_text(STUDY)
    assert "plain" in named_studies() and "_part" not in named_studies()
    assert load_study("plain").study.title == "Numbers that differ from case to case"
    with pytest.raises(StudyError, match="'plain'"):
        load_study("plian")
    with pytest.raises(StudyError, match="'other'"):
        load_study("other")  # the name in the file is another


def test_a_benchmark_that_a_wheel_does_not_contain_is_named_with_its_place(tmp_path, monkeypatch):
    """Outside a checkout of the source."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("critflow.engine.code_digest.named_studies", lambda: {})
    with pytest.raises(StudyError, match="checkout") as caught:
        load_study("speed")
    assert "\n" not in str(caught.value)


def test_a_file_is_executed_once_for_each_content(tmp_path):
    path = tmp_path / "plain.py"
    path.write_text(STUDY)
    first = load_file(path)
    assert load_file(path).study is first.study  # caches in a study persist from task to task
    path.write_text(changed("Numbers that differ from case to case", "Another"))
    assert load_file(path).study.title == "Another"
    path.write_bytes(b"\xef\xbb\xbf" + STUDY.encode())  # a byte-order mark
    assert load_file(path).study.name == "plain"
