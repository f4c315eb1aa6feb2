"""Closed-loop identification and linear simulation against scipy and python-control, in one run.

    OPENBLAS_NUM_THREADS=1 python -m benchmarks loop

The log is that of a known loop of order 5 or 7 with 1 % noise, sampled at 4 kHz. Differential
evolution minimises the same misfit with the filters of scipy (s^k / D as difference equations, then
least squares), the usual way to write "pole search with LS projection". Only ratios count.
"""

from __future__ import annotations

import math
import time

import control
import numpy as np
from scipy import optimize, signal

from benchmarks._timing import best
from pinotwin.loop import LoopData, LoopModel, Structure, identify_loop
from pinotwin.loop.layout import Layout, lay_out
from pinotwin.loop.projection import Projection, Scales

STEP = 1.0 / 4000.0
POLES = {
    1: (60.0, 11.0, 0.67),
    2: (60.0, 11.0, 0.67, 29.0, 0.05),
}  # p1 [Hz], then wn [Hz] and zeta of every pair


def truth(pairs: int) -> LoopModel:
    """A loop with given poles; residues that obey the structure, otherwise plain."""
    structure = Structure(pole_pairs=pairs)
    layout = lay_out(structure, STEP, (1, 2))
    values = [2 * math.pi * x if i % 2 == 1 or i == 0 else x for i, x in enumerate(POLES[pairs])]
    sections = layout.shaped(np.log(values))
    residues = []
    rng = np.random.default_rng(0)
    for k in range(2):
        c, Z = layout.ties(sections, k, np.ones(2)).particular()
        residues.append(c + Z @ rng.uniform(0.5, 1.5, Z.shape[1]))
    return LoopModel("X", ("d",), ("e", "u"), STEP, structure, sections, np.array(residues))


def log(model: LoopModel, n: int) -> LoopData:
    """A noisy log of n samples: random moves, friction that follows their sign."""
    rng = np.random.default_rng(1)
    ar = np.repeat(rng.choice([-1.0, 0.0, 1.0], n // 200 + 1), 200)[:n]
    ar = signal.lfilter(np.ones(100) / 100, 1, ar)
    vr = np.cumsum(ar) * STEP
    vr -= np.linspace(0.0, vr[-1], n)
    d = np.tanh(vr / 0.01) + 0.3 * np.sin(400.0 * np.cumsum(vr) * STEP)
    y = model.simulate(0 * vr, d, vr=vr, ar=ar)
    noise = 0.01 * y.std(axis=0) * rng.standard_normal(y.shape)
    return LoopData(STEP, np.cumsum(vr) * STEP, d, y + noise, vr=vr, ar=ar)


def plain_cost(data: LoopData, theta: np.ndarray) -> float:
    """Return the misfit by scipy's filters and a dense least squares, from rest."""
    den = np.array([1.0, math.exp(theta[0])])
    for wn, zeta in zip(np.exp(theta[1::2]), np.exp(theta[2::2]), strict=True):
        den = np.polymul(den, [1.0, 2 * zeta * wn, wn * wn])
    fast = 2 * math.pi / STEP
    full = np.polymul(den, [1.0, 2 * fast, fast * fast])
    columns = []
    for bottom, w in ((den, data.d[:, 0]), (full, data.vr)):
        for k in range(len(bottom) - 1):
            top = np.zeros(k + 1)
            top[0] = 1.0
            b, a, _ = signal.cont2discrete((top, bottom), STEP, "foh")
            x = signal.lfilter(np.atleast_2d(b)[0], a, w)
            columns.append(x / max(np.abs(x).max(), 1e-300))
    W = np.column_stack(columns)
    y = data.outputs / data.outputs.std(axis=0)
    return float(np.sum((y - W @ np.linalg.lstsq(W, y, rcond=None)[0]) ** 2))


def identification() -> None:
    """Print identification times, and those of differential evolution."""
    print("identify_loop (12 starts, polish, intervals) [s]; one misfit with gradient [ms]")
    for pairs in (1, 2):
        model = truth(pairs)
        for n in (5_000, 50_000):
            data = log(model, n)
            structure = model.structure
            layout = lay_out(structure, STEP, (1, 2))
            projection = Projection(data, layout, Scales.of(data))
            middle = _middle(layout)
            one = best(lambda p=projection, x=middle: p.evaluate(x), 7)
            whole = best(lambda d=data, s=structure: identify_loop(d, s))
            found = identify_loop(data, structure)
            off = max(
                abs(row["value"] / value - 1.0)
                for row, value in zip(found.pole_table(), POLES[pairs], strict=False)
            )
            print(
                f"  order {structure.order}, {n:6d} samples: {whole:6.2f} s, "
                f"{1e3 * one:6.1f} ms, poles within {100 * off:.2g} %"
            )
            if pairs == 1 and n == 5_000:
                _evolution(data, layout, whole)


def _middle(layout: Layout) -> np.ndarray:
    low, high = layout.box
    return 0.5 * (low + high)


def _evolution(data: LoopData, layout: Layout, ours: float) -> None:
    low, high = layout.box
    start = time.perf_counter()
    found = optimize.differential_evolution(
        lambda x: plain_cost(data, x),
        list(zip(low, high, strict=True)),
        seed=0,
        tol=1e-6,
        popsize=10,
    )
    spent = time.perf_counter() - start
    print(
        f"    differential evolution on scipy's filters: {spent:.1f} s, "
        f"{found.nfev} evaluations; {spent / ours:.0f} times as long"
    )


def simulation() -> None:
    """Print simulation times."""
    print("simulate, 50 000 samples [ms]")
    for pairs in (1, 2):
        model = truth(pairs)
        data = log(model, 50_000)
        qr, d, vr, ar = data.qr, data.d, data.vr, data.ar
        ours = best(lambda m=model, a=(qr, d, vr, ar): m.simulate(a[0], a[1], vr=a[2], ar=a[3]), 7)
        system = model.to_control(None, None)
        t = STEP * np.arange(50_000)
        w = np.column_stack([d, vr, ar])
        matrices = (system.A, system.B, system.C, system.D)
        lsim = best(lambda m=matrices, w=w, t=t: signal.lsim(m, w, t))
        forced = best(lambda s=system, w=w, t=t: control.forced_response(s, t, w.T), 1)
        print(
            f"  order {model.structure.order}: {1e3 * ours:.1f} ms; "
            f"scipy lsim {1e3 * lsim:.0f} ms ({lsim / ours:.0f} times), "
            f"control {1e3 * forced:.0f} ms ({forced / ours:.0f} times); "
            f"{50_000 * STEP / ours:.0f} times real time"
        )


def main() -> None:
    """Run all."""
    identification()
    simulation()


if __name__ == "__main__":
    main()
