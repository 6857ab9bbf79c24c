"""The settings and fixtures of all tests."""

from fixtures import *  # noqa: F403
