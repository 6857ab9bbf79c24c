"""The tests of an extra are left out where it, or another one that they use, is not there."""

from extras_there import missing


def pytest_ignore_collect(collection_path):
    if collection_path.suffix != ".py" or not collection_path.name.startswith("test_"):
        return None
    return bool(missing(collection_path.read_text(encoding="utf-8"), collection_path.parent.name)) or None
