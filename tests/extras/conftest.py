"""The tests of an extra are left out where it, or another one that they use, is not there."""

from extras_there import absent, used_by_file


def pytest_ignore_collect(collection_path):
    if collection_path.suffix != ".py" or not collection_path.name.startswith("test_"):
        return None
    return bool(absent({collection_path.parent.name, *used_by_file(collection_path)})) or None
