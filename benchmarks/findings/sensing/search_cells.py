"""How many independent cells a search grid finer than the DFT stands for: the constants of the rival in
`isacsim.radio.echo`.

The benchmark draws noise alone, takes the largest cell of each grid, and prints g in P(largest < x) = exp(-g N exp(-x))
at several quantiles, with the straight line through them.

Run: python -m isac_cosim.benchmarks.findings.sensing.search_cells [ECHOES]
"""

from __future__ import annotations

import sys
from itertools import product

import numpy as np
import torch

from isac_cosim.isacsim.radio.waveform import Waveform

QUANTILES = np.array([0.02, 0.05, 0.1, 0.25, 0.5, 0.75, 0.9, 0.95])


def largest(noise: torch.Tensor) -> dict[str, torch.Tensor]:
    """Largest power among the cells, the cells and pairs of neighbours, and the half cells of each echo, (B,) by grid.

    noise: white, of unit variance, (B, antennas, subcarriers, symbols). Its unitary DFT is white, too, so it serves as
    the cells of the plain transform and as the echo of the padded one.
    """
    pairs = torch.zeros(len(noise))
    for half in product((False, True), repeat=3):
        values = noise
        for axis in (k for k in range(3) if half[k]):
            values = (values + torch.roll(values, -1, axis + 1)) * 0.5**0.5
        pairs = torch.maximum(pairs, _peak(values))
    padded = torch.fft.fftn(noise, s=[2 * n for n in noise.shape[1:]], dim=(1, 2, 3))
    return {"whole": _peak(noise), "pairs": pairs, "half": _peak(padded) / noise[0].numel()}


def _peak(values: torch.Tensor) -> torch.Tensor:
    return (values.real.square() + values.imag.square()).flatten(1).amax(1)


def run(echoes: int = 4096, seed: int = 1) -> dict[str, tuple[float, float]]:
    """Measure intercept and slope of g over the level x for each grid."""
    waveform = Waveform()
    generator = torch.Generator().manual_seed(seed)
    peaks: dict[str, list[torch.Tensor]] = {}
    for _ in range(echoes // 8):
        noise = torch.randn((8, *waveform.shape), dtype=torch.complex64, generator=generator)
        for name, values in largest(noise).items():
            peaks.setdefault(name, []).append(values)
    lines = {}
    for name, parts in peaks.items():
        level = np.quantile(torch.cat(parts).numpy(), QUANTILES)
        count = -np.log(QUANTILES) * np.exp(level) / waveform.size
        slope, intercept = np.polyfit(level, count, 1)
        lines[name] = (float(intercept), float(slope))
        print(f"{name:6s} g = {intercept:.2f} + {slope:.3f} x   at {np.round(level, 1)}: {np.round(count, 2)}")
    return lines


if __name__ == "__main__":
    run(*(int(a) for a in sys.argv[1:]))
