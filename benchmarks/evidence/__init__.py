"""The figures that README and docs state, each measured by a part of its own, all in one file.

    python -m benchmarks evidence               # every part; `make evidence`
    python -m benchmarks evidence emps tx40     # these parts
    python -m benchmarks evidence --list        # what there is, and how old it is
    python -m benchmarks evidence --add loop figures.json --command "..." --seeds "430:454"   # measured elsewhere

A part is a module of this folder with a docstring (what is measured, how), ``SEEDS`` and ``figures()``. What
it returns takes the place of its earlier figures in ``docs/figures.json`` as soon as it is there, and
``docs/figures.md`` is written from that. The pages of the docs take their numbers from the file when they are built
(``docs/hooks.py``); tests/test_words.py holds the numbers of README.md against it.
"""

from benchmarks.evidence.command import main as main
