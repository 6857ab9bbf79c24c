"""The tests of an extra are left out where it, or another one that they use, is not there."""

import pytest
from extras_there import absent, left_out_without_services, used_by_file


def pytest_ignore_collect(collection_path):
    if collection_path.suffix != ".py" or not collection_path.name.startswith("test_"):
        return None
    return bool(absent({collection_path.parent.name, *used_by_file(collection_path)})) or None


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call():
    with left_out_without_services():
        return (yield)
