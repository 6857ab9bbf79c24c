"""One thread for dense algebra of small matrices, whose threads wait for each other where other processes are busy."""

from __future__ import annotations

from functools import cache
from typing import Any

from threadpoolctl import ThreadpoolController


@cache
def _controller() -> ThreadpoolController:
    # To find the libraries takes milliseconds, to set their threads microseconds.
    return ThreadpoolController()


def one_thread() -> Any:
    """A context in which BLAS uses one thread, which is fastest for decompositions of up to some hundred rows."""
    return _controller().limit(limits=1, user_api="blas")
