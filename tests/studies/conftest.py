"""Small runs of the studies."""

from study_runs import *  # noqa: F403
