"""The tiny study without its pictures, which take longer to draw than all else."""

from dataclasses import replace

from .tiny_study import study as tiny

study = replace(tiny, name="bare", figures={}, animations={})
