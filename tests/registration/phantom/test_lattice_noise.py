"""Random numbers tied to places: repeatable, well spread, uncorrelated between neighbours."""

from __future__ import annotations

import numpy as np

from registration.phantom.lattice_noise import hash_cells, mix, smooth_noise


def lattice(side: int = 40) -> tuple[np.ndarray, ...]:
    return tuple(axis.ravel() for axis in np.mgrid[-side // 2 : side // 2, :side, :side])


def test_same_cell_and_seed_give_the_same_bits_and_others_differ() -> None:
    i, j, k = lattice(10)
    np.testing.assert_array_equal(hash_cells(i, j, k, 5), hash_cells(i, j, k, 5))
    assert (hash_cells(i, j, k, 5) != hash_cells(i, j, k, 6)).mean() > 0.99
    assert len(np.unique(hash_cells(i, j, k, 5))) == len(i)
    # A transposed cell is another cell.
    assert (hash_cells(i, j, k, 5) != hash_cells(j, i, k, 5))[i != j].all()


def test_every_bit_is_fair_and_neighbours_are_unrelated() -> None:
    bits = hash_cells(*lattice(), seed=0)
    shares = [(bits >> np.uint32(bit) & np.uint32(1)).mean() for bit in range(32)]
    np.testing.assert_allclose(shares, 0.5, atol=0.01)
    cube = (bits.astype(float) / 2**32 - 0.5).reshape(40, 40, 40)
    for axis in range(3):
        assert abs(np.corrcoef(cube.ravel(), np.roll(cube, 1, axis).ravel())[0, 1]) < 0.02


def test_mix_loses_nothing() -> None:
    numbers = np.arange(100_000, dtype=np.uint32)
    assert len(np.unique(mix(numbers))) == len(numbers)


def test_smooth_noise_is_standardised_periodic_and_correlated() -> None:
    noise = smooth_noise(3, cells=32, correlation=2.0)
    assert abs(noise.mean()) < 1e-5
    assert abs(noise.std() - 1) < 1e-5
    across = [np.corrcoef(noise.ravel(), np.roll(noise, 1, axis).ravel())[0, 1] for axis in range(3)]
    # Two Gaussians of deviation 2, one cell apart: exp(-1 / (4 * 2**2)), the seam between last and first included.
    np.testing.assert_allclose(across, np.exp(-1 / 16), atol=0.02)
