"""BLAS on one thread during the calls of this library."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

from threadpoolctl import ThreadpoolController


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """A context, or a decorator, in which BLAS uses one thread; calls inside it find it so, and set nothing.

    Digits and times then do not depend on other processes: threads that wait for each other while processes are busy
    take seconds for the small dense matrices of this library.
    """
    controller = _controller()
    blas = (library.num_threads for library in controller.lib_controllers if library.user_api == "blas")
    if all(n == 1 for n in blas):
        yield
        return
    with controller.limit(limits=1, user_api="blas"):
        yield


@cache
def _controller() -> ThreadpoolController:
    # To find the libraries takes milliseconds, to set their threads microseconds.
    return ThreadpoolController()
