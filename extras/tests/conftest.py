"""The settings and fixtures of the tests of the scene, which lie beside these in a copy of the repository."""

from fixtures import *  # noqa: F403
