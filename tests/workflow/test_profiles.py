"""Profiles: what a TOML file may say of a cluster, and what is refused in one sentence."""

from pathlib import Path

import pytest

from critflow.result import InputError
from critflow.workflow.profiles import choose_cluster, read_profile

EXAMPLE = Path(__file__).parents[2] / "workflows" / "profiles.toml"


@pytest.fixture
def profiles(tmp_path):
    """`profiles(text)` is a file of profiles with this text."""

    def write(text):
        path = tmp_path / "profiles.toml"
        path.write_text(text)
        return path

    return write


def test_a_batch_system_gets_its_keys(profiles):
    file = profiles('[hall]\nsystem = "slurm"\njobs = 4\nworkers = 32\nmemory = "64GB"\nqueue = "short"')
    cluster = read_profile("hall", file)
    assert (cluster.jobs, cluster.workers) == (4, 32)
    assert cluster.options == {"memory": "64GB", "queue": "short"}
    assert cluster.wait == 3600  # a queue may be long
    assert str(cluster) == "4 × 32 workers of slurm profile 'hall'"


def test_certificates_stand_beside_the_profiles(profiles, tmp_path):
    lines = 'address = "tls://head:8786"\nca_file = "ca.pem"\ncert = "me.pem"\nkey = "me.key"'
    for name in ("ca.pem", "me.pem", "me.key"):
        (tmp_path / name).touch()
    cluster = choose_cluster(None, "campus", profiles(f'[campus]\nsystem = "scheduler"\n{lines}'), False)
    assert cluster.tls == {"ca_file": f"{tmp_path}/ca.pem", "cert": f"{tmp_path}/me.pem", "key": f"{tmp_path}/me.key"}


def test_certificates_for_a_plain_address_are_refused(profiles, tmp_path):
    """With the flag too: who has certificates means to use them."""
    (tmp_path / "x").touch()
    lines = 'address = "tcp://head:8786"\nca_file = "x"\ncert = "x"\nkey = "x"'
    with pytest.raises(InputError, match="write tls:// before it"):
        choose_cluster(None, "campus", profiles(f'[campus]\nsystem = "scheduler"\n{lines}'), True)


@pytest.mark.parametrize("name", ["slurm", "pbs", "htcondor", "campus", "trial"])
def test_every_example_can_be_read(name, tmp_path):
    text = EXAMPLE.read_text().replace("~/critflow-", f"{tmp_path}/")
    for file in ("ca.pem", "me.pem", "me.key"):
        (tmp_path / file).touch()
    (tmp_path / "profiles.toml").write_text(text)
    assert read_profile(name, tmp_path / "profiles.toml").name == name


MISTAKES = {
    "no such profile": ('[hall]\nsystem = "slurm"', "did you mean 'hall'"),
    "empty": ("", "the file is empty"),
    "not TOML": ("[hal", "not TOML"),
    "not a table": ("hal = 3", "begin it with [hal]"),
    "no system": ("[hal]\njobs = 3", "needs a system"),
    "other system": ('[hal]\nsystem = "lsf"', "slurm, pbs, htcondor"),
    "unknown key": ('[hal]\nsystem = "slurm"\nworkers = 1\nmemory = "1GB"\nqueu = "a"', "did you mean 'queue'"),
    "key of another system": ('[hal]\nsystem = "pbs"\nworkers = 1\nmemory = "1GB"\ndisk = "1GB"', "unknown key 'disk'"),
    "wrong type": ('[hal]\nsystem = "slurm"\nworkers = "1"\nmemory = "1GB"', "whole number"),
    "true is no number": ('[hal]\nsystem = "slurm"\nworkers = true\nmemory = "1GB"', "whole number"),
    "nobody": ('[hal]\nsystem = "slurm"\nworkers = 0\nmemory = "1GB"', "above zero"),
    "not texts": ('[hal]\nsystem = "slurm"\nworkers = 1\nmemory = "1GB"\njob_extra_directives = [1]', "list of texts"),
    "no text": ('[hal]\nsystem = "slurm"\nworkers = 1\nmemory = 3', "must be a text"),
    "no address": ('[hal]\nsystem = "scheduler"\nwait = 3', "needs the key address"),
    "nothing at all": ('[hal]\nsystem = "pbs"', "needs the keys workers, memory"),
    "needed": ('[hal]\nsystem = "htcondor"\nworkers = 1\nmemory = "1GB"', "needs the key disk"),
    "half a certificate": ('[hal]\nsystem = "scheduler"\naddress = "tls://a:1"\ncert = "x"', "needs all of"),
    "no certificate": (
        '[hal]\nsystem = "scheduler"\naddress = "tls://a:1"\ncert = "x"\nkey = "x"\nca_file = "x"',
        "not a file",
    ),
    "plain address": ('[hal]\nsystem = "scheduler"\naddress = "a:1"', "add --insecure"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_refused_in_one_sentence(profiles, mistake):
    text, reason = MISTAKES[mistake]
    with pytest.raises(InputError) as caught:
        choose_cluster(None, "hal", profiles(text), False)
    assert reason in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("address", ["tcp://head:8786", "head:8786", "127.0.0.1:8786"])
def test_a_plain_address_needs_a_flag(address):
    with pytest.raises(InputError, match="--insecure"):
        choose_cluster(address, None, None, False)
    assert choose_cluster(address, None, None, True).address == address


def test_an_encrypted_address_needs_none():
    assert choose_cluster("tls://head:8786", None, None, False).address == "tls://head:8786"


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("tls://a:1", "hall", None, False), "two clusters"),
        ((None, None, Path("p.toml"), False), "add --profile NAME"),
        ((None, None, None, True), "leave it out"),
        (("ucx://a:1", None, None, True), "must begin with"),
        ((None, "hall", Path("nowhere.toml"), False), "cannot read"),
    ],
)
def test_words_that_do_not_go_together_are_refused(words, reason):
    with pytest.raises(InputError, match=reason):
        choose_cluster(*words)


def test_profiles_are_looked_for_here_and_at_home(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "home"))
    with pytest.raises(InputError, match="write one, or give --profiles"):
        read_profile("trial")
    (tmp_path / "home" / "critflow").mkdir(parents=True)
    for jobs, file in ((1, tmp_path / "home" / "critflow" / "profiles.toml"), (2, tmp_path / "profiles.toml")):
        file.write_text(f'[trial]\nsystem = "local"\njobs = {jobs}\nworkers = 1\nmemory = "1GB"')
        assert read_profile("trial").jobs == jobs
