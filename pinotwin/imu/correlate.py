"""Masked normalised cross-correlation over the overlap (Padfield 2012, DOI 10.1109/TIP.2011.2181402), by FFT."""

from __future__ import annotations

import numpy as np

from pinotwin.arrays import Floats


def best_lag(a: Floats, b: Floats) -> tuple[float, float]:
    """Return by how many samples ``b`` begins after ``a`` and the coefficient; short or still overlaps do not count."""
    size = 1 << int(np.ceil(np.log2(len(a) + len(b))))
    A, A2, ones_a = (np.fft.rfft(x, size) for x in (a, a * a, np.ones_like(a)))
    B, B2, ones_b = (np.conj(np.fft.rfft(x, size)) for x in (b, b * b, np.ones_like(b)))
    n, sa, sb, ab, aa, bb = (
        np.fft.irfft(x, size)
        for x in (ones_a * ones_b, A * ones_b, ones_a * B, A * B, A2 * ones_b, ones_a * B2)
    )
    n = np.maximum(n, 1e-9)
    va, vb = np.maximum(aa - sa**2 / n, 0.0), np.maximum(bb - sb**2 / n, 0.0)
    shorter = min(len(a), len(b))
    enough = (n > 0.5 * shorter) & (vb > 0.1 * np.max(vb)) & (va > 1e-3 * np.max(va))
    score = np.where(enough, (ab - sa * sb / n) / np.sqrt(np.maximum(va * vb, 1e-12)), -1.0)
    # a lag that fits only where little overlaps must not beat the full overlap
    k = int(np.argmax(score * np.sqrt(np.minimum(n / shorter, 1.0))))
    left, mid, right = score[k - 1], score[k], score[(k + 1) % size]
    curve = left - 2.0 * mid + right
    part = 0.5 * (left - right) / curve if curve < 0.0 and min(left, right) > -1.0 else 0.0
    return float((k if k < len(a) else k - size) + part), float(mid)
