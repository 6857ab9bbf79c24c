"""The command `critflow explore`, and what its page starts from."""

from pathlib import Path

from critflow.command.main import main
from critflow_extras.explore.source import File


def test_a_port_that_does_not_exist(capsys):
    assert main(["explore", "--port", "99999"]) == 2
    assert "65535" in capsys.readouterr().err


def test_two_tables(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("ends.csv").write_text("from;to\nA;D\nB;D\nC;D\n")
    Path("places.csv").write_text("id;x;y;fixed\nA;0;0;1\nB;4;0;1\nC;0;3;1\nD;1;1;0\n")
    for names in (("ends.csv", "places.csv"), ("places.csv", "ends.csv")):
        source = File(*map(Path, names))
        assert source.title == " and ".join(names) and source.open()[1].network.n_edges == 3
        assert f"network_from({names!r})" in source.lines(source.open()[1])[0]
